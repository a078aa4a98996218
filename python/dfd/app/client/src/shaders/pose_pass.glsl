// Write the pose of each row, a vertex with one normal, to buffers. Nothing is drawn.
in vec3 rest;
in vec3 restNormal;
in uint vertex; // vertex of the row
#ifdef GIVEN
in vec3 givenPosition; // the server's pose
in vec3 givenNormal;
#endif

out vec4 posedPosition; // xyz: position, w: heat
out vec3 posedNormal;

void main() {
  Posed result = posed(rest, int(vertex));
#if defined(GIVEN)
  posedPosition = vec4(givenPosition, result.heat);
  posedNormal = givenNormal;
#else
  posedPosition = vec4(result.position, result.heat);
#if defined(TURNED) || defined(DEFAULT)
  posedNormal = transformedNormal(result.linear, restNormal);
#else
  posedNormal = restNormal;
#endif
#endif
}
