precision highp float;

in vec3 restPosition;
flat in uint corner;

layout(location = 0) out uvec4 picked;

void main() {
  picked = uvec4(floatBitsToUint(restPosition), corner + 1u);
}
