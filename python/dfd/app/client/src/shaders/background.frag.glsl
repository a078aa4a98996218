precision highp float;

uniform vec3 middle; // as on the screen
uniform vec3 rim;

in vec2 at;

layout(location = 0) out vec4 color;

void main() {
  // The ellipse about a point a little above the center that reaches the farther corners.
  float reach = length((at - vec2(0.5, 0.6)) / vec2(0.7071, 0.8485));
  color = vec4(mix(middle, rim, min(reach / 0.72, 1.0)), 1.0);
}
