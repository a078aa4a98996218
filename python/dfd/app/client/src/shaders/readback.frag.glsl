precision highp float;

flat in uvec4 bits;

layout(location = 0) out uvec4 result;

void main() {
  result = bits;
}
