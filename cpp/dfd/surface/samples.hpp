#pragma once

// Samples of a large surface: vertices with about equal spacing, a surface that joins them, and the interpolation of
// their values at other vertices.

#include "dfd/surface/march.hpp"
#include "dfd/common/matrix.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace dfd {

/// Samples at least `spacing` apart along the surface, and the nearest sample of each vertex, its owner.
struct Samples {
    std::vector<std::int32_t> vertices;  // (K) the vertex of each sample
    std::vector<std::int32_t> owner;     // (V) the sample in whose Voronoi cell the vertex lies
    std::vector<float> to_owner;         // (V) distance of the owner, at most `spacing`
    double spacing = 0;
};

/// The samples from which the value of a vertex is interpolated, and their weights.
struct Around {
    static constexpr std::size_t count = 8;
    std::array<std::int32_t, count> samples;
    std::array<float, count> weights;  // sum 1
};

/// Returns the surface of a mesh with `links` (L, 2) between vertices.
Surface surface_of(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> links);

/// Returns about `count` samples, or more if edges are long.
Samples take_samples(const Surface& mesh, Matrix<const double> vertices, std::size_t count);

/// Returns the surface of samples: triangles and links between samples whose Voronoi cells touch. `rings` receives the
/// neighbors of each sample, except those across a gap.
Surface voronoi_surface(const Surface& mesh, Matrix<const double> vertices, const Samples& samples,
                        std::vector<std::vector<std::int32_t>>& rings);

/// Returns, for each vertex (V), the weights of the samples around it by moving least squares. They reproduce linear
/// functions of position.
std::vector<Around> linear_fits(Matrix<const double> vertices, const Samples& samples,
                                const std::vector<std::vector<std::int32_t>>& rings, int threads);

}  // namespace dfd
