#pragma once

#include "dfd/common/matrix.hpp"

#include <cstdint>
#include <span>

namespace dfd {

/// Writes to `out` (N, K) the values of three rows of `values` (R, K) blended at each point: B·T of the paper's Eq. 2,
/// with `rows` (N, 3) and their `weights` (N, 3).
///
/// @throws std::invalid_argument if shapes disagree or an index is out of range
void blend(Matrix<const float> values, Matrix<const std::int32_t> rows, Matrix<const float> weights,
           Matrix<float> out);

/// Points at which rays meet triangles.
struct RayHits {
    Matrix<const std::int32_t> corners;   // (N, 3) vertices of the triangle that is met
    Matrix<const float> barycentric;      // (N, 3)
    std::span<const std::int64_t> rays;   // (N,)
    Matrix<const float> directions;       // (rays, 3) unit
};

/// Writes |n · d| of each hit to `out` (N, 1), with n the unit blend of the unit `normals` (V, 3) of its corners: 1 where
/// the surface faces the eye, from either side, 0 where it is seen edge on. Where normals cancel out, as where faces wound
/// either way meet, n is the triangle's own, of `vertices` (V, 3); 0 for one without area.
///
/// @throws std::invalid_argument if shapes disagree or an index is out of range
void facing(Matrix<const float> vertices, Matrix<const float> normals, const RayHits& hits, Matrix<float> out);

/// Writes colors, the first three columns of `colors` (N, 4) in [0, 1], as bytes to the rows of `image` (pixels, 3) that
/// `pixels` (N,) names.
///
/// @throws std::invalid_argument if shapes disagree or an index is out of range
void paint(Matrix<const float> colors, std::span<const std::int64_t> pixels, Matrix<std::uint8_t> image);

}  // namespace dfd
