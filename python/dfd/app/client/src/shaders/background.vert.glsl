out vec2 at;

void main() {
  // One triangle over the whole view, as far away as can be.
  vec2 corner = vec2(float((gl_VertexID & 1) << 2) - 1.0, float((gl_VertexID & 2) << 1) - 1.0);
  at = 0.5 + 0.5 * corner;
  gl_Position = vec4(corner, 1.0, 1.0);
}
