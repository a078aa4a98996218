precision highp float;

flat in uvec4 posedPosition;
flat in uvec4 posedNormal;

layout(location = 0) out uvec4 positionTexel;
layout(location = 1) out uvec4 normalTexel;

void main() {
  positionTexel = posedPosition;
  normalTexel = posedNormal;
}
