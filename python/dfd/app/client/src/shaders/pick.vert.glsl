uniform highp sampler2D posedPositions; // xyz: position, w: heat

out vec3 restPosition;
#ifdef ISOLATED
out float heat;
#endif
flat out uint corner; // the last corner of the triangle, by which `faces.ts` finds the triangle

void main() {
  vec4 posedPosition = texelFetch(posedPositions, ivec2(gl_VertexID & 4095, gl_VertexID >> 12), 0);
  restPosition = position;
#ifdef ISOLATED
  heat = posedPosition.w;
#endif
  corner = uint(gl_VertexID);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(posedPosition.xyz, 1.0);
}
