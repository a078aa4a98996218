#pragma once

#include "dfd/pose.hpp"

namespace dfd {

/// The gradients of a number L that depends on posed vertices. Only `posed` is required; empty results are not computed.
template <class T>
struct PoseGradients {
    Matrix<const T> posed;             // (V, 3) gradient of L with respect to the posed vertices
    Matrix<T> vertices;                // (V, 3) result: the gradient with respect to the vertices
    StridedMatrix<T> weights;          // (V, H) result
    std::span<Affine> transforms = {}; // (H) result
    Affine* rest = nullptr;            // result: the gradient with respect to D_0
};

/// Computes the gradients of a linear `pose` without `base`, `normals` and `mixing`; `arrays.posed` is not used.
///
/// The results have the same bits for any number of threads. Where the sum of the weights is exactly 1, the gradients
/// are those for smaller sums. The side of a handle and, without a band, that of a vertex count as constant.
/// @throws std::invalid_argument if array shapes disagree, or a transform is not finite
/// @throws Stopped if `poll` returned true
template <class T>
void pose_gradients(const PoseArrays<T>& arrays, const Motion& motion, const PoseGradients<T>& gradients, int threads,
                    const Kernels& kernels, const Poll& poll = {});

extern template void pose_gradients(const PoseArrays<float>&, const Motion&, const PoseGradients<float>&, int,
                                    const Kernels&, const Poll&);
extern template void pose_gradients(const PoseArrays<double>&, const Motion&, const PoseGradients<double>&, int,
                                    const Kernels&, const Poll&);

}  // namespace dfd
