#pragma once

// Activations of a field's network: (neurons, 48), the points of a unit side by side in their lanes.

#include "dfd/kernels/simd.hpp"

namespace dfd {
namespace {

constexpr std::size_t row = field_points;  // floats from one neuron's activations to the next one's

struct Moments {
    Float mean, factor;  // and 1 / sqrt(variance + 1e-5)
};

// What a LayerNorm needs of each of a vector of points, over their neurons.
DFD_INLINE Moments moments_of(const float* values, std::size_t neurons)
{
    const Float share = splat(1.0f / static_cast<float>(neurons));
    Float sum{}, squares{};
    for (std::size_t k = 0; k < neurons; ++k) sum += load<Float>(values + k * row);
    const Float mean = sum * share;
    for (std::size_t k = 0; k < neurons; ++k) {
        const Float difference = load<Float>(values + k * row) - mean;
        squares = multiply_add(difference, difference, squares);
    }
    return {mean, splat(1.0f) / sqrt(squares * share + splat(1e-5f))};
}

}  // namespace
}  // namespace dfd
