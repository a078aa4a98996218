#pragma once

#include "dfd/kernels/kernels.hpp"
#include "dfd/matrix.hpp"

#include <cstdint>
#include <span>
#include <variant>

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

    std::size_t count() const { return vertices.empty() ? rows.rows : vertices.size(); }
};

/// Geodesic distances (H, V) in [0, 1], as float or as the bits of float16; may be empty.
using Geodesic = std::variant<Matrix<const float>, Matrix<const std::uint16_t>>;

/// What narrows the weights of Eq. (4-5): fixed points of Eq. (6) and the geodesic falloff of Eq. (7).
struct Constraints {
    Points fixed;                      // may be empty
    Geodesic geodesic;
    std::span<const float> locality;   // (H) exponents >= 0; empty without `geodesic`
};

/// Weights of every vertex for every handle by Eq. (4-7), in one pass over the features.
///
/// The same bits come out for every number of threads, for equal rows wherever they stand, and for a handle alone or
/// among others.
///
/// @param weights  (V, H) result, overwritten
/// @throws std::invalid_argument if shapes disagree, a value is not finite, a distance, exponent or vertex out of range,
///         or a vertex twice among the handles
void bind(const Features& features, const Points& handles, const Constraints& constraints,
          const StridedMatrix<float>& weights, int threads, const Kernels& kernels);

}  // namespace dfd
