#pragma once

#include "dfd/common/matrix.hpp"
#include "dfd/common/poll.hpp"
#include "dfd/kernels/kernels.hpp"

#include <cstdint>
#include <span>

namespace dfd {

/// The features of a shape's vertices, as `bind` reads them.
struct Features {
    enum class Layout {
        rows,    // (V, D) float, row-major
        halves,  // (B, D, 16) float16: blocks of 16 vertices side by side, the last one padded
        bytes,   // (B, D / 4 + 1, 16, 4): entries + 128 as uint8, four by four, then the squared length as int32
    };

    Layout layout = Layout::rows;
    const void* data = nullptr;
    std::size_t vertex_count = 0;
    std::size_t dimension = 0;  // D, a multiple of 4 for bytes
    float scale = 1;            // what one step of a byte is worth
};

/// Handles or fixed points: feature rows of their own, or vertices of the shape.
struct Points {
    Matrix<const float> rows = {};                // (N, D); for bytes whole numbers of steps within ±127
    std::span<const float> offsets = {};          // (N) squared distance >= 0 that the stored dimensions miss, or empty
    std::span<const std::int64_t> vertices = {};  // (N) in place of rows
    std::span<const std::uint32_t> members = {};  // (H) the number of consecutive points of each handle; a handle of
                                                  // several is a region. Empty if every point is a handle

    std::size_t count() const { return vertices.empty() ? rows.rows : vertices.size(); }
    std::size_t handle_count() const { return members.empty() ? count() : members.size(); }
};

/// The reach of a handle in feature space, and its falloff.
struct Extent {
    float reach = 1;  // > 0
    Falloff falloff = Falloff::linear;
};

/// Fixed points of Eq. (6), the geodesic falloff of Eq. (7), and reach and falloff of the handles.
struct Constraints {
    Points fixed = {};                       // (P) or empty
    Matrix<const float> geodesic = {};       // (H, V) in [0, 1], or empty
    std::span<const float> locality = {};    // (H) exponents >= 0; empty without `geodesic`
    std::span<const float> strengths = {};   // (P) of the fixed points, in [0, 1]; empty for 1
    std::span<const Extent> extents = {};    // (H); empty for reach 1 and a linear falloff, as in the paper
};

/// Weights of every vertex for every handle by Eq. (4-7), in one pass over the features.
///
/// The weight at distance d is f(max(1 - d / r, 0)) for reach r and falloff f. Then the largest product of weight and
/// strength of the fixed points is subtracted, and the geodesic falloff is multiplied last.
///
/// The bits do not depend on the number of threads, on the index of a row, or on other handles.
///
/// @param weights  (V, H) result, overwritten
/// @throws std::invalid_argument if shapes disagree, a value is not finite, a distance, exponent, strength, reach or
///         vertex out of range, a region empty, or a vertex twice among handles that are single points
/// @throws Stopped if `poll` returned true
void bind(const Features& features, const Points& handles, const Constraints& constraints,
          const StridedMatrix<float>& weights, int threads, const Kernels& kernels, const Poll& poll = {});

}  // namespace dfd
