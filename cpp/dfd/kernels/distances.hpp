#pragma once

// Squared distances from the features of a block of vertices (a panel) to the feature rows of handles and fixed points.

#include "dfd/kernels/simd.hpp"

namespace dfd {
namespace {

constexpr std::size_t width = lanes<float>;    // number of floats in a vector
constexpr std::size_t parts = vectors<float>;  // number of vectors for one float per vertex of a block
constexpr std::size_t chunk = 128;             // number of terms in a partial sum; short sums have small errors

// For a single handle, bytes are prefetched this far ahead of those that are read. `python -m bench.speed` with 100,000 to
// 1,000,000 vertices chose this number from 0, 2, 4, 8 and 16 KiB, for bytes and for rows of 64 and 384 floats.
constexpr std::size_t single_ahead = 8192;

typedef std::uint32_t Bits __attribute__((vector_size(vector_bytes)));

// One float of each vertex of a block.
struct Block {
    Float part[parts];
};

// Returns the sum of `size` terms in four partial sums, so that no addition waits for the previous one.
template <class Add>
DFD_INLINE Float sum_of(std::size_t size, const Add& add)
{
    Float a{}, b{}, c{}, d{};
    std::size_t k = 0;
    for (; k + 4 <= size; k += 4) {
        a = add(k, a);
        b = add(k + 1, b);
        c = add(k + 2, c);
        d = add(k + 3, d);
    }
    for (; k < size; ++k) a = add(k, a);
    return (a + b) + (c + d);
}

// Returns |a - b|² as |a|² + |b|² - 2 a·b, for `squares` = |a|² + |b|² and `product` = a·b. If rounding could change
// |a - b| by 2e-6, returns `exact()`, which computes |a - b|² from the differences of the entries.
template <class Exact>
DFD_INLINE Float squared_distance(Float squares, Float product, const Exact& exact)
{
    const Float square = multiply_add(splat(-2.0f), product, squares);
    // If `square` is above 0.005 squares², an error of 2e-7 squares changes the distance by less than 2e-6.
    // Above 1 + 1e-6 squares, the weight for a reach of 1 is 0 in spite of such an error.
    const Float bound = minimum(0.005f * squares * squares, 1.0f + 1e-6f * squares);
    const auto far = at_least(square, bound);
    return all(far) ? square : select(far, square, exact());
}

// Returns whether an entry is infinite or NaN.
DFD_INLINE bool any_infinite(Float value)
{
    const Float zero = value - value;
    return !all(equal(zero, zero));
}

// Computes squared distances at the speed of a matrix product.
class FloatPanel {
public:
    FloatPanel(const float* panel, std::size_t dimension) : panel_(panel), dimension_(dimension)
    {
        for (std::size_t part = 0; part < parts; ++part) {
            square_.part[part] = sum_of(dimension, [&](std::size_t k, Float sum) __attribute__((always_inline)) {
                const Float entry = load<Float>(panel + k * block_size + part * width);
                return multiply_add(entry, entry, sum);
            });
        }
    }

    bool suspect() const
    {
        bool found = false;
        for (std::size_t part = 0; part < parts; ++part) found |= any_infinite(square_.part[part]);
        return found;
    }

    template <std::size_t Count>
    DFD_INLINE void squared_distances(const PackedRows& points, std::size_t first, Block* out) const
    {
        const float* rows = points.rows + first / group_size * group_size * dimension_ + first % group_size;
        Float total[Count][parts] = {};
        for (std::size_t start = 0; start < dimension_; start += chunk) {
            const std::size_t end = start + chunk < dimension_ ? start + chunk : dimension_;
            Float sum[Count][parts] = {};
            for (std::size_t k = start; k < end; ++k) {
                Float entry[parts];
                for (std::size_t part = 0; part < parts; ++part)
                    entry[part] = load<Float>(panel_ + k * block_size + part * width);
#pragma GCC unroll 16
                for (std::size_t j = 0; j < Count; ++j) {
                    const Float other = splat(rows[k * group_size + j]);
                    for (std::size_t part = 0; part < parts; ++part)
                        sum[j][part] = multiply_add(entry[part], other, sum[j][part]);
                }
            }
#pragma GCC unroll 16
            for (std::size_t j = 0; j < Count; ++j)
                for (std::size_t part = 0; part < parts; ++part) total[j][part] += sum[j][part];
        }
        for (std::size_t j = 0; j < Count; ++j) {
            for (std::size_t part = 0; part < parts; ++part) {
                const Float squares = square_.part[part] + splat(points.squares[first + j]);
                const Float square = squared_distance(squares, total[j][part], [&]() __attribute__((always_inline)) {
                    return squared_difference(rows + j, part);
                });
                out[j].part[part] = square + splat(points.offsets[first + j]);
            }
        }
    }

private:
    Float squared_difference(const float* row, std::size_t part) const
    {
        return sum_of(dimension_, [&](std::size_t k, Float sum) __attribute__((always_inline)) {
            const Float difference = load<Float>(panel_ + k * block_size + part * width) - splat(row[k * group_size]);
            return multiply_add(difference, difference, sum);
        });
    }

    const float* panel_;
    std::size_t dimension_;
    Block square_{};
};

// Computes squared distances between rows of int8 entries as exact integers, and multiplies them by scale². A panel of
// one block is read once for each tile of points. A panel of several blocks is for a single tile: it prefetches.
template <std::size_t Blocks = 1>
class BytePanel {
public:
    BytePanel(const std::uint8_t* panel, std::size_t dimension, float scale, std::size_t ahead = 0)
        : panel_(panel), quads_(dimension / 4), scale_(scale), ahead_(ahead)
    {
    }

    bool suspect() const { return false; }

    template <std::size_t Count>
    DFD_INLINE void squared_distances(const PackedRows& points, std::size_t first, Block* out) const
    {
        Int sum[Count][Blocks][parts] = {};
#if defined(__AVX512F__) || !defined(__x86_64__)
        add_products<Quad>(points, first, sum);
#elif defined(__AVX2__)
        bool fit = true;
        for (std::size_t j = 0; j < Count; ++j) fit &= points.products_fit[first + j] != 0;
        if (fit) add_products<Quad>(points, first, sum);
        else add_products<WideQuad>(points, first, sum);
#else
        add_products<WideQuad>(points, first, sum);
#endif
#pragma GCC unroll 16
        for (std::size_t j = 0; j < Count; ++j) {
#pragma GCC unroll 2
            for (std::size_t block = 0; block < Blocks; ++block) {
                for (std::size_t part = 0; part < parts; ++part) {
                    const Int own = load<Int>(at(block, quads_, part));
                    // Unsigned, so that an overflow is defined: squared lengths in the input may be invalid.
                    const Bits square =
                        (Bits)own + (Bits)splat(points.quad_squares[first + j]) - 2u * (Bits)sum[j][block][part];
                    out[j * Blocks + block].part[part] =
                        multiply_add(__builtin_convertvector((Int)square, Float), splat(scale_ * scale_),
                                     splat(points.offsets[first + j]));
                }
            }
        }
    }

private:
    // Returns the address of quad `k` of the vertices in one part of a block. The squared lengths are the last quad.
    const std::uint8_t* at(std::size_t block, std::size_t k, std::size_t part) const
    {
        return panel_ + ((block * (quads_ + 1) + k) * block_size + part * width) * 4;
    }

    // Adds the dot products between the byte rows of the block and those of `Count` points to `sum`.
    template <class AnyQuad, std::size_t Count>
    DFD_INLINE void add_products(const PackedRows& points, std::size_t first, Int (&sum)[Count][Blocks][parts]) const
    {
        const std::size_t group = first / group_size * group_size * quads_;
        const std::int32_t* bytes = points.quads + group + first % group_size;
        const std::int32_t* pairs = points.pairs + 2 * group + first % group_size;
#pragma GCC unroll 4
        for (std::size_t k = 0; k < quads_; ++k) {
            Int entry[Blocks][parts];
#pragma GCC unroll 2
            for (std::size_t block = 0; block < Blocks; ++block) {
                // Lines are prefetched in the order of memory, because another order slows down the hardware.
                if constexpr (Blocks > 1) __builtin_prefetch(panel_ + ahead_ + (k * Blocks + block) * 64);
                for (std::size_t part = 0; part < parts; ++part) entry[block][part] = load<Int>(at(block, k, part));
            }
#pragma GCC unroll 16
            for (std::size_t j = 0; j < Count; ++j) {
                const AnyQuad other = AnyQuad::at(bytes + k * group_size + j, pairs + 2 * k * group_size + j);
#pragma GCC unroll 2
                for (std::size_t block = 0; block < Blocks; ++block)
                    for (std::size_t part = 0; part < parts; ++part)
                        sum[j][block][part] = dot4(sum[j][block][part], entry[block][part], other);
            }
        }
    }

    const std::uint8_t* panel_;
    std::size_t quads_;
    float scale_;
    std::size_t ahead_;  // bytes to the lines that a panel of several blocks prefetches
};

}  // namespace
}  // namespace dfd
