precision highp float;

uniform sampler2D picture;
uniform highp sampler2D depths;

layout(location = 0) out vec4 color;

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(depths, at, 0).r;
  if (depth == 1.0) discard; // beside the shape
  gl_FragDepth = depth;
  color = texelFetch(picture, at, 0);
}
