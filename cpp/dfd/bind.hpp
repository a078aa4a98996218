#pragma once

#include "dfd/common/matrix.hpp"
#include "dfd/common/poll.hpp"
#include "dfd/kernels/kernels.hpp"

#include <cstdint>
#include <span>

namespace dfd {

/// The features of a shape's vertices, in the layouts that `bind` reads.
struct Features {
    enum class Layout {
        rows,    // (V, D) float, row-major
        halves,  // (B, D, 16) float16: blocks of 16 vertices, the last block padded
        bytes,   // (B, D / 4 + 1, 16, 4): entries + 128 as uint8 in quads, then the squared length as int32
    };

    Layout layout = Layout::rows;
    const void* data = nullptr;
    std::size_t vertex_count = 0;
    std::size_t dimension = 0;  // D, a multiple of 4 for bytes
    float scale = 1;            // step: the feature value of 1 in a byte
};

/// Handles or fixed points, given as feature rows or as vertices of the shape.
struct Points {
    Matrix<const float> rows = {};                // (N, D); for bytes, whole numbers of steps within ±127
    std::span<const float> offsets = {};          // (N) squared distances >= 0 that stored rows miss, or empty
    std::span<const std::int64_t> vertices = {};  // (N) in place of rows
    std::span<const std::uint32_t> members = {};  // (H) number of consecutive points of each handle, a region if above
                                                  // 1; empty if each point is a handle

    std::size_t count() const { return vertices.empty() ? rows.rows : vertices.size(); }
    std::size_t handle_count() const { return members.empty() ? count() : members.size(); }
};

/// The reach of a handle in feature space, and its falloff.
struct Extent {
    float reach = 1;  // > 0
    Falloff falloff = Falloff::linear;
};

/// The fixed points of Eq. (6), the geodesic falloff of Eq. (7), and the reach and falloff of the handles.
struct Constraints {
    Points fixed = {};                       // (P) or empty
    Matrix<const float> geodesic = {};       // (H, V) in [0, 1], or empty
    std::span<const float> locality = {};    // (H) exponents >= 0; empty without `geodesic`
    std::span<const float> strengths = {};   // (P) of the fixed points, in [0, 1]; empty for 1
    std::span<const Extent> extents = {};    // (H); empty for reach 1 and a linear falloff, as in the paper
};

/// Computes the weight of each vertex for each handle by Eq. (4-7), in one pass over the features.
///
/// The weight at feature distance d is f(max(1 - d / r, 0)) for reach r and falloff f. Then the largest product of
/// weight and strength over the fixed points is subtracted. Then the result is multiplied by the geodesic falloff.
///
/// A weight is the same to the bit for any number of threads, any index of the vertex and any other handles.
///
/// @param weights  (V, H) result, overwritten
/// @throws std::invalid_argument if shapes disagree, a value is not finite, or a region is empty
/// @throws std::invalid_argument if a distance, exponent, strength, reach or vertex is out of range, or
///         single-point handles repeat a vertex
/// @throws Stopped if `poll` returned true
void bind(const Features& features, const Points& handles, const Constraints& constraints,
          const StridedMatrix<float>& weights, int threads, const Kernels& kernels, const Poll& poll = {});

}  // namespace dfd
