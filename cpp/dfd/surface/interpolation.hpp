#pragma once

#include "dfd/common/matrix.hpp"

#include <cstdint>
#include <span>

namespace dfd {

/// Clusters of vertices, and the neighbors of each cluster. (In Python, the clusters are `dfd.geometry.coarse.Nodes`.)
struct Clusters {
    Matrix<const double> centers;             // (N, 3) mean position of each cluster's vertices
    std::span<const std::int32_t> of_vertex;  // (V) the cluster of each vertex
    std::span<const std::int32_t> starts;     // (N + 1) offsets of each cluster's range in `neighbors`
    std::span<const std::int32_t> neighbors;  // (E) for each cluster, its neighbors and the cluster itself
};

/// Interpolates `values` (N, K) of the clusters at the vertices `chosen` (M), and writes the result to `out` (M, K).
///
/// The value at a vertex is a weighted mean of the values of its cluster and of this cluster's neighbors. A cluster
/// whose center is at distance d from the vertex has the weight (1 − d²/r²)². The radius r is slightly above all d.
/// @throws std::invalid_argument if array shapes disagree or an index is out of range
void interpolate(Matrix<const double> vertices, const Clusters& clusters, std::span<const std::int32_t> chosen,
                 Matrix<const float> values, Matrix<float> out, int threads);

}  // namespace dfd
