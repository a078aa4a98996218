#pragma once

#include "dfd/matrix.hpp"

#include <array>
#include <optional>
#include <span>

namespace dfd {

/// An affine transform: three rows of (linear | translation), mesh units.
using Affine = std::array<double, 12>;

/// The plane {p : normal·p = offset} of Eq. (8) and what each handle does on either side of it.
struct Mirror {
    std::array<double, 3> normal;        // unit length
    double offset;                       // mesh units
    double band;                         // half width over which the sides blend, mesh units; 0 switches at the plane
    std::span<const bool> positive;      // (H) whether a handle stands on the positive side
};

/// Vertices moved by the blended transforms of Eq. (1), mirrored across a plane by Eq. (8) when one is given.
///
/// A vertex moves by blended displacements, taken about a point of the mesh, so nothing is lost to a far origin.
///
/// @param vertices    (V, 3) row-major, mesh units
/// @param weights     (V, H) row-major, unitless
/// @param transforms  (H) affine transforms D_k
/// @param rest        D_0, which takes what the weights leave
/// @param posed       (V, 3) result, overwritten; must not overlap `vertices`
/// @throws std::invalid_argument if shapes disagree, or a value is not finite or too large for T
template <class T>
void pose(Matrix<const T> vertices, Matrix<const float> weights, std::span<const Affine> transforms,
          const Affine& rest, const std::optional<Mirror>& mirror, Matrix<T> posed, int threads);

extern template void pose(Matrix<const float>, Matrix<const float>, std::span<const Affine>, const Affine&,
                          const std::optional<Mirror>&, Matrix<float>, int);
extern template void pose(Matrix<const double>, Matrix<const float>, std::span<const Affine>, const Affine&,
                          const std::optional<Mirror>&, Matrix<double>, int);

}  // namespace dfd
