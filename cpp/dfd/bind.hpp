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
        halves,  // (B, D, 16) float16: blocks of 16 vertices; the last block is padded
        bytes,   // (B, D / 4 + 1, 16, 4) uint8: int8 entries + 128, then the squared length of each vertex as int32
    };

    Layout layout = Layout::rows;
    const void* data = nullptr;
    std::size_t vertex_count = 0;
    std::size_t dimension = 0;  // D, a multiple of 4 for bytes
    float scale = 1;            // for bytes: a byte b stands for the feature entry (b - 128) * scale
};

/// Handles or fixed points, given as feature rows or as vertices of the shape.
struct Points {
    Matrix<const float> rows = {};                // (N, D) features; for bytes, feature / scale as integers -127 … 127
    std::span<const float> offsets = {};          // (N) >= 0, added to squared distances to a row; empty if all are 0
    std::span<const std::int64_t> vertices = {};  // (N) vertex indices, given instead of `rows`
    std::span<const std::uint32_t> members = {};  // (H) number of consecutive points of each handle; a region has
                                                  // several. Empty if each point is a handle

    std::size_t count() const { return vertices.empty() ? rows.rows : vertices.size(); }
    std::size_t handle_count() const { return members.empty() ? count() : members.size(); }
};

/// The reach of a handle in feature space, and the falloff of its weights (see `Falloff`).
struct Extent {
    float reach = 1;  // > 0
    Falloff falloff = Falloff::linear;
};

/// The fixed points of Eq. (6), the geodesic falloff of Eq. (7), and the reach and falloff of the handles.
struct Constraints {
    Points fixed = {};                       // (P) points, or empty
    Matrix<const float> geodesic = {};       // (H, V) distances along the surface in [0, 1], or empty
    std::span<const float> locality = {};    // (H) exponents λ >= 0; empty without `geodesic`
    std::span<const float> strengths = {};   // (P) strengths of the fixed points in [0, 1]; empty if all are 1
    std::span<const Extent> extents = {};    // (H); empty for reach 1 and a linear falloff, as in the paper
};

/// Computes the weight of each vertex for each handle by Eq. (4-7), in one pass over the features.
///
/// For feature distance d, reach r and falloff f, the weight is first f(max(1 - d / r, 0)). A fixed point of strength s
/// at feature distance d_p has the value s max(1 - d_p, 0). The largest value of all fixed points is subtracted from
/// the weight, and a negative result becomes 0. Finally, the result is multiplied by (1 - g)^λ, for geodesic distance g
/// and locality λ. All bits of a weight are independent of the thread count, the vertex index and the other handles.
/// @param weights  (V, H) result, overwritten
/// @throws std::invalid_argument if array shapes disagree, a value is not finite, or a region is empty
/// @throws std::invalid_argument if a distance, exponent, strength, reach or vertex is out of range, or `members` is
///         empty and two handles are the same vertex
/// @throws Stopped if `poll` returned true
void bind(const Features& features, const Points& handles, const Constraints& constraints,
          const StridedMatrix<float>& weights, int threads, const Kernels& kernels, const Poll& poll = {});

}  // namespace dfd
