#pragma once

// Functions that the processor does not have, to within float's rounding.

#include "dfd/kernels/simd.hpp"

namespace dfd {
namespace {

// e^x, 0 below -87: 2^n for the nearest whole n, times the Taylor series of what is left.
DFD_INLINE Float exponential(Float x)
{
    const Float magic = splat(12582912.0f);  // 1.5 · 2^23: what is added to it is rounded to a whole number
    x = minimum(maximum(x, splat(-87.0f)), splat(88.0f));
    const Float shifted = multiply_add(x, splat(1.44269504f), magic), whole = shifted - magic;
    // ln 2 in two parts, the first of so few bits that its product is exact.
    const Float r = multiply_add(whole, splat(2.12194440e-4f), multiply_add(whole, splat(-0.693359375f), x));
    Float sum = splat(1.0f / 720);
    sum = multiply_add(sum, r, splat(1.0f / 120));
    sum = multiply_add(sum, r, splat(1.0f / 24));
    sum = multiply_add(sum, r, splat(1.0f / 6));
    sum = multiply_add(sum, r, splat(0.5f));
    sum = multiply_add(sum, r, splat(1.0f));
    sum = multiply_add(sum, r, splat(1.0f));
    return (Float)((Int)sum + ((Int)shifted << 23));
}

// x Φ(x) for the normal distribution's Φ. Source: Abramowitz and Stegun 7.1.26, with an error below 1.5e-7.
DFD_INLINE Float gaussian_error_unit(Float x)
{
    const Float magnitude = maximum(x, -x) * splat(0.70710678f);
    const Float t = splat(1.0f) / multiply_add(magnitude, splat(0.3275911f), splat(1.0f));
    Float sum = splat(1.061405429f);
    sum = multiply_add(sum, t, splat(-1.453152027f));
    sum = multiply_add(sum, t, splat(1.421413741f));
    sum = multiply_add(sum, t, splat(-0.284496736f));
    sum = multiply_add(sum, t, splat(0.254829592f));
    const Float beyond = splat(0.5f) * sum * t * exponential(-magnitude * magnitude);  // 1 - Φ(|x|)
    return select(at_least(x, Float{}), x - x * beyond, x * beyond);
}

}  // namespace
}  // namespace dfd
