uniform highp usampler2D posedPositions; // the bits of xyz: position, w: heat
uniform highp usampler2D posedNormals;
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
  ivec2 at = ivec2(gl_VertexID & 4095, gl_VertexID >> 12);
  vec4 posedPosition = uintBitsToFloat(texelFetch(posedPositions, at, 0));
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
  ivec2 at = ivec2(gl_VertexID & 4095, gl_VertexID >> 12);
  vec4 posedPosition = uintBitsToFloat(texelFetch(posedPositions, at, 0));
  vec4 view = modelViewMatrix * vec4(posedPosition.xyz, 1.0);
  viewPosition = view.xyz;
  viewNormal = normalMatrix * uintBitsToFloat(texelFetch(posedNormals, at, 0).xyz);
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
