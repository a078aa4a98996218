in vec4 posedPosition;
in vec3 rest;

out vec3 restPosition;
#ifdef ISOLATED
out float heat;
#endif
flat out uint corner; // the last corner of the triangle, by which `faces.ts` finds the triangle

void main() {
  restPosition = rest;
#ifdef ISOLATED
  heat = posedPosition.w;
#endif
  corner = uint(gl_VertexID);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(posedPosition.xyz, 1.0);
}
