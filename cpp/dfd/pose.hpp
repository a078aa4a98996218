#pragma once

#include "dfd/common/matrix.hpp"
#include "dfd/common/poll.hpp"
#include "dfd/kernels/kernels.hpp"

#include <array>
#include <optional>
#include <span>

namespace dfd {

/// An affine transform: three rows of (linear | translation), in mesh units.
using Affine = std::array<double, 12>;

/// The mirror plane {p : normal·p = offset} of Eq. (8), and the side of each handle.
struct Mirror {
    std::array<double, 3> normal;    // unit length
    double offset;                   // mesh units
    double band;                     // half width of the band in which both sides are blended, mesh units; may be 0
    std::span<const bool> positive;  // (H) whether a handle is on the side to which the normal points
};

/// Transforms, and the way in which they are blended.
struct Motion {
    std::span<const Affine> transforms;  // (H) D_k
    Affine rest;                         // D_0, whose weight is 1 less the sum of all weights
    std::optional<Mirror> mirror;
    Overlap overlap = Overlap::add;
    Blend blend = Blend::linear;
    std::span<const std::array<double, 3>> places = {};  // (H) positions of the handles, for dual quaternions
    std::span<const double> mixing = {};  // (H, H) row-major factor of the weights; empty for the identity
};

/// The arrays of one pose; all but `vertices`, `weights` and `posed` may be empty.
template <class T>
struct PoseArrays {
    Matrix<const T> vertices;            // (V, 3) mesh units
    StridedMatrix<const float> weights;  // (V, H) unitless
    Matrix<T> posed;                     // (V, 3) result, overwritten; must not overlap an input
    Matrix<const T> base;                // (V, 3) to which displacements are added in place of `vertices`
    Matrix<const T> normals;             // (V, 3)
    Matrix<T> posed_normals;             // (V, 3) unit length, transformed by the cofactors of the blended transform
};

/// Moves vertices by the blended transforms of Eq. (1), and of Eq. (8) if `motion.mirror` is set.
///
/// Displacements are computed about a vertex of the mesh, so a distant origin costs no precision. Identity transforms
/// leave a vertex unchanged to the bit, unless `overlap` scales the vertex.
///
/// For dual quaternions, a transform is divided into a stretch about the handle's position and a rigid motion. The
/// position of D_0 is the first vertex. Overlap `paper` is the same as `normalize`.
///
/// @throws std::invalid_argument if shapes disagree, or a value is not finite or too large for T
/// @throws Stopped if `poll` returned true
template <class T>
void pose(const PoseArrays<T>& arrays, const Motion& motion, int threads, const Kernels& kernels,
          const Poll& poll = {});

extern template void pose(const PoseArrays<float>&, const Motion&, int, const Kernels&, const Poll&);
extern template void pose(const PoseArrays<double>&, const Motion&, int, const Kernels&, const Poll&);

}  // namespace dfd
