// Eq. 1 and 8 for one vertex, with weights made of distances (Eq. 4 to 7). `src/viewer/twin.ts` says the same in
// TypeScript, and tests hold the two together. Each of the names MIRROR, DEFAULT, FIXED, SHARE, ALONG, CURVED and TURNED
// is defined where the scene has such a thing: processors that draw run through every branch, taken or not.

uniform highp usampler2DArray distances; // (layers) rows of 4096 texels: R a distance, weight or share, G a geodesic one
uniform highp sampler2D columns;         // (columns, 10) what each column does, see `src/viewer/pose_textures.ts`
uniform int columnCount;
uniform mat4 defaultTransform; // D₀
uniform vec4 mirror;           // unit normal and offset
uniform float mirrorBand;      // half width of the smooth band

const float UNIT = 1.0 / 65535.0;

struct Posed {
  vec3 position;
  mat3 linear; // the blended transform's, for normals
  float heat;
};

uvec2 stored(int layer, int at) {
  return texelFetch(distances, ivec3(at & 4095, at >> 12, layer), 0).rg;
}

vec4 entry(int texel, int k) {
  return texelFetch(columns, ivec2(texel, k), 0);
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
float weightOf(int k, vec4 layers, int at) {
  vec4 shape = entry(6, k);  // reach, falloff, λ, gain
  vec4 scales = entry(8, k); // of its numbers, whether they are weights, of fixed ones; strength
  uvec2 own = stored(int(layers.x), at);
  float value = float(own.r) * UNIT * scales.x;
  float weight = max(1.0 - value / shape.x, 0.0); // Eq. 4 and 5
#ifdef CURVED
  weight = falloff(weight, int(shape.y));
#endif
#ifdef FIXED
  if (layers.y >= 0.0) weight = max(weight - float(stored(int(layers.y), at).r) * UNIT * scales.z, 0.0); // Eq. 6
#endif
#ifdef ALONG
  if (shape.z > 0.0) weight *= pow(max(1.0 - float(own.g) * UNIT, 0.0), shape.z); // Eq. 7
#endif
  return scales.y > 0.5 ? value : scales.w * min(shape.w * weight, 1.0);
}

// How much of a point belongs to the side that the mirror's normal points to: a step, or smooth over the band.
float positiveShare(vec3 point) {
  float height = dot(point, mirror.xyz) - mirror.w;
  if (mirrorBand == 0.0) return height >= 0.0 ? 1.0 : 0.0;
  float t = clamp(0.5 * height / mirrorBand + 0.5, 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

Posed posed(vec3 point, int at) {
  vec4 from = vec4(point, 1.0);
  vec3 moved = vec3(0.0);
  mat3 turned = mat3(0.0);
  float total = 0.0;
  float heat = 0.0;
#ifdef MIRROR
  float positive = positiveShare(point);
#endif
  for (int k = 0; k < columnCount; k++) {
    vec4 layers = entry(7, k); // of distances, of fixed places, of the counterpart's share; side
    vec4 role = entry(9, k);   // how it shows in the heat map, whether it acts; counterpart's gain
    float weight = weightOf(k, layers, at);
#ifdef SHARE
    if (layers.z >= 0.0) weight = min(role.z * float(stored(int(layers.z), at).r) * UNIT * weight, 1.0);
#endif
    heat += weight * role.x;
    weight *= role.y;
    // Rows of D − I, and of its mirror image on the other side of the plane.
    vec4 x = entry(0, k);
    vec4 y = entry(1, k);
    vec4 z = entry(2, k);
#ifdef MIRROR
    float own = layers.w > 0.0 ? positive : 1.0 - positive;
    x = mix(entry(3, k), x, own);
    y = mix(entry(4, k), y, own);
    z = mix(entry(5, k), z, own);
#endif
    moved += weight * vec3(dot(x, from), dot(y, from), dot(z, from));
#ifdef TURNED
    turned += weight * transpose(mat3(x.xyz, y.xyz, z.xyz));
#endif
    total += weight;
  }
#ifdef DEFAULT
  float left = max(1.0 - total, 0.0);
  moved += left * ((defaultTransform * from).xyz - point);
  turned += left * (mat3(defaultTransform) - mat3(1.0));
#endif
  return Posed(point + moved, mat3(1.0) + turned, heat);
}

// Cofactors: what carries normals along with a linear map, mirrored and flattened ones too.
vec3 turnedNormal(mat3 linear, vec3 normal) {
  mat3 cofactors = mat3(cross(linear[1], linear[2]), cross(linear[2], linear[0]), cross(linear[0], linear[1]));
  vec3 turned = cofactors * normal;
  float size = length(turned);
  return size > 0.0 ? turned / size : normal;
}
