out vec3 restPosition;
flat out uint corner; // of the triangle's last corner, by which its face is found

void main() {
  restPosition = position;
  corner = uint(gl_VertexID);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(posedRow().xyz, 1.0);
}
