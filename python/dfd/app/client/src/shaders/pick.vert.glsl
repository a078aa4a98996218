uniform highp usampler2D posedPositions; // the bits of xyz: position, w: heat

out vec3 restPosition;
#ifdef ISOLATED
out float heat;
#endif
flat out uint corner; // the last corner of the triangle, by which `faces.ts` finds the triangle

void main() {
  ivec2 at = ivec2(gl_VertexID & 4095, gl_VertexID >> 12);
  vec4 posedPosition = uintBitsToFloat(texelFetch(posedPositions, at, 0));
  restPosition = position;
#ifdef ISOLATED
  heat = posedPosition.w;
#endif
  corner = uint(gl_VertexID);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(posedPosition.xyz, 1.0);
}
