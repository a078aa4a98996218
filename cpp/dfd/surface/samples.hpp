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

/// Samples, at least `spacing` apart along the surface. The nearest sample of a vertex is called its owner.
struct Samples {
    std::vector<std::int32_t> vertices;  // (K) the vertex of each sample
    std::vector<std::int32_t> owner;     // (V) the sample in whose Voronoi cell the vertex lies
    std::vector<float> to_owner;         // (V) distance from each vertex to its owner, at most `spacing`
    double spacing = 0;
};

/// The samples from which the value at a vertex is interpolated, and their weights.
struct SampleFit {
    static constexpr std::size_t count = 8;
    std::array<std::int32_t, count> samples;
    std::array<float, count> weights;  // sum 1
};

/// Returns the surface of `faces` (F, 3) and `links` (L, 2), with lengths from `vertices` (V, 3).
Surface surface_of(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> links);

/// Returns about `count` samples, with about equal spacing.
Samples take_samples(const Surface& mesh, Matrix<const double> vertices, std::size_t count);

/// Returns a surface whose vertices are the samples. Its triangles and links join samples whose Voronoi cells touch.
/// `rings` receives the neighbors of each sample on the surface. It does not get neighbors across a gap.
Surface voronoi_surface(const Surface& mesh, Matrix<const double> vertices, const Samples& samples,
                        std::vector<std::vector<std::int32_t>>& rings);

/// Returns the moving-least-squares weights of the samples around each vertex, (V). Interpolation with these weights is
/// nearly exact for linear functions of position.
std::vector<SampleFit> linear_fits(Matrix<const double> vertices, const Samples& samples,
                                   const std::vector<std::vector<std::int32_t>>& rings, int threads);

}  // namespace dfd
