#pragma once

#include "dfd/common/matrix.hpp"

#include <cstddef>
#include <cstdint>
#include <span>

namespace dfd {

/// A pinhole camera with a square picture; it looks along -back.
struct Camera {
    Matrix<const double> frame;  // (4, 3) the eye, then the orthonormal axes right, up and back
    double half_width;           // of the picture, at distance 1
    std::size_t resolution;      // pixels along a side
};

/// Writes the unit directions through the centers of `pixels` (N,), numbered row by row from the top left, to `out` (N, 3).
///
/// @throws std::invalid_argument if shapes disagree or a pixel is none of the picture's
void ray_directions(const Camera& camera, std::span<const std::int64_t> pixels, Matrix<float> out);

/// Writes 1 to `out` (resolution, resolution) where a pixel may show one of the triangles, and 0 where surely none: where
/// its square of 8 x 8 pixels holds nothing of the rectangles around them, and little room. Everywhere 1 if some vertex of
/// a triangle is not in front of the eye.
///
/// @throws std::invalid_argument if shapes disagree or an index is out of range
void may_show(const Camera& camera, Matrix<const float> vertices, Matrix<const std::int32_t> faces,
              Matrix<std::uint8_t> out);

}  // namespace dfd
