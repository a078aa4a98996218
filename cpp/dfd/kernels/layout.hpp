#pragma once

// Conversion between rows in memory and lanes of vectors, for rows of any width and for points (N, 3).

#include "dfd/kernels/simd.hpp"

#include <utility>

namespace dfd {
namespace {

// Returns a vector whose entry i is entry Source(i) of the concatenation of two vectors.
template <auto Source, class V>
DFD_INLINE V shuffle(V a, V b)
{
    constexpr std::size_t size = sizeof(V) / sizeof a[0];
    return [&]<std::size_t... I>(std::index_sequence<I...>) __attribute__((always_inline)) {
        return (V)__builtin_shufflevector(a, b, Source(I)...);
    }(std::make_index_sequence<size>());
}

// Transposes a square matrix, one vector per row. Each round moves one bit of the row index to the lane index.
DFD_INLINE void transpose(Float (&v)[lanes<float>])
{
    constexpr std::size_t size = lanes<float>;
#pragma GCC unroll 4
    for (std::size_t round = 1; round < size; round *= 2) {
        Float next[size];
#pragma GCC unroll 8
        for (std::size_t i = 0; i < size / 2; ++i) {  // interleaves the first halves, then the second halves
            next[2 * i] = shuffle<[](std::size_t k) { return k / 2 + k % 2 * size; }>(v[i], v[i + size / 2]);
            next[2 * i + 1] = shuffle<[](std::size_t k) { return (size + k) / 2 + k % 2 * size; }>(v[i], v[i + size / 2]);
        }
#pragma GCC unroll 16
        for (std::size_t i = 0; i < size; ++i) v[i] = next[i];
    }
}

// Loads `count` floats into the first lanes and sets the other lanes to 0.
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

constexpr std::size_t line = 64 / sizeof(float);  // floats of a cache line
constexpr std::size_t few_columns = 4;  // single loads are faster than transpositions for at most this many columns

// Writes 16 rows of `columns` floats to `out` (columns, 16). In `rows`, a row begins `stride` floats after the
// previous row. If `count` is below 16, copies of row `count` - 1 replace the missing rows.
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
                // The hardware does not prefetch sixteen streams of rows, so the next block is prefetched here.
                if (k % line == 0) __builtin_prefetch(from + block_size * stride, 0, 2);
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

constexpr std::size_t quads = lanes<float> / 4;  // number of quads (groups of four lanes) in a vector

// Transposes 4×4 matrices: quad q of the four vectors forms matrix q.
DFD_INLINE void transpose_quads(Float (&v)[4])
{
    constexpr std::size_t size = lanes<float>;
    // Both functions take entries First and First + 1 of each quad of a and of b.
    const auto interleaved = [&]<std::size_t First>(Float a, Float b) __attribute__((always_inline)) {
        return shuffle<[](std::size_t k) { return k / 4 * 4 + First + k % 4 / 2 + k % 2 * size; }>(a, b);
    };
    const auto concatenated = [&]<std::size_t First>(Float a, Float b) __attribute__((always_inline)) {
        return shuffle<[](std::size_t k) { return k / 4 * 4 + First + k % 2 + k % 4 / 2 * size; }>(a, b);
    };
    const Float a = interleaved.template operator()<0>(v[0], v[1]), b = interleaved.template operator()<2>(v[0], v[1]);
    const Float c = interleaved.template operator()<0>(v[2], v[3]), d = interleaved.template operator()<2>(v[2], v[3]);
    v[0] = concatenated.template operator()<0>(a, c);
    v[1] = concatenated.template operator()<2>(a, c);
    v[2] = concatenated.template operator()<0>(b, d);
    v[3] = concatenated.template operator()<2>(b, d);
}

typedef float QuadFloat __attribute__((vector_size(16)));

template <std::size_t Index, class V>
DFD_INLINE QuadFloat quad(V v)
{
    if constexpr (sizeof v == sizeof(QuadFloat)) return v;
    else return __builtin_shufflevector(v, v, 4 * Index, 4 * Index + 1, 4 * Index + 2, 4 * Index + 3);
}

// Writes quad q of vector i to row 4 q + i, for each q from `Index` on. Only `Count` entries of a quad are written.
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

// Writes `from` (Count, 16), transposed, to 16 rows; `Count` is at most 4.
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

// Writes `from` (columns, 16), transposed, to 16 rows, at most four floats at a time. This needs few shuffles.
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

template <class T>
struct Vector3 {
    Vector<T> x, y, z;
};

// Converts points (W, 3) in memory to three vectors of W lanes, and back. Entry 3 i + k is coordinate k of point i.
template <class T>
struct Interleaved {
    static constexpr std::size_t size = lanes<T>;

    // The lambdas capture nothing, because clang accepts no closure with captures as a template argument.
    template <std::size_t Axis>
    static DFD_INLINE Vector<T> axis(Vector<T> a, Vector<T> b, Vector<T> c)
    {
        // Entries 0 … 2 W - 1 are in a or b, the others in c.
        constexpr auto from_ab = [](std::size_t i) { return 3 * i + Axis < 2 * size ? 3 * i + Axis : 0; };
        constexpr auto from_c = [](std::size_t i) { return 3 * i + Axis < 2 * size ? i : 3 * i + Axis - size; };
        return shuffle<from_c>(shuffle<from_ab>(a, b), c);
    }

    static DFD_INLINE Vector3<T> read(const T* from)
    {
        const auto a = load<Vector<T>>(from), b = load<Vector<T>>(from + size), c = load<Vector<T>>(from + 2 * size);
        return {axis<0>(a, b, c), axis<1>(a, b, c), axis<2>(a, b, c)};
    }

    template <std::size_t Number>
    static DFD_INLINE Vector<T> coordinates(const Vector3<T>& p)
    {
        constexpr auto from_xy = [](std::size_t i) {
            const std::size_t at = Number * size + i;
            return at % 3 == 2 ? 0 : at % 3 * size + at / 3;
        };
        constexpr auto from_z = [](std::size_t i) {
            const std::size_t at = Number * size + i;
            return at % 3 == 2 ? size + at / 3 : i;
        };
        return shuffle<from_z>(shuffle<from_xy>(p.x, p.y), p.z);
    }

    static DFD_INLINE void write(T* to, const Vector3<T>& p)
    {
        store(to, coordinates<0>(p));
        store(to + size, coordinates<1>(p));
        store(to + 2 * size, coordinates<2>(p));
    }
};

}  // namespace
}  // namespace dfd
