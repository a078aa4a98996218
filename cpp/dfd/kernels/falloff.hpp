#pragma once

// The falloff curves f, which give weights from feature distances, and the powers (1 - g)^λ of Eq. (7).

#include "dfd/kernels/simd.hpp"

namespace dfd {
namespace {

// Returns 2^x for x <= 0, exact at 0. For x = n + f with an integer n, the result is 2^n times a power series for 2^f.
DFD_INLINE Float exp2_of(Float x)
{
    x = maximum(x, splat(-126.0f));
    const Int whole = __builtin_convertvector(x - 0.5f, Int);
    const Float f = x - __builtin_convertvector(whole, Float);
    Float y = splat(1.5403530e-4f);
    y = multiply_add(y, f, splat(1.3333558e-3f));
    y = multiply_add(y, f, splat(9.6181291e-3f));
    y = multiply_add(y, f, splat(5.5504109e-2f));
    y = multiply_add(y, f, splat(2.4022651e-1f));
    y = multiply_add(y, f, splat(6.9314718e-1f));
    y = multiply_add(y, f, splat(1.0f));
    return (Float)((Int)y + (whole << 23));
}

// Returns log2(x) for x in (0, 1], exact at 1. For x = m 2^e with m near 1, it is e plus a power series for log2(m).
DFD_INLINE Float log2_of(Float x)
{
    const Int bits = (Int)x - 0x3f3504f3;
    const Int exponent = bits >> 23;
    const Float m = (Float)((bits & 0x7fffff) + 0x3f3504f3);
    const Float s = (m - 1.0f) / (m + 1.0f);
    const Float q = s * s;
    Float y = splat(0.32059890f);
    y = multiply_add(y, q, splat(0.41219859f));
    y = multiply_add(y, q, splat(0.57707802f));
    y = multiply_add(y, q, splat(0.96179669f));
    y = multiply_add(y, q, splat(2.8853901f));
    return multiply_add(y, s, __builtin_convertvector(exponent, Float));
}

// Returns x^power for x in [0, 1] and power > 0.
DFD_INLINE Float power_of(Float x, float power)
{
    const Float positive = exp2_of(power * log2_of(maximum(x, splat(0x1p-126f))));
    return select(at_least(splat(0.0f), x), splat(0.0f), positive);
}

// Returns the weight at x = 1 - distance / reach in [0, 1]. It is 0 at x = 0, 1 at x = 1, and never decreases with x.
DFD_INLINE Float fall_off(Float x, Falloff falloff)
{
    switch (falloff) {
    case Falloff::smooth: return x * x * (3.0f - 2.0f * x);
    case Falloff::sharp: return x * x;
    case Falloff::root: return sqrt(x);
    case Falloff::sphere: return sqrt(x * (2.0f - x));
    case Falloff::constant: return select(at_least(splat(0.0f), x), splat(0.0f), splat(1.0f));
    default: return x;
    }
}

}  // namespace
}  // namespace dfd
