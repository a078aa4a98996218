// What `pose_pass.vert.glsl` made of each row: floats in integer textures, which every WebGL 2 can draw into.

uniform highp usampler2D posedPositions; // position and heat
uniform highp usampler2D posedNormals;

ivec2 rowTexel() {
  int width = textureSize(posedPositions, 0).x;
  return ivec2(gl_VertexID % width, gl_VertexID / width);
}

vec4 posedRow() {
  return uintBitsToFloat(texelFetch(posedPositions, rowTexel(), 0));
}

vec3 posedRowNormal() {
  return uintBitsToFloat(texelFetch(posedNormals, rowTexel(), 0).xyz);
}
