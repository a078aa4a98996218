// Every row becomes a point that fills one texel of the posed textures.
uniform ivec2 targetSize;

flat out uvec4 posedPosition;
flat out uvec4 posedNormal;

void main() {
  Posed result = posed(position);
  posedPosition = uvec4(floatBitsToUint(result.position), floatBitsToUint(result.heat));
  posedNormal = uvec4(floatBitsToUint(turnedNormal(result.linear, normal)), 0u);
  vec2 texel = vec2(float(gl_VertexID % targetSize.x), float(gl_VertexID / targetSize.x));
  gl_Position = vec4((texel + 0.5) / vec2(targetSize) * 2.0 - 1.0, 0.0, 1.0);
  gl_PointSize = 1.0;
}
