#pragma once

// Products of matrices, in tiles that fill the registers.

#include "dfd/kernels/tile.hpp"

namespace dfd {
namespace {

#if defined(__AVX512F__)
constexpr std::size_t tile_rows = 6, tile_vectors = 4;
#elif defined(__AVX2__)
constexpr std::size_t tile_rows = 6, tile_vectors = 2;
#else
constexpr std::size_t tile_rows = 4, tile_vectors = 2;
#endif
constexpr std::size_t tile_columns = tile_vectors * lanes<float>;

constexpr std::size_t up_to(std::size_t count, std::size_t whole) { return (count + whole - 1) / whole * whole; }

// The right factor of a product lies in panels of `tile_columns` columns: (panels, depths, columns), the last one filled
// up with zeros. Here of a matrix whose entry (d, c) is `at(d, c)`.
template <class At>
void pack(std::size_t depths, std::size_t columns, const At& at, float* panels)
{
    for (std::size_t begin = 0; begin < columns; begin += tile_columns)
        for (std::size_t d = 0; d < depths; ++d)
            for (std::size_t c = begin; c < begin + tile_columns; ++c) *panels++ = c < columns ? at(d, c) : 0.0f;
}

// Sums of one tile: `tile_rows` rows of the left factor, `stride` floats apart, times a panel.
template <class Done>
DFD_INLINE void multiply_tile(const float* rows, std::size_t stride, const float* panel, std::size_t depths,
                              const Done& done)
{
    Float sums[tile_rows][tile_vectors]{};
    add_products(rows, stride, 1, panel, tile_columns, depths, sums);
#pragma GCC unroll 8
    for (std::size_t r = 0; r < tile_rows; ++r)
#pragma GCC unroll 4
        for (std::size_t v = 0; v < tile_vectors; ++v) done(r, v * lanes<float>, sums[r][v]);
}

// All sums of a product; `count` rows and `columns` are whole tiles. `done(row, column, sums)` takes a vector of them.
template <class Done>
void multiply(const float* rows, std::size_t count, std::size_t stride, const float* panels, std::size_t depths,
              std::size_t columns, const Done& done)
{
    for (std::size_t column = 0; column < columns; column += tile_columns, panels += depths * tile_columns)
        for (std::size_t row = 0; row < count; row += tile_rows)
            multiply_tile(rows + row * stride, stride, panels, depths,
                          [&](std::size_t r, std::size_t c, Float sums) { done(row + r, column + c, sums); });
}

}  // namespace
}  // namespace dfd
