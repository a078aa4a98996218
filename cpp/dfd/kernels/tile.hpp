#pragma once

// What all products are made of: a tile of sums in registers. How large tiles are, each kernel decides for itself.

#include "dfd/kernels/simd.hpp"

namespace dfd {
namespace {

// Adds to each of `Rows` rows of sums the products of a left factor's entries with vectors of a right factor.
template <std::size_t Rows, std::size_t Vectors>
DFD_INLINE void add_products(const float* left, std::size_t row_stride, std::size_t depth_stride, const float* right,
                             std::size_t right_stride, std::size_t depths, Float (&sums)[Rows][Vectors])
{
    for (std::size_t d = 0; d < depths; ++d) {
        Float entries[Vectors];
#pragma GCC unroll 4
        for (std::size_t v = 0; v < Vectors; ++v) entries[v] = load<Float>(right + d * right_stride + v * lanes<float>);
#pragma GCC unroll 8
        for (std::size_t r = 0; r < Rows; ++r) {
            const Float entry = splat(left[r * row_stride + d * depth_stride]);
#pragma GCC unroll 4
            for (std::size_t v = 0; v < Vectors; ++v) sums[r][v] = multiply_add(entry, entries[v], sums[r][v]);
        }
    }
}

}  // namespace
}  // namespace dfd
