out vec3 restPosition;
flat out uint corner; // of the triangle's last corner, by which its face is found

void main() {
  restPosition = position;
  corner = uint(gl_VertexID);
  Posed result = posed(position);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(result.position, 1.0);
}
