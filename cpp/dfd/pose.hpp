#pragma once

#include "dfd/common/matrix.hpp"
#include "dfd/common/poll.hpp"
#include "dfd/kernels/kernels.hpp"

#include <array>
#include <optional>
#include <span>

namespace dfd {

/// An affine transform (3, 4), row-major: three columns of the linear part, then the translation in mesh units.
using Affine = std::array<double, 12>;

using Vector3d = std::array<double, 3>;

/// A transform as a stretch p ↦ S p + s, then twice the rigid motion p ↦ R p + r, and then a translation. R is half of
/// the rotation, so a blend of rotations is continuous up to 720°.
struct Polar {
    std::array<double, 4> rotation;  // unit quaternion w, x, y, z of R
    Vector3d shift;                  // r, mesh units
    std::array<double, 6> stretch;   // S - I: xx, yy, zz, yz, zx, xy
    Vector3d stretch_shift;          // s, mesh units
    Vector3d translation;            // mesh units
};

/// The mirror plane {p : normal·p = offset} of Eq. (8), and the side of each handle.
struct Mirror {
    Vector3d normal;                 // unit length
    double offset;                   // mesh units
    double band;                     // half width of the band in which the two sides are blended, mesh units; may be 0
    std::span<const bool> positive;  // (H) whether each handle is on the side to which the normal points
};

/// Transforms, and the way in which they are blended.
struct Motion {
    std::span<const Affine> transforms;  // (H) D_k
    Affine rest;                         // default transform D_0, with the weight max(1 - sum of all weights, 0)
    std::optional<Mirror> mirror;
    Overlap overlap = Overlap::add;
    Blend blend = Blend::linear;
    // polar: needed for dual quaternions: `transforms`, with a mirror plane their mirror images, and `rest`;
    // (H + 1), or (2 H + 1) with a mirror plane
    std::span<const Polar> polar = {};
    std::span<const double> mixing = {};    // (H, H) row-major; if given, `weights` · `mixing` replaces `weights`
};

/// The arrays of one pose. Only `vertices`, `weights` and `posed` are required; the others may be empty.
template <class T>
struct PoseArrays {
    Matrix<const T> vertices;            // (V, 3) mesh units
    StridedMatrix<const float> weights;  // (V, H) unitless
    Matrix<T> posed;                     // (V, 3) result, overwritten; must not overlap an input
    Matrix<const T> base;                // (V, 3) positions to which displacements are added, instead of to `vertices`
    Matrix<const T> normals;             // (V, 3)
    Matrix<T> posed_normals;             // (V, 3) result: unit normals of the posed surface
};

/// Moves vertices by the blended transforms of Eq. (1), and of Eq. (8) if `motion.mirror` is set.
///
/// Coordinates are taken relative to the first vertex, so the result is precise even far from the origin. If all
/// transforms are the identity, vertices keep all bits. With overlap `paper`, their weights must also sum to at most 1.
///
/// With dual quaternions, the parts of `Motion::polar` are blended. Overlap `paper` has the effect of `normalize`.
/// @throws std::invalid_argument if array shapes disagree, or a value is not finite or too large for T
/// @throws Stopped if `poll` returned true
template <class T>
void pose(const PoseArrays<T>& arrays, const Motion& motion, int threads, const Kernels& kernels,
          const Poll& poll = {});

extern template void pose(const PoseArrays<float>&, const Motion&, int, const Kernels&, const Poll&);
extern template void pose(const PoseArrays<double>&, const Motion&, int, const Kernels&, const Poll&);

}  // namespace dfd
