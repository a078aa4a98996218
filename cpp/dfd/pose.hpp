#pragma once

#include "dfd/common/matrix.hpp"
#include "dfd/common/poll.hpp"
#include "dfd/kernels/kernels.hpp"

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

/// How handles move a shape.
struct Motion {
    std::span<const Affine> transforms;  // (H) D_k
    Affine rest;                         // D_0, which takes what the weights leave of 1
    std::optional<Mirror> mirror;
    Overlap overlap = Overlap::add;
    Blend blend = Blend::linear;
    std::span<const std::array<double, 3>> places = {};  // (H) where handles stand, for other blends than linear
    std::span<const double> mixing = {};  // (H, H) row-major: the weights are multiplied by it; empty for the identity
};

/// The arrays of one pose; all but `vertices`, `weights` and `posed` may be empty.
template <class T>
struct PoseArrays {
    Matrix<const T> vertices;             // (V, 3) mesh units
    StridedMatrix<const float> weights;   // (V, H) unitless
    Matrix<T> posed;                      // (V, 3) result, overwritten; overlaps no input
    Matrix<const T> base;                 // (V, 3) what the handles' displacements are added to, in place of Eq. (1)'s rest
    Matrix<const T> normals;              // (V, 3)
    Matrix<T> posed_normals;              // (V, 3) unit length, turned by the cofactors of each blended transform
};

/// Vertices moved by the blended transforms of Eq. (1), mirrored across a plane by Eq. (8) when one is given.
///
/// A vertex moves by blended displacements, taken about a point of the mesh, so nothing is lost to a far origin, and
/// transforms that are the identity leave every vertex as it is, to the bit, unless `overlap` scales it.
///
/// Dual quaternions blend each transform as a stretch about the handle's place and a rigid motion after it. D_0 stands
/// at the first vertex. They do not scale a vertex whose weights pass 1: `paper` is `normalize` there.
///
/// @throws std::invalid_argument if shapes disagree, or a value is not finite or too large for T
/// @throws Stopped if `poll` returned true
template <class T>
void pose(const PoseArrays<T>& arrays, const Motion& motion, int threads, const Kernels& kernels,
          const Poll& poll = {});

extern template void pose(const PoseArrays<float>&, const Motion&, int, const Kernels&, const Poll&);
extern template void pose(const PoseArrays<double>&, const Motion&, int, const Kernels&, const Poll&);

}  // namespace dfd
