// The look of the page decides which of MAP, COLORS, FEATURES, OWN, HEAT, HEAT_ALONE, ISOLATED and FLAT are defined.
precision highp float;

uniform vec3 baseColor; // linear
uniform float opacity;

layout(location = 0) out vec4 color;

// Convert linear colors to sRGB. Square roots approximate the power 1 / 2.4 with an error below 0.5 / 255.
vec3 toScreen(vec3 linear) {
  vec3 c = clamp(linear, 0.0, 1.0);
  vec3 a = sqrt(c);
  vec3 b = sqrt(a);
  return mix(0.662002687 * a + 0.684122060 * b - 0.323583601 * sqrt(b) - 0.0225411470 * c, 12.92 * c,
             vec3(lessThan(c, vec3(0.0031308))));
}

#ifdef FLAT
in float strength;

void main() {
  color = vec4(toScreen(baseColor), opacity * strength);
}
#else
uniform float cutoff;
uniform bool blends;
uniform float heatStrength; // the opacity of the heat map
uniform sampler2D map;
uniform float fade;         // the opacity of the X-ray mode

in vec3 viewPosition;
in vec3 viewNormal;
#if defined(HEAT) || defined(ISOLATED)
in float heat;
#endif
#ifdef MAP
in vec2 textureAt;
#endif
#if defined(FEATURES) || defined(COLORS)
in vec3 ownColor;

vec3 fromScreen(vec3 c) {
  return c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878);
}
#endif

#ifdef HEAT
// Return the color of the heat map for a heat from 0 to 1: from blue through violet to yellow.
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
#endif

void main() {
#ifdef ISOLATED
  if (heat < 0.05) discard;
#endif
  vec3 n = normalize(viewNormal);
  vec3 toEye = normalize(-viewPosition);
  float facingEye = dot(n, toEye);
  // Scans have triangles of both orientations, so normals are turned towards the eye.
  if (facingEye < 0.0) n = -n;

  vec3 albedo = vec3(0.584078, 0.564712, 0.533276); // clay, #c9c6c1
  float alpha = 1.0;
#if defined(FEATURES)
  albedo = fromScreen(ownColor);
#elif defined(OWN)
  vec4 own = vec4(baseColor, opacity);
#ifdef MAP
  own *= texture(map, textureAt);
#endif
#ifdef COLORS
  own.rgb *= fromScreen(ownColor);
#endif
  if (own.a < cutoff) discard;
  albedo = own.rgb;
  alpha = blends ? own.a : 1.0;
#endif
#ifdef HEAT
#ifdef HEAT_ALONE
  float shown = 0.94;
#else
  // Weights below 0.01 must not tint the shape.
  float shown = 0.86 * smoothstep(0.01, 0.12, heat);
#endif
  albedo = mix(albedo, ramp(heat), heatStrength * shown);
#endif

  const vec3 key = vec3(-0.3495, 0.5492, 0.7589); // unit length
  float facing = max(dot(n, key), 0.0);
  float sky = 0.5 + 0.5 * n.y;
  float edge = 1.0 - abs(facingEye);
  float rim = edge * edge * edge;
  vec3 light = mix(vec3(0.33, 0.32, 0.34), vec3(0.60, 0.62, 0.66), sky) + facing * vec3(0.62, 0.60, 0.57);
  float shine = max(dot(n, normalize(key + toEye)), 0.0);
  float shine2 = shine * shine;
  float shine4 = shine2 * shine2;
  float shine16 = shine4 * shine4 * shine4 * shine4;
  float gloss = shine16 * shine16 * shine4 * 0.06;
  color = vec4(toScreen(albedo * light + gloss + rim * 0.05), alpha * fade);
}
#endif
