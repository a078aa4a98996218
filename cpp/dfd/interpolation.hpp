#pragma once

#include "dfd/common/matrix.hpp"

#include <cstdint>
#include <span>

namespace dfd {

/// Clusters of vertices, and which of them are neighbors.
struct Clusters {
    Matrix<const double> centers;             // (N, 3)
    std::span<const std::int32_t> of_vertex;  // (V) the cluster of each vertex
    std::span<const std::int32_t> starts;     // (N + 1) where the neighbors of each cluster begin and end
    std::span<const std::int32_t> neighbors;  // (E) clusters, each among its own neighbors
};

/// Interpolates `values` (N, K) of the clusters at the vertices `chosen` (M), to `out` (M, K).
///
/// A vertex gets the weighted mean of its cluster and of the neighbors of that. A weight is (1 − d²/r²)², d being the
/// distance from the center, and r a little more than the largest of these distances.
///
/// @throws std::invalid_argument if shapes disagree or an index is out of range
void interpolate(Matrix<const double> vertices, const Clusters& clusters, std::span<const std::int32_t> chosen,
                 Matrix<const float> values, Matrix<float> out, int threads);

}  // namespace dfd
