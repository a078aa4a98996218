precision highp float;

in vec3 restPosition;
#ifdef ISOLATED
in float heat;
#endif
flat in uint corner;

layout(location = 0) out uvec4 picked;

void main() {
#ifdef ISOLATED
  if (heat < 0.05) discard;
#endif
  picked = uvec4(floatBitsToUint(restPosition), corner + 1u);
}
