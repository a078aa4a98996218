#pragma once

#include "dfd/common/matrix.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dfd {

/// Number of the connected component (V) of each vertex, counted from 0 in the order of their first vertices.
///
/// @param faces (F, 3) vertex indices
/// @param links (L, 2) vertex indices that are joined besides
/// @throws std::invalid_argument if an index is out of range
std::vector<std::int32_t> components(std::size_t vertex_count, Matrix<const std::int32_t> faces,
                                     Matrix<const std::int32_t> links);

}  // namespace dfd
