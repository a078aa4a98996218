#pragma once

#include "dfd/common/matrix.hpp"

#include <cstdint>

namespace dfd {

/// Writes the longest side and the area of every face to `out` (F, 2), in units of `vertices` (V, 3) and their square.
///
/// @throws std::invalid_argument if shapes disagree or an index is out of range
void face_sizes(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<double> out, int threads);

}  // namespace dfd
