#pragma once

#include "dfd/common/matrix.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dfd {

/// Returns the component index of each vertex, (V). Components are numbered from 0 by their first vertices.
/// @param faces (F, 3) vertex indices
/// @param links (L, 2) further pairs of connected vertices
/// @throws std::invalid_argument if an index is out of range
std::vector<std::int32_t> components(std::size_t vertex_count, Matrix<const std::int32_t> faces,
                                     Matrix<const std::int32_t> links);

/// Writes the longest side of each face, in units of `vertices` (V, 3), and its area in squared units to `out` (F, 2).
/// @throws std::invalid_argument if array shapes disagree or an index is out of range
void face_sizes(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<double> out, int threads);

}  // namespace dfd
