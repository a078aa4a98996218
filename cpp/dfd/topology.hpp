#pragma once

#include "dfd/common/matrix.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dfd {

/// Returns the component index of each vertex, (V). Indices follow the order of the components' first vertices.
/// @param faces (F, 3) vertex indices
/// @param links (L, 2) further pairs of connected vertices
/// @throws std::invalid_argument if an index is out of range
std::vector<std::int32_t> components(std::size_t vertex_count, Matrix<const std::int32_t> faces,
                                     Matrix<const std::int32_t> links);

/// Writes two sizes of each face to `out` (F, 2): the longest side, in units of `vertices` (V, 3), and the area.
/// @throws std::invalid_argument if array shapes disagree or an index is out of range
void face_sizes(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<double> out, int threads);

/// Writes three sizes of each piece of a surface to `out` (P, 3): its area, the area of faces that are not `flipped`
/// minus that of others, and the volume below the surface after the `flipped` faces are reversed. The volume is that of
/// the tetrahedra of all faces and the centroid of the piece; it is above 0 if faces look away from the centroid.
/// @param piece    (F, 1) the piece of each face
/// @param flipped  (F, 1) 1 or 0
/// @throws std::invalid_argument if array shapes disagree or an index is out of range
void piece_sizes(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> piece,
                 Matrix<const std::int32_t> flipped, Matrix<double> out);

}  // namespace dfd
