precision highp float;

uniform int look;       // 0 texture, 1 clay, 2 features, 3 heat map
uniform vec3 baseColor; // linear
uniform bool hasMap;
uniform sampler2D map;
uniform vec3 clay;
uniform float heatStrength; // how much of the heat map lies over the look
uniform float opacity;
uniform float cutoff;
uniform bool blends;
uniform bool hasColors;
uniform bool hasFeatures;
uniform bool flatColor;

in vec3 viewPosition;
in vec3 viewNormal;
in vec3 lookColor;
in vec2 textureAt;
in float heat;
in vec3 ownColor;

layout(location = 0) out vec4 color;

// A ramp from a pale, quiet blue through violet to a warm yellow, of rising contrast to the clay beneath.
vec3 ramp(float t) {
  vec3 cold = vec3(0.079, 0.100, 0.258);
  vec3 blue = vec3(0.098, 0.145, 0.622);
  vec3 violet = vec3(0.426, 0.082, 0.509);
  vec3 coral = vec3(0.871, 0.186, 0.139);
  vec3 amber = vec3(0.982, 0.533, 0.076);
  vec3 light = vec3(0.973, 0.890, 0.395);
  float x = clamp(t, 0.0, 1.0) * 5.0;
  vec3 result = mix(cold, blue, smoothstep(0.0, 1.0, x));
  result = mix(result, violet, smoothstep(1.0, 2.0, x));
  result = mix(result, coral, smoothstep(2.0, 3.0, x));
  result = mix(result, amber, smoothstep(3.0, 4.0, x));
  return mix(result, light, smoothstep(4.0, 5.0, x));
}

void main() {
  if (flatColor) {
    color = vec4(linearToOutputTexel(vec4(baseColor, 1.0)).rgb * opacity, opacity);
    return;
  }
  vec3 n = normalize(viewNormal);
  vec3 toEye = normalize(-viewPosition);
  // Scans hold triangles that face either way.
  if (dot(n, toEye) < 0.0) n = -n;

  vec3 albedo = clay;
  float alpha = 1.0;
  if (look == 0) {
    vec4 own = vec4(baseColor, opacity);
    if (hasMap) own *= texture(map, textureAt);
    if (hasColors) own.rgb *= pow(ownColor, vec3(2.2));
    if (own.a < cutoff) discard;
    albedo = own.rgb;
    alpha = blends ? own.a : 1.0;
  }
  if (look == 2 && hasFeatures) albedo = pow(lookColor, vec3(2.2));
  // One hundredth of a weight must not tint the whole shape, unless the heat map is all that is asked for.
  float shown = look == 3 ? 0.94 : look == 2 ? 0.0 : 0.86 * smoothstep(0.01, 0.12, heat);
  albedo = mix(albedo, ramp(heat), heatStrength * shown);

  vec3 key = normalize(vec3(-0.35, 0.55, 0.76));
  float facing = max(dot(n, key), 0.0);
  float sky = 0.5 + 0.5 * n.y;
  float rim = pow(1.0 - max(dot(n, toEye), 0.0), 3.0);
  vec3 light = mix(vec3(0.33, 0.32, 0.34), vec3(0.60, 0.62, 0.66), sky) + facing * vec3(0.62, 0.60, 0.57);
  float gloss = pow(max(dot(n, normalize(key + toEye)), 0.0), 36.0) * 0.06;
  color = vec4(albedo * light + gloss + rim * 0.05, alpha);
  color = linearToOutputTexel(color);
}
