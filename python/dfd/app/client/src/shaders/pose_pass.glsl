// Every row once; what comes out is kept in buffers, and nothing is drawn.
in vec3 rest;
in vec3 restNormal;
in uint vertex; // of the row
#ifdef GIVEN
in vec3 givenPosition; // by the server, which posed the shape
in vec3 givenNormal;
#endif

out vec4 posedPosition; // and its heat
out vec3 posedNormal;

void main() {
  Posed result = posed(rest, int(vertex));
#if defined(GIVEN)
  posedPosition = vec4(givenPosition, result.heat);
  posedNormal = givenNormal;
#else
  posedPosition = vec4(result.position, result.heat);
#if defined(TURNED) || defined(DEFAULT)
  posedNormal = turnedNormal(result.linear, restNormal);
#else
  posedNormal = restNormal;
#endif
#endif
}
