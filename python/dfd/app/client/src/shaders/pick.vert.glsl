in vec4 posedPosition;
in vec3 rest;

out vec3 restPosition;
flat out uint corner; // of the triangle's last corner, by which its face is found

void main() {
  restPosition = rest;
  corner = uint(gl_VertexID);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(posedPosition.xyz, 1.0);
}
