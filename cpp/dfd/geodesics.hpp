#pragma once

#include "dfd/common/matrix.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace dfd {

/// Distances along a surface from any of its vertices, after one preparation.
///
/// A wave runs from vertex to vertex in order of distance. Within a triangle the wave of two corners reaches the third
/// as from a point source in the triangle's plane (M. Novotni, R. Klein, "Computing geodesic distances on triangular
/// meshes", WSCG 2002), which is exact on flat ground. On a large mesh it runs over samples about equally far from each
/// other, joined as their Voronoi cells touch, and near its source over the mesh itself; every vertex takes a linear
/// fit of the samples around it (moving least squares).
class Geodesics {
public:
    /// @param vertices (V, 3) finite, of a size of about 1
    /// @param faces (F, 3) vertex indices; any: edges of many faces, repeated faces and faces without area too
    /// @param links (L, 2) pairs of vertices that are joined by a straight line
    /// @param sample_count how many samples to aim at; where there are not twice as many vertices, all are samples
    /// @throws std::invalid_argument if shapes disagree, an index is out of range or a value is not finite
    Geodesics(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> links,
              std::size_t sample_count, int threads);
    ~Geodesics();

    std::size_t vertex_count() const;
    std::size_t sample_count() const;

    /// About the largest distance between two vertices that are joined, in units of `vertices`.
    double extent() const;

    /// Distances over `extent`, at most 1, from each of `sources` (H), of the first `out.columns` vertices, to
    /// `out` (H, at most V); `separate` where no way leads.
    ///
    /// @throws std::invalid_argument if a source is out of range or `out` has another shape
    void distances(std::span<const std::int64_t> sources, float separate, Matrix<float> out, int threads) const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace dfd
