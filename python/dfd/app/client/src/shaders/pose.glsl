// Eq. 1 and 8 for one vertex, as in `src/posing/columns.ts`. MIRROR, DEFAULT and TURNED are defined if the scene needs
// them. They are not uniforms, because renderers on the CPU evaluate both branches of an `if`.

uniform highp usampler2DArray weights; // vertex i is texel (i % 4096, i / 4096) of a layer
uniform highp sampler2D columns;       // 7 texels per column, see `pose_textures.ts`
uniform int columnCount;
uniform mat4 defaultTransform; // D₀
uniform vec4 mirror;           // unit normal and offset of the mirror plane
uniform float mirrorBand;      // half the width of the band in which both sides blend

const float UNIT = 1.0 / 65535.0;

struct Posed {
  vec3 position;
  mat3 linear; // the linear part of the blended transform, for normals
  float heat;
};

vec4 entry(int texel, int k) {
  return texelFetch(columns, ivec2(texel, k), 0);
}

// Return the weight of the positive side's motion at a point: 0 or 1 outside the band, and a smoothstep inside it.
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
    vec4 role = entry(6, k); // layer of the weights, side of the mirror plane, heat factor, 1 if vertices move
    float weight = float(texelFetch(weights, ivec3(at & 4095, at >> 12, int(role.x)), 0).r) * UNIT;
    heat += weight * role.z;
    weight *= role.w;
    // Rows of D − I. With MIRROR, entries 3 to 5 are those of the mirrored transform.
    vec4 x = entry(0, k);
    vec4 y = entry(1, k);
    vec4 z = entry(2, k);
#ifdef MIRROR
    float ownShare = role.y > 0.0 ? positive : 1.0 - positive;
    x = mix(entry(3, k), x, ownShare);
    y = mix(entry(4, k), y, ownShare);
    z = mix(entry(5, k), z, ownShare);
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

// Transform a normal by the cofactors of a linear map, which also works if the map mirrors or flattens.
vec3 transformedNormal(mat3 linear, vec3 normal) {
  mat3 cofactors = mat3(cross(linear[1], linear[2]), cross(linear[2], linear[0]), cross(linear[0], linear[1]));
  vec3 turned = cofactors * normal;
  float size = length(turned);
  return size > 0.0 ? turned / size : normal;
}
