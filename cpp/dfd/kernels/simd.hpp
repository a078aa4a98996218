#pragma once

// The vector operations of one instruction set, for the variant of the kernels that DFD_VARIANT names. All functions
// have internal linkage, so that the linker cannot mix the instructions of two variants.

#include <cstddef>
#include <cstdint>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__ARM_NEON)
#include <arm_neon.h>
#endif

#include "dfd/kernels/kernels.hpp"

#define DFD_INLINE inline __attribute__((always_inline))

namespace dfd {
namespace {

#if defined(__AVX512F__)
constexpr std::size_t vector_bytes = 64;
#elif defined(__AVX2__)
constexpr std::size_t vector_bytes = 32;
#else
constexpr std::size_t vector_bytes = 16;
#endif

template <class T>
constexpr std::size_t lanes = vector_bytes / sizeof(T);

// Number of vectors that hold one entry of each vertex of a block.
template <class T>
constexpr std::size_t vectors = block_size / lanes<T>;

typedef float Float __attribute__((vector_size(vector_bytes)));
typedef double Double __attribute__((vector_size(vector_bytes)));
typedef std::int32_t Int __attribute__((vector_size(vector_bytes)));
typedef std::int64_t Long __attribute__((vector_size(vector_bytes)));

template <class T> struct VectorOf;
template <> struct VectorOf<float> { using type = Float; };
template <> struct VectorOf<double> { using type = Double; };
template <class T> using Vector = typename VectorOf<T>::type;

template <class V>
DFD_INLINE V load(const void* from)
{
    V value;
    std::memcpy(&value, from, sizeof value);
    return value;
}

template <class V>
DFD_INLINE void store(void* to, V value)
{
    std::memcpy(to, &value, sizeof value);
}

DFD_INLINE Float splat(float value) { return value - Float{}; }
DFD_INLINE Double splat(double value) { return value - Double{}; }
DFD_INLINE Int splat(std::int32_t value) { return value - Int{}; }

// Four int8 entries of a point (a quad), copied to each lane; an operand of `dot4`.
struct Quad {
    Int bytes;
    static DFD_INLINE Quad at(const std::int32_t* bytes, const std::int32_t*) { return {splat(*bytes)}; }
};

// The even and odd entries of a quad as int16. `dot4` needs them if the sum of two byte products can exceed 16 bits.
struct WideQuad {
    Int even, odd;
    static DFD_INLINE WideQuad at(const std::int32_t*, const std::int32_t* pairs)
    {
        return {splat(pairs[0]), splat(pairs[group_size])};
    }
};

// Copies `count` entries, which may be fewer than the lanes of a vector.
template <class T>
DFD_INLINE void copy(const T* from, std::size_t count, T* to)
{
    for (std::size_t k = 0; k < count; ++k) to[k] = from[k];
}

// Prefetches `size` bytes that begin `ahead` bytes after `place`. These bytes may lie beyond the array. Memory to
// write is prefetched too, because a core reads a cache line before it changes the line.
template <bool Write = false>
DFD_INLINE void prefetch(const void* place, std::size_t ahead, std::size_t size)
{
    const std::uintptr_t first = reinterpret_cast<std::uintptr_t>(place) + ahead;
#pragma GCC unroll 8
    for (std::size_t line = 0; line < size; line += 64)
        __builtin_prefetch(reinterpret_cast<const void*>(first + line), Write);
}

// Operations that every x86 instruction set has. The prefix of the intrinsics depends on the width of the vectors.
#if defined(__x86_64__)

#if defined(__AVX512F__)
#define DFD_X86(operation) _mm512_##operation
typedef __m512 X86Float;
typedef __m512d X86Double;
typedef __m512i X86Int;
#elif defined(__AVX2__)
#define DFD_X86(operation) _mm256_##operation
typedef __m256 X86Float;
typedef __m256d X86Double;
typedef __m256i X86Int;
#else
#define DFD_X86(operation) _mm_##operation
typedef __m128 X86Float;
typedef __m128d X86Double;
typedef __m128i X86Int;
#endif

// `maximum` and `minimum` return `b` if one of the operands is NaN.
DFD_INLINE Float maximum(Float a, Float b) { return (Float)DFD_X86(max_ps)((X86Float)a, (X86Float)b); }
DFD_INLINE Float minimum(Float a, Float b) { return (Float)DFD_X86(min_ps)((X86Float)a, (X86Float)b); }
DFD_INLINE Double maximum(Double a, Double b) { return (Double)DFD_X86(max_pd)((X86Double)a, (X86Double)b); }
DFD_INLINE Double minimum(Double a, Double b) { return (Double)DFD_X86(min_pd)((X86Double)a, (X86Double)b); }
DFD_INLINE Float sqrt(Float a) { return (Float)DFD_X86(sqrt_ps)((X86Float)a); }
DFD_INLINE Double sqrt(Double a) { return (Double)DFD_X86(sqrt_pd)((X86Double)a); }
DFD_INLINE void stream(float* to, Float value) { DFD_X86(stream_ps)(to, (X86Float)value); }
DFD_INLINE void stream_fence() { _mm_sfence(); }

#if defined(__AVX2__)
DFD_INLINE Float multiply_add(Float a, Float b, Float c)
{
    return (Float)DFD_X86(fmadd_ps)((X86Float)a, (X86Float)b, (X86Float)c);
}
DFD_INLINE Double multiply_add(Double a, Double b, Double c)
{
    return (Double)DFD_X86(fmadd_pd)((X86Double)a, (X86Double)b, (X86Double)c);
}
#endif

#else

template <class V>
DFD_INLINE V maximum(V a, V b) { return a > b ? a : b; }
template <class V>
DFD_INLINE V minimum(V a, V b) { return a < b ? a : b; }
DFD_INLINE void stream(float* to, Float value) { store(to, value); }
DFD_INLINE void stream_fence() {}

#if defined(__ARM_NEON)
DFD_INLINE Float multiply_add(Float a, Float b, Float c)
{
    return (Float)vfmaq_f32((float32x4_t)c, (float32x4_t)a, (float32x4_t)b);
}
DFD_INLINE Double multiply_add(Double a, Double b, Double c)
{
    return (Double)vfmaq_f64((float64x2_t)c, (float64x2_t)a, (float64x2_t)b);
}
DFD_INLINE Float sqrt(Float a) { return (Float)vsqrtq_f32((float32x4_t)a); }
DFD_INLINE Double sqrt(Double a) { return (Double)vsqrtq_f64((float64x2_t)a); }
#else
DFD_INLINE Float sqrt(Float a)
{
    for (std::size_t lane = 0; lane < lanes<float>; ++lane) a[lane] = __builtin_sqrtf(a[lane]);
    return a;
}
DFD_INLINE Double sqrt(Double a)
{
    for (std::size_t lane = 0; lane < lanes<double>; ++lane) a[lane] = __builtin_sqrt(a[lane]);
    return a;
}
#endif

#endif

#if !defined(__AVX2__) && !defined(__ARM_NEON)
DFD_INLINE Float multiply_add(Float a, Float b, Float c) { return a * b + c; }
DFD_INLINE Double multiply_add(Double a, Double b, Double c) { return a * b + c; }
#endif

// With AVX-512, a comparison of two vectors returns a mask register. Elsewhere, it returns a vector.
#if defined(__AVX512F__)

DFD_INLINE __mmask16 at_least(Float a, Float b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_GE_OQ); }
DFD_INLINE __mmask8 at_least(Double a, Double b) { return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, _CMP_GE_OQ); }
DFD_INLINE __mmask16 equal(Float a, Float b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_EQ_OQ); }
DFD_INLINE __mmask8 equal(Double a, Double b) { return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, _CMP_EQ_OQ); }
DFD_INLINE bool all(__mmask16 mask) { return mask == 0xffff; }
DFD_INLINE bool all(__mmask8 mask) { return mask == 0xff; }
DFD_INLINE Float select(__mmask16 mask, Float yes, Float no)
{
    return (Float)_mm512_mask_blend_ps(mask, (__m512)no, (__m512)yes);
}
DFD_INLINE Double select(__mmask8 mask, Double yes, Double no)
{
    return (Double)_mm512_mask_blend_pd(mask, (__m512d)no, (__m512d)yes);
}
// Returns the square root. For values of at least 2^-60, the bits equal those of `sqrt`, although the estimates of
// `rsqrt14` may differ between processors. For smaller values, the result is 2^-30.
DFD_INLINE Float sqrt_by_products(Float a)
{
    const __m512 half = _mm512_set1_ps(0.5f);
    const __m512 x = _mm512_max_ps((__m512)a, _mm512_set1_ps(0x1p-60f));
    const __m512 estimate = _mm512_rsqrt14_ps(x);
    __m512 r = _mm512_mul_ps(x, estimate), h = _mm512_mul_ps(estimate, half);
    const __m512 error = _mm512_fnmadd_ps(r, h, half);
    r = _mm512_fmadd_ps(r, error, r);
    h = _mm512_fmadd_ps(h, error, h);
    return (Float)_mm512_fmadd_ps(_mm512_fnmadd_ps(r, r, x), h, r);
}

#else

DFD_INLINE Int at_least(Float a, Float b) { return a >= b; }
DFD_INLINE Long at_least(Double a, Double b) { return a >= b; }
DFD_INLINE Int equal(Float a, Float b) { return a == b; }
DFD_INLINE Long equal(Double a, Double b) { return a == b; }
template <class M>
DFD_INLINE bool all(M mask)
{
#if defined(__AVX2__)
    return _mm256_movemask_epi8((__m256i)mask) == -1;
#else
    std::uint64_t halves[2];
    std::memcpy(halves, &mask, sizeof halves);
    return (halves[0] & halves[1]) == ~std::uint64_t{0};
#endif
}
template <class M, class V>
DFD_INLINE V select(M mask, V yes, V no) { return mask ? yes : no; }
DFD_INLINE Float sqrt_by_products(Float a) { return sqrt(a); }

#endif

DFD_INLINE Float from_halves(const std::uint16_t* from)
{
#if defined(__AVX512F__)
    return (Float)_mm512_cvtph_ps(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(from)));
#elif defined(__AVX2__)
    return (Float)_mm256_cvtph_ps(_mm_loadu_si128(reinterpret_cast<const __m128i*>(from)));
#else
    typedef std::uint16_t Halves __attribute__((vector_size(vector_bytes / 2)));
    const Int bits = __builtin_convertvector(load<Halves>(from), Int);
    // The exponent biases of float16 and float differ by 112. The factor 2^112 corrects even subnormal numbers.
    const Int magnitude = (bits & 0x7fff) << 13;
    return (Float)((Int)((Float)magnitude * splat(0x1p112f)) | ((bits & 0x8000) << 16));
#endif
}

// Adds to each lane of `sum` the dot product of four unsigned bytes with the four entries of a quad.
#if defined(__AVX512F__)
DFD_INLINE Int dot4(Int sum, Int unsigned_bytes, const Quad& quad)
{
    return (Int)_mm512_dpbusd_epi32((__m512i)sum, (__m512i)unsigned_bytes, (__m512i)quad.bytes);
}
#elif defined(__AVX2__)
DFD_INLINE Int dot4(Int sum, Int unsigned_bytes, const Quad& quad)
{
    const __m256i neighbors = _mm256_maddubs_epi16((__m256i)unsigned_bytes, (__m256i)quad.bytes);
    return sum + (Int)_mm256_madd_epi16(neighbors, _mm256_set1_epi16(1));
}
#elif !defined(__x86_64__)
DFD_INLINE Int dot4(Int sum, Int unsigned_bytes, const Quad& quad)
{
    sum += (unsigned_bytes & 255) * ((quad.bytes << 24) >> 24);
    sum += ((unsigned_bytes >> 8) & 255) * ((quad.bytes << 16) >> 24);
    sum += ((unsigned_bytes >> 16) & 255) * ((quad.bytes << 8) >> 24);
    sum += ((unsigned_bytes >> 24) & 255) * (quad.bytes >> 24);
    return sum;
}
#endif
#if defined(__x86_64__) && !defined(__AVX512F__)
DFD_INLINE Int dot4(Int sum, Int unsigned_bytes, const WideQuad& quad)
{
    const X86Int odd_bytes = DFD_X86(srli_epi16)((X86Int)unsigned_bytes, 8);
    const Int even = (Int)DFD_X86(madd_epi16)((X86Int)(unsigned_bytes & 0x00ff00ff), (X86Int)quad.even);
    const Int odd = (Int)DFD_X86(madd_epi16)(odd_bytes, (X86Int)quad.odd);
    return sum + (even + odd);
}
#endif

}  // namespace
}  // namespace dfd
