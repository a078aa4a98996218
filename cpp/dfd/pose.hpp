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

/// The plane {p : normal·p = offset} of Eq. (8) and the side of each handle.
struct Mirror {
    std::array<double, 3> normal;        // unit length
    double offset;                       // mesh units
    double band;                         // half width of the blend band at the plane, mesh units; 0 is a hard cut
    std::span<const bool> positive;      // (H) whether a handle is on the positive side
};

/// How handles move a shape.
struct Motion {
    std::span<const Affine> transforms;  // (H) D_k
    Affine rest;                         // D_0, whose weight is the remainder of 1
    std::optional<Mirror> mirror;
    Overlap overlap = Overlap::add;
    Blend blend = Blend::linear;
    std::span<const std::array<double, 3>> places = {};  // (H) positions of the handles, for other blends than linear
    std::span<const double> mixing = {};  // (H, H) row-major factor of the weights; empty for the identity
};

/// The arrays of one pose; all but `vertices`, `weights` and `posed` may be empty.
template <class T>
struct PoseArrays {
    Matrix<const T> vertices;             // (V, 3) mesh units
    StridedMatrix<const float> weights;   // (V, H) unitless
    Matrix<T> posed;                      // (V, 3) result, overwritten; overlaps no input
    Matrix<const T> base;                 // (V, 3) replaces Eq. (1)'s rest positions as the base of displacements
    Matrix<const T> normals;              // (V, 3)
    Matrix<T> posed_normals;              // (V, 3) unit length, transformed by the cofactors of the blended transform
};

/// Moves vertices by the blended transforms of Eq. (1), mirrored across a plane by Eq. (8) if `motion.mirror` is set.
///
/// A vertex moves by blended displacements about a point of the mesh, so a far origin costs no precision. Identity
/// transforms leave the bits of every vertex unchanged, unless `overlap` scales the vertex.
///
/// Dual quaternions blend each transform as a stretch about the handle's position, then a rigid motion. The position of
/// D_0 is the first vertex. Dual quaternions do not scale a vertex whose weights exceed 1: `paper` acts as `normalize`.
///
/// @throws std::invalid_argument if shapes disagree, or a value is not finite or too large for T
/// @throws Stopped if `poll` returned true
template <class T>
void pose(const PoseArrays<T>& arrays, const Motion& motion, int threads, const Kernels& kernels,
          const Poll& poll = {});

extern template void pose(const PoseArrays<float>&, const Motion&, int, const Kernels&, const Poll&);
extern template void pose(const PoseArrays<double>&, const Motion&, int, const Kernels&, const Poll&);

}  // namespace dfd
