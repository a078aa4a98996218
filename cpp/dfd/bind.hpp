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
    std::span<const std::uint32_t> members = {};  // (H) how many of them, one after another, are a handle that is a
                                                  // region and weighs by the nearest; empty where each is a handle

    std::size_t count() const { return vertices.empty() ? rows.rows : vertices.size(); }
    std::size_t handle_count() const { return members.empty() ? count() : members.size(); }
};

/// How far a handle reaches in feature space, and how it falls off until there.
struct Extent {
    float reach = 1;  // > 0
    Falloff falloff = Falloff::linear;
};

/// What shapes the weights of Eq. (4-5): fixed points of Eq. (6), the geodesic falloff of Eq. (7), and reach.
struct Constraints {
    Points fixed = {};                       // (P) or empty
    Matrix<const float> geodesic = {};       // (H, V) in [0, 1], or empty
    std::span<const float> locality = {};    // (H) exponents >= 0; empty without `geodesic`
    std::span<const float> strengths = {};   // (P) how much each fixed point holds, in [0, 1]; empty for 1
    std::span<const Extent> extents = {};    // (H); empty for the paper's
};

/// Weights of every vertex for every handle by Eq. (4-7), in one pass over the features.
///
/// A handle of reach r weighs f(max(1 - d / r, 0)) at distance d, f being its falloff; fixed points then take away the
/// largest of their weights times their strengths, and the geodesic falloff comes last.
///
/// The same bits come out for every number of threads, for equal rows wherever they stand, and for a handle alone or
/// among others.
///
/// @param weights  (V, H) result, overwritten
/// @throws std::invalid_argument if shapes disagree, a value is not finite, a distance, exponent, strength, reach or
///         vertex out of range, a region empty, or a vertex twice among handles that are single points
/// @throws Stopped if `poll` returned true
void bind(const Features& features, const Points& handles, const Constraints& constraints,
          const StridedMatrix<float>& weights, int threads, const Kernels& kernels, const Poll& poll = {});

}  // namespace dfd
