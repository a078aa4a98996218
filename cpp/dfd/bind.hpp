#pragma once

#include "dfd/matrix.hpp"

#include <span>

namespace dfd {

/// What narrows the weights of Eq. (4-5): fixed points of Eq. (6) and the geodesic falloff of Eq. (7).
struct Constraints {
    Matrix<const float> fixed;         // (P, D) feature rows, may be empty
    Matrix<const float> geodesic;      // (H, V) distances in [0, 1], may be empty
    std::span<const float> locality;   // (H) exponents >= 0; empty without `geodesic`
};

/// Weights of every vertex for every handle by Eq. (4-7).
///
/// @param features  (V, D) row-major, unit rows by convention, taken as they are
/// @param handles   (H, D) feature rows of the handles
/// @param weights   (V, H) result, overwritten
/// @throws std::invalid_argument if shapes disagree, a value is not finite, or a distance or exponent out of range
void bind(Matrix<const float> features, Matrix<const float> handles, const Constraints& constraints,
          Matrix<float> weights, int threads);

}  // namespace dfd
