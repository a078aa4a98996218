#pragma once

#include "dfd/common/matrix.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dfd {

/// Returns the component index of each vertex, (V). Indices follow the order of the components' first vertices.
/// @param faces (F, 3) vertex indices
/// @param links (L, 2) further pairs of connected vertices
/// @throws std::invalid_argument if an index is out of range
std::vector<std::int32_t> components(std::size_t vertex_count, Matrix<const std::int32_t> faces,
                                     Matrix<const std::int32_t> links);

/// Writes two sizes of each face to `out` (F, 2): the longest side, in units of `vertices` (V, 3), and the area.
/// @throws std::invalid_argument if array shapes disagree or an index is out of range
void face_sizes(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<double> out, int threads);

}  // namespace dfd
