#include "dfd/surface/interpolation.hpp"

#include "dfd/common/parallel.hpp"
#include "dfd/common/require.hpp"

#include <algorithm>
#include <vector>

namespace dfd {
namespace {

constexpr double radius_ratio = 1.1;   // r² divided by the squared distance of the farthest center; see the header
constexpr double added_weight = 1e-6;  // added to each weight (1 − d²/r²)² before the weights are divided by their sum

void check(Matrix<const double> vertices, const Clusters& clusters, std::span<const std::int32_t> chosen,
           Matrix<const float> values, Matrix<float> out)
{
    const std::size_t count = clusters.centers.rows;
    const auto& starts = clusters.starts;
    require(vertices.columns == 3, "interpolate: `vertices` must have shape (V, 3)");
    require(clusters.centers.columns == 3, "interpolate: `centers` must have shape (N, 3)");
    require(clusters.of_vertex.size() == vertices.rows, "interpolate: `of_vertex` must have one entry per vertex");
    require_indices({clusters.of_vertex.data(), vertices.rows, 1}, 1, count,
                    "interpolate: `of_vertex` must be indices of clusters");
    require(starts.size() == count + 1 && starts.front() == 0 && std::is_sorted(starts.begin(), starts.end()) &&
                static_cast<std::size_t>(starts.back()) == clusters.neighbors.size(),
            "interpolate: `starts` must rise from 0 to the number of neighbors");
    require_indices({clusters.neighbors.data(), clusters.neighbors.size(), 1}, 1, count,
                    "interpolate: `neighbors` must be indices of clusters");
    require_indices({chosen.data(), chosen.size(), 1}, 1, vertices.rows,
                    "interpolate: `chosen` must be vertex indices");
    require(values.rows == count, "interpolate: `values` must have one row per cluster");
    require(out.rows == chosen.size() && out.columns == values.columns,
            "interpolate: `out` must have shape (M, K)");
}

}  // namespace

void interpolate(Matrix<const double> vertices, const Clusters& clusters, std::span<const std::int32_t> chosen,
                 Matrix<const float> values, Matrix<float> out, int threads)
{
    check(vertices, clusters, chosen, values, out);
    parallel_ranges(chosen.size(), 1024, threads, [&](std::size_t, std::size_t begin, std::size_t end) {
        std::vector<double> weights;
        for (std::size_t i = begin; i < end; ++i) {
            const auto vertex = static_cast<std::size_t>(chosen[i]);
            const auto point = vertices.row(vertex);
            const auto own = static_cast<std::size_t>(clusters.of_vertex[vertex]);
            const auto first = static_cast<std::size_t>(clusters.starts[own]);
            const auto near = clusters.neighbors.subspan(first, static_cast<std::size_t>(clusters.starts[own + 1]) - first);
            weights.resize(near.size());
            for (std::size_t j = 0; j < near.size(); ++j) {
                const auto center = clusters.centers.row(static_cast<std::size_t>(near[j]));
                const double x = point[0] - center[0], y = point[1] - center[1], z = point[2] - center[2];
                weights[j] = x * x + y * y + z * z;
            }
            double largest = 0.0, total = 0.0;
            for (const double squared : weights) largest = std::max(largest, squared);
            const double scale = largest > 0.0 ? 1.0 / (radius_ratio * largest) : 0.0;
            for (double& weight : weights) {
                const double root = 1.0 - weight * scale;
                total += weight = root * root + added_weight;
            }
            const auto result = out.row(i);
            std::fill(result.begin(), result.end(), 0.0F);
            for (std::size_t j = 0; j < near.size(); ++j) {
                const auto value = values.row(static_cast<std::size_t>(near[j]));
                const auto weight = static_cast<float>(weights[j] / total);
                for (std::size_t k = 0; k < result.size(); ++k) result[k] += weight * value[k];
            }
        }
    });
}

}  // namespace dfd
