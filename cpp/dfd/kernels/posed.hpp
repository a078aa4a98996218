#pragma once

// The weights of a block of vertices, and the sums of transforms that they give, for posing and for its gradients.

#include "dfd/kernels/blend.hpp"

namespace dfd {
namespace {

template <class T>
DFD_INLINE Vector<T> load_weights(const float* from)
{
    if constexpr (sizeof(T) == sizeof(float)) {
        return load<Float>(from);
    } else {
        typedef float Half __attribute__((vector_size(vector_bytes / 2)));
        return __builtin_convertvector(load<Half>(from), Double);
    }
}

template <class T>
struct Weights {
    const float* first;  // the weights of the lanes for handle 0
    std::size_t stride;  // number of floats from the weights of a handle to those of the next

    DFD_INLINE Vector<T> operator()(std::size_t k) const { return load_weights<T>(first + k * stride); }
};

template <class T>
struct Totals {
    Vector<T> remainder;  // weight of the default transform D_0
    Vector<T> excess;     // amount by which the sum of the weights exceeds 1, for overlap `paper`
    Vector<T> factor;     // number by which overlap `normalize` multiplies all weights
};

template <class T>
DFD_INLINE Totals<T> totals(const PoseJob<T>& job, const Weights<T>& weights)
{
    const Vector<T> zero{}, one = zero + T(1);
    Vector<T> sum = zero;
    if (job.shares == nullptr) {
        for (std::size_t k = 0; k < job.handle_count; ++k) sum += weights(k);
    } else {
        for (std::size_t k = 0; k < job.handle_count; ++k) sum = multiply_add(weights(k), splat(job.shares[k]), sum);
    }
    const bool paper = job.overlap == Overlap::paper && job.blend == Blend::linear;
    const bool normalize = job.overlap != Overlap::add && !paper;  // for dual quaternions, `paper` means `normalize`
    return {maximum(one - sum, zero), paper ? maximum(sum - one, zero) : zero,
            normalize ? one / maximum(sum, one) : one};
}

// Sums entries First … Last - 1 of all handles' transforms and D_0, multiplied by their weights, in registers.
template <std::size_t First, std::size_t Last, class T, std::size_t Count>
DFD_INLINE void accumulate(const PoseJob<T>& job, const T* table, const Weights<T>& weights, Vector<T> remainder,
                           Sums<T, Count>& sums)
{
    Vector<T> part[Last - First] = {};
    const auto add = [&](const T* entries, Vector<T> weight) __attribute__((always_inline)) {
#pragma GCC unroll 12
        for (std::size_t e = First; e < Last; ++e)
            part[e - First] = multiply_add(weight, splat(entries[e]), part[e - First]);
    };
    for (std::size_t k = 0; k < job.handle_count; ++k) add(table + Count * k, weights(k));
    if (job.rest != nullptr) add(job.rest, remainder);
    for (std::size_t e = First; e < Last; ++e) sums.entry[e] = part[e - First];
}

template <class Kind, class T>
DFD_INLINE Sums<T, Kind::count> blended(const PoseJob<T>& job, const T* table, const Weights<T>& weights,
                                        Vector<T> remainder)
{
    Sums<T, Kind::count> sums;
    if constexpr (Kind::count <= 12) {
        accumulate<0, Kind::count>(job, table, weights, remainder, sums);
    } else {
        accumulate<0, 8>(job, table, weights, remainder, sums);
        accumulate<8, Kind::count>(job, table, weights, remainder, sums);
    }
    return sums;
}

// The weight (0 to 1) of the mirror plane's positive side: a smoothstep in the band, a step without a band.
template <class T>
struct Share {
    Vector<T> step;  // 0 below the band, 1 above it, and in the band a linear function of the height
    Vector<T> value;

    DFD_INLINE Share(const PoseJob<T>& job, const Vector3<T>& p)
    {
        const Vector<T> zero{}, one = zero + T(1);
        if (job.negative == nullptr) {
            step = value = one;
            return;
        }
        Vector<T> height = splat(job.height);
        height = multiply_add(p.x, splat(job.normal[0]), height);
        height = multiply_add(p.y, splat(job.normal[1]), height);
        height = multiply_add(p.z, splat(job.normal[2]), height);
        if (job.steepness == 0) {
            step = value = select(at_least(height, zero), one, zero);
        } else {
            step = minimum(maximum(multiply_add(height, splat(job.steepness), zero + T(0.5)), zero), one);
            value = step * step * (T(3) - T(2) * step);
        }
    }
};

template <class P>
DFD_INLINE P* advanced(P* pointer, std::size_t count)
{
    return pointer == nullptr ? nullptr : pointer + count;
}

}  // namespace
}  // namespace dfd
