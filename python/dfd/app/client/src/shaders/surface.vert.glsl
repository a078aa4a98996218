in vec3 featureColor;
in vec4 rowColor;

out vec3 viewPosition;
out vec3 viewNormal;
out vec3 lookColor;
out vec2 textureAt;
out float heat;
out vec3 ownColor;

void main() {
  vec4 row = posedRow();
  vec4 view = modelViewMatrix * vec4(row.xyz, 1.0);
  viewPosition = view.xyz;
  viewNormal = normalMatrix * posedRowNormal();
  lookColor = featureColor;
  textureAt = uv;
  heat = row.w;
  ownColor = rowColor.rgb;
  gl_Position = projectionMatrix * view;
}
