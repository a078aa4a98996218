#pragma once

// Rows of a matrix to one row per lane, and back.

#include "dfd/kernels/simd.hpp"

namespace dfd {
namespace {

// Alternating entries of the first, and of the second, halves of two vectors.
DFD_INLINE void interleave(Float a, Float b, Float& first, Float& second)
{
#if defined(__AVX512F__)
    first = __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
    second = __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
#elif defined(__AVX2__)
    first = __builtin_shufflevector(a, b, 0, 8, 1, 9, 2, 10, 3, 11);
    second = __builtin_shufflevector(a, b, 4, 12, 5, 13, 6, 14, 7, 15);
#else
    first = __builtin_shufflevector(a, b, 0, 4, 1, 5);
    second = __builtin_shufflevector(a, b, 2, 6, 3, 7);
#endif
}

// Rows become columns: each round of interleaving takes the next bit of the row's number to the lane's.
DFD_INLINE void transpose(Float (&v)[lanes<float>])
{
    constexpr std::size_t size = lanes<float>;
#pragma GCC unroll 4
    for (std::size_t round = 1; round < size; round *= 2) {
        Float next[size];
#pragma GCC unroll 8
        for (std::size_t i = 0; i < size / 2; ++i) interleave(v[i], v[i + size / 2], next[2 * i], next[2 * i + 1]);
#pragma GCC unroll 16
        for (std::size_t i = 0; i < size; ++i) v[i] = next[i];
    }
}

// The first `count` entries, the others 0.
DFD_INLINE Float load_part(const float* from, std::size_t count)
{
#if defined(__AVX512F__)
    return (Float)_mm512_maskz_loadu_ps(static_cast<__mmask16>((1u << count) - 1), from);
#elif defined(__AVX2__)
    const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    return (Float)_mm256_maskload_ps(from, _mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(count)), lane));
#else
    Float value{};
    for (std::size_t lane = 0; lane < count; ++lane) value[lane] = from[lane];
    return value;
#endif
}

constexpr std::size_t few_columns = 4;  // picked one by one sooner than by a transposition of whole vectors

// Sixteen rows of `columns` numbers, `stride` apart, to (columns, 16); rows from `count` on repeat the last one.
DFD_INLINE void rows_to_lanes(const float* rows, std::size_t stride, std::size_t columns, std::size_t count, float* out)
{
    constexpr std::size_t size = lanes<float>;
    if (columns <= few_columns && count == block_size) {
        for (std::size_t k = 0; k < columns; ++k) {
            for (std::size_t lane = 0; lane < block_size; lane += size) {
                Float v;
#pragma GCC unroll 16
                for (std::size_t i = 0; i < size; ++i) v[i] = rows[(lane + i) * stride + k];
                store(out + k * block_size + lane, v);
            }
        }
        return;
    }
    for (std::size_t k = 0; k < columns; k += size) {
        const std::size_t some = columns - k < size ? columns - k : size;
        for (std::size_t lane = 0; lane < block_size; lane += size) {
            Float v[size];
#pragma GCC unroll 16
            for (std::size_t i = 0; i < size; ++i) {
                const float* from = rows + (lane + i < count ? lane + i : count - 1) * stride + k;
                v[i] = some == size ? load<Float>(from) : load_part(from, some);
            }
            transpose(v);
            float* to = out + k * block_size + lane;
            if (some == size) {
#pragma GCC unroll 16
                for (std::size_t i = 0; i < size; ++i) store(to + i * block_size, v[i]);
            } else {
                for (std::size_t i = 0; i < some; ++i) store(to + i * block_size, v[i]);
            }
        }
    }
}

constexpr std::size_t quads = lanes<float> / 4;  // of a vector

// Within every quad of four vectors, rows become columns.
DFD_INLINE void transpose_quads(Float (&v)[4])
{
#if defined(__AVX512F__)
#define DFD_IN_QUADS(a, b, c, d) \
    a, b, c, d, a + 4, b + 4, c + 4, d + 4, a + 8, b + 8, c + 8, d + 8, a + 12, b + 12, c + 12, d + 12
#elif defined(__AVX2__)
#define DFD_IN_QUADS(a, b, c, d) a, b, c, d, a + 4, b + 4, c + 4, d + 4
#else
#define DFD_IN_QUADS(a, b, c, d) a, b, c, d
#endif
    constexpr int other = lanes<float>;  // where the second vector's entries start
    const Float a = __builtin_shufflevector(v[0], v[1], DFD_IN_QUADS(0, other, 1, other + 1));
    const Float b = __builtin_shufflevector(v[0], v[1], DFD_IN_QUADS(2, other + 2, 3, other + 3));
    const Float c = __builtin_shufflevector(v[2], v[3], DFD_IN_QUADS(0, other, 1, other + 1));
    const Float d = __builtin_shufflevector(v[2], v[3], DFD_IN_QUADS(2, other + 2, 3, other + 3));
    v[0] = __builtin_shufflevector(a, c, DFD_IN_QUADS(0, 1, other, other + 1));
    v[1] = __builtin_shufflevector(a, c, DFD_IN_QUADS(2, 3, other + 2, other + 3));
    v[2] = __builtin_shufflevector(b, d, DFD_IN_QUADS(0, 1, other, other + 1));
    v[3] = __builtin_shufflevector(b, d, DFD_IN_QUADS(2, 3, other + 2, other + 3));
#undef DFD_IN_QUADS
}

typedef float QuadFloat __attribute__((vector_size(16)));

template <std::size_t Index, class V>
DFD_INLINE QuadFloat quad(V v)
{
    if constexpr (sizeof v == sizeof(QuadFloat)) return v;
    else return __builtin_shufflevector(v, v, 4 * Index, 4 * Index + 1, 4 * Index + 2, 4 * Index + 3);
}

// The first `Count` entries of quad `Index` of each of four vectors, to a row each.
template <std::size_t Count, std::size_t Index = 0>
DFD_INLINE void store_quads(const Float (&v)[4], float* rows, std::size_t stride)
{
#pragma GCC unroll 4
    for (std::size_t i = 0; i < 4; ++i) {
        const QuadFloat four = quad<Index>(v[i]);
        std::memcpy(rows + (4 * Index + i) * stride, &four, Count * sizeof(float));
    }
    if constexpr (Index + 1 < quads) store_quads<Count, Index + 1>(v, rows, stride);
}

// Up to four columns of 16 entries, side by side in memory, to 16 rows.
template <std::size_t Count>
DFD_INLINE void columns_to_rows(const float* from, float* rows, std::size_t stride)
{
    for (std::size_t lane = 0; lane < block_size; lane += lanes<float>) {
        Float v[4];
#pragma GCC unroll 4
        for (std::size_t i = 0; i < 4; ++i) v[i] = load<Float>(from + (i < Count ? i : 0) * block_size + lane);
        transpose_quads(v);
        store_quads<Count>(v, rows + lane * stride, stride);
    }
}

// The way back: (columns, 16) to 16 rows. Narrow stores, but half the shuffles that whole vectors would need.
DFD_INLINE void lanes_to_rows(const float* from, std::size_t columns, float* rows, std::size_t stride)
{
    std::size_t k = 0;
    for (; k + 4 <= columns; k += 4) columns_to_rows<4>(from + k * block_size, rows + k, stride);
    switch (columns - k) {
    case 1: return columns_to_rows<1>(from + k * block_size, rows + k, stride);
    case 2: return columns_to_rows<2>(from + k * block_size, rows + k, stride);
    case 3: return columns_to_rows<3>(from + k * block_size, rows + k, stride);
    default: return;
    }
}

}  // namespace
}  // namespace dfd
