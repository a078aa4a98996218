// Write the pose of each row, a vertex with one normal, to textures. Nothing is drawn.
uniform highp sampler2D rest; // xyz: position, w: vertex of the row
uniform highp isampler2D restNormals;
#ifdef GIVEN
uniform highp sampler2D givenPositions; // the server's pose, per vertex
uniform highp isampler2D givenNormals;
#endif

layout(location = 0) out uvec4 posedPosition; // the bits of xyz: position, w: heat
layout(location = 1) out uvec4 posedNormal;

void main() {
  ivec2 row = ivec2(gl_FragCoord.xy);
  vec4 own = texelFetch(rest, row, 0);
  Posed result = posed(own.xyz, int(own.w));
#ifdef GIVEN
  ivec2 at = ivec2(int(own.w) & 4095, int(own.w) >> 12);
  result.position = texelFetch(givenPositions, at, 0).xyz;
  vec3 normal = vec3(texelFetch(givenNormals, at, 0).xyz) / 32767.0;
#else
  vec3 normal = vec3(texelFetch(restNormals, row, 0).xyz) / 32767.0;
#if defined(TURNED) || defined(DEFAULT)
  normal = transformedNormal(result.linear, normal);
#endif
#endif
  posedPosition = floatBitsToUint(vec4(result.position, result.heat));
  posedNormal = floatBitsToUint(vec4(normal, 0.0));
}
