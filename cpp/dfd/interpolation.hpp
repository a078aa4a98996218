#pragma once

#include "dfd/common/matrix.hpp"

#include <cstdint>
#include <span>

namespace dfd {

/// Clusters of vertices, and the neighbors of each cluster.
struct Clusters {
    Matrix<const double> centers;             // (N, 3)
    std::span<const std::int32_t> of_vertex;  // (V) the cluster of each vertex
    std::span<const std::int32_t> starts;     // (N + 1) offsets of each cluster's range in `neighbors`
    std::span<const std::int32_t> neighbors;  // (E) clusters; each cluster is its own neighbor too
};

/// Interpolates `values` (N, K) of the clusters at the vertices `chosen` (M), and writes the result to `out` (M, K).
///
/// A vertex gets the weighted mean over its cluster and the cluster's neighbors. The weight is (1 − d²/r²)². Here, d is
/// the distance to a cluster's center, and r is slightly more than the largest d.
///
/// @throws std::invalid_argument if shapes disagree or an index is out of range
void interpolate(Matrix<const double> vertices, const Clusters& clusters, std::span<const std::int32_t> chosen,
                 Matrix<const float> values, Matrix<float> out, int threads);

}  // namespace dfd
