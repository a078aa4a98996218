uniform vec2 targetSize;

flat out uvec4 bits;

void main() {
  Posed result = posed(position);
  bits = uvec4(floatBitsToUint(result.position), floatBitsToUint(result.heat));
  vec2 texel = vec2(float(gl_VertexID % int(targetSize.x)), float(gl_VertexID / int(targetSize.x)));
  gl_Position = vec4((texel + 0.5) / targetSize * 2.0 - 1.0, 0.0, 1.0);
  gl_PointSize = 1.0;
}
