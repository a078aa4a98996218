#pragma once

// Samples of a large surface: a few vertices at about equal spacing, the surface that joins them, and the interpolation
// of their values at other vertices.

#include "dfd/surface/march.hpp"
#include "dfd/common/matrix.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace dfd {

/// Vertices at least `spacing` apart along the surface, and the nearest of them for every vertex.
struct Samples {
    std::vector<std::int32_t> vertices;  // (K)
    std::vector<std::int32_t> owner;     // (V) index into `vertices` of the sample whose Voronoi cell holds the vertex
    std::vector<float> to_owner;         // (V) distance to this sample, at most `spacing`
    double spacing = 0;
};

/// The samples and weights that give the value of a vertex.
struct Around {
    static constexpr std::size_t count = 8;
    std::array<std::int32_t, count> samples;
    std::array<float, count> weights;  // sum 1
};

Surface surface_of(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> links);

/// Returns about `count` samples, or more if edges are long.
Samples take_samples(const Surface& mesh, Matrix<const double> vertices, std::size_t count);

/// Returns triangles and links between samples whose Voronoi cells touch. `rings` receives the neighbors of each
/// sample, without neighbors across a gap.
Surface voronoi_surface(const Surface& mesh, Matrix<const double> vertices, const Samples& samples,
                        std::vector<std::vector<std::int32_t>>& rings);

/// Returns for every vertex (V) the weights of the samples around it, by moving least squares. The weights reproduce
/// linear functions of position.
std::vector<Around> linear_fits(Matrix<const double> vertices, const Samples& samples,
                                const std::vector<std::vector<std::int32_t>>& rings, int threads);

}  // namespace dfd
