in vec3 featureColor;
in vec4 rowColor;

out vec3 viewPosition;
out vec3 viewNormal;
out vec3 lookColor;
out vec2 textureAt;
out float heat;
out vec3 ownColor;

void main() {
  Posed result = posed(position);
  vec4 view = modelViewMatrix * vec4(result.position, 1.0);
  viewPosition = view.xyz;
  viewNormal = normalMatrix * turnedNormal(result.linear, normal);
  lookColor = featureColor;
  textureAt = uv;
  heat = result.heat;
  ownColor = rowColor.rgb;
  gl_Position = projectionMatrix * view;
}
