#pragma once

// Samples of a large surface: few vertices about equally far from each other, the surface that they make, and how the
// other vertices take values from them.

#include "dfd/surface/march.hpp"
#include "dfd/common/matrix.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace dfd {

/// Vertices at least `spacing` apart along the surface, and for every vertex the nearest of them.
struct Samples {
    std::vector<std::int32_t> vertices;  // (K)
    std::vector<std::int32_t> owner;     // (V) the sample, as an index into `vertices`, in whose Voronoi cell it lies
    std::vector<float> to_owner;         // (V) distance to it, at most `spacing`
    double spacing = 0;
};

/// A vertex's value as a blend of samples'.
struct Around {
    static constexpr std::size_t count = 8;
    std::array<std::int32_t, count> samples;
    std::array<float, count> weights;  // sum 1
};

Surface surface_of(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> links);

/// About `count` samples, more where edges are long.
Samples take_samples(const Surface& mesh, Matrix<const double> vertices, std::size_t count);

/// Triangles and links between samples whose Voronoi cells touch; `rings` gets the neighbors of each sample that are
/// not beyond a gap.
Surface voronoi_surface(const Surface& mesh, Matrix<const double> vertices, const Samples& samples,
                        std::vector<std::vector<std::int32_t>>& rings);

/// For every vertex (V) the weights of the samples around it that give back linear functions of space: moving least
/// squares.
std::vector<Around> linear_fits(Matrix<const double> vertices, const Samples& samples,
                                const std::vector<std::vector<std::int32_t>>& rings, int threads);

}  // namespace dfd
