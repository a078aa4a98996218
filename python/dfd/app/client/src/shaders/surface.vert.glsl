in vec4 posedPosition; // xyz: position, w: heat
in vec3 posedNormal;
#ifdef FEATURES
in vec4 featureColor;
#endif
#ifdef COLORS
in vec4 rowColor;
#endif

#ifdef FLAT
uniform float near; // edges within this distance are drawn at full strength
out float strength;

void main() {
  vec4 view = modelViewMatrix * vec4(posedPosition.xyz, 1.0);
  strength = pow(clamp(-near / view.z, 0.0, 1.0), 1.5);
  gl_Position = projectionMatrix * view;
}
#else
out vec3 viewPosition;
out vec3 viewNormal;
#if defined(HEAT) || defined(ISOLATED)
out float heat;
#endif
#ifdef MAP
out vec2 textureAt;
#endif
#if defined(FEATURES) || defined(COLORS)
out vec3 ownColor;
#endif

void main() {
  vec4 view = modelViewMatrix * vec4(posedPosition.xyz, 1.0);
  viewPosition = view.xyz;
  viewNormal = normalMatrix * posedNormal;
#if defined(HEAT) || defined(ISOLATED)
  heat = posedPosition.w;
#endif
#ifdef MAP
  textureAt = uv;
#endif
#if defined(FEATURES)
  ownColor = featureColor.rgb;
#elif defined(COLORS)
  ownColor = rowColor.rgb;
#endif
  gl_Position = projectionMatrix * view;
}
#endif
