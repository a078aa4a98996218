#pragma once

#include "dfd/common/matrix.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace dfd {

/// Distances along a surface from any of its vertices, the source. The constructor prepares data for all sources.
///
/// A front propagates from vertex to vertex in order of distance. The distance of a triangle's third corner is computed
/// from those of the other two corners, as if the source were a point in the triangle's plane. This is exact on flat
/// surfaces. (M. Novotni, R. Klein, "Computing geodesic distances on triangular meshes", WSCG 2002)
///
/// On a large mesh, the front propagates over samples: vertices with about equal spacing. Samples whose Voronoi cells
/// touch are joined. The distance of another vertex is interpolated from the samples around it (moving least squares).
/// Near the source, the front propagates over the mesh itself.
class Geodesics {
public:
    /// @param vertices (V, 3) finite positions; the size of the mesh must be about 1
    /// @param faces (F, 3) vertex indices; nonmanifold edges, repeated faces and faces without area are valid
    /// @param links (L, 2) pairs of vertices that are joined by a straight line
    /// @param sample_count approximate number of samples; if V is at most twice this number, all vertices are samples
    /// @throws std::invalid_argument if array shapes disagree, an index is out of range or a value is not finite
    Geodesics(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> links,
              std::size_t sample_count, int threads);
    ~Geodesics();

    std::size_t vertex_count() const;

    /// Approximately the largest distance between two connected vertices, in units of `vertices`.
    double extent() const;

    /// Writes to `out` (H, at most V) the distances from each of `sources` (H) to the first `out.columns` vertices.
    /// Distances are divided by `extent` and then limited to 1. Vertices not connected to the source get `separate`.
    /// @throws std::invalid_argument if a source is out of range or `out` has another array shape
    void distances(std::span<const std::int64_t> sources, float separate, Matrix<float> out, int threads) const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace dfd
