#pragma once

// Points (N, 3) to a vector for each coordinate, and back.

#include "dfd/kernels/simd.hpp"

namespace dfd {
namespace {

template <class T>
struct Vector3 {
    Vector<T> x, y, z;
};

// Where the next 3 W interleaved coordinates keep x, y and z.
template <class T> struct Interleaved;

#if defined(__AVX512F__)
template <>
struct Interleaved<float> {
    static DFD_INLINE Vector3<float> read(const float* from)
    {
        const Float a = load<Float>(from), b = load<Float>(from + 16), c = load<Float>(from + 32);
        const Float x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
        const Float y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
        const Float z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
        return {__builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29),
                __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30),
                __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31)};
    }
    static DFD_INLINE void write(float* to, const Vector3<float>& p)
    {
        const Float a = __builtin_shufflevector(p.x, p.y, 0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5);
        const Float b = __builtin_shufflevector(p.x, p.y, 21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26);
        const Float c = __builtin_shufflevector(p.x, p.y, 0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0);
        store(to, (Float)__builtin_shufflevector(a, p.z, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15));
        store(to + 16, (Float)__builtin_shufflevector(b, p.z, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15));
        store(to + 32, (Float)__builtin_shufflevector(c, p.z, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31));
    }
};
#endif

// Vectors of eight, built from halves where the machine has only those.
#if defined(__AVX512F__)
typedef Double Eight;
#define DFD_EIGHT double
#elif defined(__AVX2__)
typedef Float Eight;
#define DFD_EIGHT float
#endif

#if defined(__AVX2__)
template <>
struct Interleaved<DFD_EIGHT> {
    static DFD_INLINE Vector3<DFD_EIGHT> read(const DFD_EIGHT* from)
    {
        const Eight a = load<Eight>(from), b = load<Eight>(from + 8), c = load<Eight>(from + 16);
        const Eight x = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 0, 0);
        const Eight y = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 0, 0, 0);
        const Eight z = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 0, 0, 0);
        return {__builtin_shufflevector(x, c, 0, 1, 2, 3, 4, 5, 10, 13),
                __builtin_shufflevector(y, c, 0, 1, 2, 3, 4, 8, 11, 14),
                __builtin_shufflevector(z, c, 0, 1, 2, 3, 4, 9, 12, 15)};
    }
    static DFD_INLINE void write(DFD_EIGHT* to, const Vector3<DFD_EIGHT>& p)
    {
        const Eight a = __builtin_shufflevector(p.x, p.y, 0, 8, 0, 1, 9, 0, 2, 10);
        const Eight b = __builtin_shufflevector(p.x, p.y, 0, 3, 11, 0, 4, 12, 0, 5);
        const Eight c = __builtin_shufflevector(p.x, p.y, 13, 0, 6, 14, 0, 7, 15, 0);
        store(to, (Eight)__builtin_shufflevector(a, p.z, 0, 1, 8, 3, 4, 9, 6, 7));
        store(to + 8, (Eight)__builtin_shufflevector(b, p.z, 10, 1, 2, 11, 4, 5, 12, 7));
        store(to + 16, (Eight)__builtin_shufflevector(c, p.z, 0, 13, 2, 3, 14, 5, 6, 15));
    }
};
#endif

#if !defined(__AVX512F__)
#if defined(__AVX2__)
typedef Double Four;
#define DFD_FOUR double
#else
typedef Float Four;
#define DFD_FOUR float
#endif

template <>
struct Interleaved<DFD_FOUR> {
    static DFD_INLINE Vector3<DFD_FOUR> read(const DFD_FOUR* from)
    {
        const Four a = load<Four>(from), b = load<Four>(from + 4), c = load<Four>(from + 8);
        const Four x = __builtin_shufflevector(a, b, 0, 3, 6, 6), y = __builtin_shufflevector(a, b, 1, 4, 7, 7);
        const Four z = __builtin_shufflevector(a, b, 2, 5, 5, 5);
        return {__builtin_shufflevector(x, c, 0, 1, 2, 5), __builtin_shufflevector(y, c, 0, 1, 2, 6),
                __builtin_shufflevector(z, c, 0, 1, 4, 7)};
    }
    static DFD_INLINE void write(DFD_FOUR* to, const Vector3<DFD_FOUR>& p)
    {
        const Four a = __builtin_shufflevector(p.x, p.y, 0, 4, 0, 1), b = __builtin_shufflevector(p.x, p.y, 5, 0, 2, 6);
        const Four c = __builtin_shufflevector(p.x, p.y, 0, 3, 7, 0);
        store(to, (Four)__builtin_shufflevector(a, p.z, 0, 1, 4, 3));
        store(to + 4, (Four)__builtin_shufflevector(b, p.z, 0, 5, 2, 3));
        store(to + 8, (Four)__builtin_shufflevector(c, p.z, 6, 1, 2, 7));
    }
};
#endif

#if !defined(__AVX2__)
template <>
struct Interleaved<double> {
    static DFD_INLINE Vector3<double> read(const double* from)
    {
        const Double a = load<Double>(from), b = load<Double>(from + 2), c = load<Double>(from + 4);
        return {__builtin_shufflevector(a, b, 0, 3), __builtin_shufflevector(a, c, 1, 2),
                __builtin_shufflevector(b, c, 0, 3)};
    }
    static DFD_INLINE void write(double* to, const Vector3<double>& p)
    {
        store(to, (Double)__builtin_shufflevector(p.x, p.y, 0, 2));
        store(to + 2, (Double)__builtin_shufflevector(p.z, p.x, 0, 3));
        store(to + 4, (Double)__builtin_shufflevector(p.y, p.z, 1, 3));
    }
};
#endif

}  // namespace
}  // namespace dfd
