// Eq. 1 and 8 for one vertex, with weights made of distances (Eq. 4 to 7). `src/viewer/twin.ts` says the same in
// TypeScript, and tests hold the two together.

uniform highp usampler2DArray distances; // (layers) rows of 4096 texels: R a distance, weight or share, G a geodesic one
uniform highp sampler2D columns;         // (columns, 10) what each column does, see `src/viewer/pose_textures.ts`
uniform int columnCount;
uniform bool hasDefault;
uniform mat4 defaultTransform; // D₀
uniform vec4 mirror;           // unit normal and offset
uniform float mirrorBand;      // half width of the smooth band; below 0 there is no plane
uniform bool given;            // whether the server posed the shape
in uint vertex;                // of each row
in vec3 givenPosition;
in vec3 givenNormal;

const float UNIT = 1.0 / 65535.0;

struct Posed {
  vec3 position;
  mat3 linear; // the blended transform's, for normals
  float heat;
};

uvec2 stored(int layer, int at) {
  return texelFetch(distances, ivec3(at & 4095, at >> 12, layer), 0).rg;
}

float falloff(float q, int kind) {
  if (kind == 1) return q * q * (3.0 - 2.0 * q);
  if (kind == 2) return q * q;
  if (kind == 3) return sqrt(q);
  if (kind == 4) return sqrt(q * (2.0 - q));
  if (kind == 5) return q > 0.0 ? 1.0 : 0.0;
  return q;
}

// What `dfd.app.protocol` says of a column's numbers, in its order.
float weightOf(int k, vec4 shape, vec4 layers, int at) {
  vec4 scales = texelFetch(columns, ivec2(8, k), 0); // of its numbers, whether they are weights, of fixed ones; strength
  uvec2 own = stored(int(layers.x), at);
  float value = float(own.r) * UNIT * scales.x;
  if (scales.y > 0.5) return value;
  float weight = falloff(max(1.0 - value / shape.x, 0.0), int(shape.y));                                  // Eq. 4 and 5
  if (layers.y >= 0.0) weight = max(weight - float(stored(int(layers.y), at).r) * UNIT * scales.z, 0.0); // Eq. 6
  if (shape.z > 0.0) weight *= pow(max(1.0 - float(own.g) * UNIT, 0.0), shape.z);                         // Eq. 7
  return scales.w * min(shape.w * weight, 1.0);
}

Posed posed(vec3 point) {
  int at = int(vertex);
  float positive = 1.0;
  if (mirrorBand >= 0.0) {
    float height = dot(point, mirror.xyz) - mirror.w;
    if (mirrorBand == 0.0) {
      positive = height >= 0.0 ? 1.0 : 0.0;
    } else {
      float t = clamp(0.5 * height / mirrorBand + 0.5, 0.0, 1.0);
      positive = t * t * (3.0 - 2.0 * t);
    }
  }
  vec3 moved = vec3(0.0);
  mat3 turned = mat3(0.0);
  float total = 0.0;
  float heat = 0.0;
  for (int k = 0; k < columnCount; k++) {
    vec4 shape = texelFetch(columns, ivec2(6, k), 0);  // reach, falloff, λ, gain
    vec4 layers = texelFetch(columns, ivec2(7, k), 0); // of distances, of fixed places, of the instance's share; side
    vec4 role = texelFetch(columns, ivec2(9, k), 0);   // how it shows in the heat map, whether it acts; instance's gain
    float weight = weightOf(k, shape, layers, at);
    if (layers.z >= 0.0) weight = min(role.z * float(stored(int(layers.z), at).r) * UNIT * weight, 1.0);
    heat += weight * role.x;
    if (role.y == 0.0) continue;
    float own = mirrorBand < 0.0 ? 1.0 : layers.w > 0.0 ? positive : 1.0 - positive;
    // Rows of D − I, of the handle's side and of the other.
    vec4 x = mix(texelFetch(columns, ivec2(3, k), 0), texelFetch(columns, ivec2(0, k), 0), own);
    vec4 y = mix(texelFetch(columns, ivec2(4, k), 0), texelFetch(columns, ivec2(1, k), 0), own);
    vec4 z = mix(texelFetch(columns, ivec2(5, k), 0), texelFetch(columns, ivec2(2, k), 0), own);
    vec4 from = vec4(point, 1.0);
    moved += weight * vec3(dot(x, from), dot(y, from), dot(z, from));
    turned += weight * transpose(mat3(x.xyz, y.xyz, z.xyz));
    total += weight;
  }
  if (hasDefault) {
    float left = max(1.0 - total, 0.0);
    moved += left * ((defaultTransform * vec4(point, 1.0)).xyz - point);
    turned += left * (mat3(defaultTransform) - mat3(1.0));
  }
  return Posed(given ? givenPosition : point + moved, mat3(1.0) + turned, heat);
}

// Cofactors: what carries normals along with a linear map, mirrored and flattened ones too.
vec3 turnedNormal(mat3 linear, vec3 normal) {
  if (given) return givenNormal;
  mat3 cofactors = mat3(cross(linear[1], linear[2]), cross(linear[2], linear[0]), cross(linear[0], linear[1]));
  vec3 turned = cofactors * normal;
  float size = length(turned);
  return size > 0.0 ? turned / size : normal;
}
