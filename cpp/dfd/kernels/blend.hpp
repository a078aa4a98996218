#pragma once

// Blended transforms, applied to a vertex and its normal. The entries of a transform are differences from those of the
// identity, so that the identity adds exactly 0.

#include "dfd/kernels/layout.hpp"

namespace dfd {
namespace {

// The weighted sum of each entry over the transforms of the handles and the default transform D_0.
template <class T, std::size_t Count>
struct Sums {
    Vector<T> entry[Count];
};

template <class T>
DFD_INLINE Vector<T> dot(const Vector3<T>& a, const Vector3<T>& b)
{
    return multiply_add(a.x, b.x, multiply_add(a.y, b.y, a.z * b.z));
}

template <class T>
DFD_INLINE Vector3<T> cross(const Vector3<T>& a, const Vector3<T>& b)
{
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <class T>
DFD_INLINE Vector3<T> sum(const Vector3<T>& a, const Vector3<T>& b)
{
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}

template <class T>
DFD_INLINE Vector3<T> scaled(const Vector3<T>& a, Vector<T> factor)
{
    return {a.x * factor, a.y * factor, a.z * factor};
}

// Returns the vector n at unit length. If n is 0, because a transform flattens the surface, returns `before` instead.
template <class T>
DFD_INLINE Vector3<T> unit_normal(const Vector3<T>& n, const Vector3<T>& before)
{
    const Vector<T> length = sqrt(n.x * n.x + n.y * n.y + n.z * n.z);
    const auto flat = equal(length, Vector<T>{});
    const Vector<T> scale = T(1) / select(flat, Vector<T>{} + T(1), length);
    return {select(flat, before.x, n.x * scale), select(flat, before.y, n.y * scale),
            select(flat, before.z, n.z * scale)};
}

// A blended affine transform minus the identity, (3, 4). Column 3 is the translation.
template <class T>
struct AffineSum {
    const Vector<T>* entry;

    DFD_INLINE Vector3<T> displacement(const Vector3<T>& p) const
    {
        const auto row = [&](std::size_t e) __attribute__((always_inline)) {
            return multiply_add(entry[e], p.x,
                                multiply_add(entry[e + 1], p.y, multiply_add(entry[e + 2], p.z, entry[e + 3])));
        };
        return {row(0), row(4), row(8)};
    }

    // Returns C · `normal` at unit length. C is the cofactor matrix of the sum `one` · I + linear entries.
    DFD_INLINE Vector3<T> transformed_normal(Vector<T> one, const Vector3<T>& normal) const
    {
        const Vector3<T> a{entry[0] + one, entry[1], entry[2]};
        const Vector3<T> b{entry[4], entry[5] + one, entry[6]};
        const Vector3<T> c{entry[8], entry[9], entry[10] + one};
        const auto triple = [&](const Vector3<T>& u, const Vector3<T>& v) __attribute__((always_inline)) {
            return (u.y * v.z - u.z * v.y) * normal.x + (u.z * v.x - u.x * v.z) * normal.y +
                   (u.x * v.y - u.y * v.x) * normal.z;
        };
        return unit_normal<T>({triple(b, c), triple(c, a), triple(a, b)}, normal);
    }
};

// A blended rotation, from the sums of the quaternion entries (w - 1, x, y, z).
template <class T>
struct RotationSum {
    Vector<T> scale, w;  // 1 / (length of the blended quaternion), and the real part at unit length
    Vector3<T> v;        // the imaginary part at unit length

    DFD_INLINE explicit RotationSum(const Vector<T>* entry)
    {
        const Vector<T> real = entry[0] + T(1);
        const Vector3<T> imaginary{entry[1], entry[2], entry[3]};
        // Quaternions of opposite rotations can add up to 0. In this case, the bound makes the displacement 0.
        constexpr T least = sizeof(T) == sizeof(float) ? T(1e-30f) : T(1e-200);
        scale = T(1) / sqrt(maximum(multiply_add(real, real, dot<T>(imaginary, imaginary)), splat(least)));
        w = real * scale;
        v = scaled<T>(imaginary, scale);
    }

    // Returns R p - p.
    DFD_INLINE Vector3<T> displacement(const Vector3<T>& p) const
    {
        const Vector3<T> across = cross<T>(v, p);
        const Vector3<T> sideways{multiply_add(w, p.x, across.x), multiply_add(w, p.y, across.y),
                                  multiply_add(w, p.z, across.z)};
        return scaled<T>(cross<T>(v, sideways), splat(T(2)));
    }
};

// A blended stretch: a symmetric matrix minus the identity, as xx, yy, zz, yz, zx, xy.
template <class T>
struct StretchSum {
    const Vector<T>* entry;

    DFD_INLINE Vector3<T> displacement(const Vector3<T>& p) const
    {
        return {multiply_add(entry[0], p.x, multiply_add(entry[5], p.y, entry[4] * p.z)),
                multiply_add(entry[5], p.x, multiply_add(entry[1], p.y, entry[3] * p.z)),
                multiply_add(entry[4], p.x, multiply_add(entry[3], p.y, entry[2] * p.z))};
    }

    // Returns the product of the stretch's cofactor matrix and a normal.
    DFD_INLINE Vector3<T> transformed_normal(const Vector3<T>& n) const
    {
        const Vector<T> xx = entry[0] + T(1), yy = entry[1] + T(1), zz = entry[2] + T(1);
        const Vector<T> yz = entry[3], zx = entry[4], xy = entry[5];
        const Vector<T> a = zx * yz - xy * zz, b = xy * yz - zx * yy, c = xy * zx - xx * yz;
        return {(yy * zz - yz * yz) * n.x + a * n.y + b * n.z, a * n.x + (xx * zz - zx * zx) * n.y + c * n.z,
                b * n.x + c * n.y + (xx * yy - xy * xy) * n.z};
    }
};

// The linear blend of Eq. (1).
template <class T>
struct LinearBlend {
    static constexpr std::size_t count = entries_of(Blend::linear, false);

    static DFD_INLINE Vector3<T> displacement(const Vector<T>* entry, const Vector3<T>& p)
    {
        return AffineSum<T>{entry}.displacement(p);
    }

    static DFD_INLINE Vector3<T> transformed_normal(const Vector<T>* entry, Vector<T> excess, const Vector3<T>& normal)
    {
        return AffineSum<T>{entry}.transformed_normal(excess + T(1), normal);
    }
};

// The blended stretch, followed by twice the rigid motion of the blended dual quaternion (Kavan, Collins, Žára,
// O'Sullivan, Geometric Skinning with Approximate Dual Quaternion Blending, 2008), and by the blended translation.
template <class T, bool Stretched>
struct DualQuaternionBlend {
    static constexpr std::size_t count = entries_of(Blend::dual_quaternion, Stretched);

    static DFD_INLINE Vector3<T> displacement(const Vector<T>* entry, const Vector3<T>& p)
    {
        const RotationSum<T> rotation(entry);
        Vector3<T> moved{entry[8], entry[9], entry[10]}, from = p;
        if constexpr (Stretched) {
            const Vector3<T> stretch = sum<T>(StretchSum<T>{entry + 11}.displacement(p), {entry[17], entry[18], entry[19]});
            moved = sum<T>(moved, stretch);
            from = sum<T>(p, stretch);
        }
        const Vector<T> dual_w = entry[4] * rotation.scale;
        const Vector3<T> dual = scaled<T>({entry[5], entry[6], entry[7]}, rotation.scale);
        const Vector3<T> across = cross<T>(rotation.v, dual);
        const auto translated = [&](Vector<T> d, Vector<T> v, Vector<T> c) __attribute__((always_inline)) {
            return T(2) * (multiply_add(rotation.w, d, c) - dual_w * v);
        };
        const Vector3<T> translation{translated(dual.x, rotation.v.x, across.x),
                                     translated(dual.y, rotation.v.y, across.y),
                                     translated(dual.z, rotation.v.z, across.z)};
        const Vector3<T> half = sum<T>(rotation.displacement(from), translation);
        const Vector3<T> other = sum<T>(rotation.displacement(sum<T>(from, half)), translation);
        return sum<T>(moved, sum<T>(half, other));
    }

    static DFD_INLINE Vector3<T> transformed_normal(const Vector<T>* entry, Vector<T>, const Vector3<T>& normal)
    {
        Vector3<T> n = normal;
        if constexpr (Stretched) n = StretchSum<T>{entry + 11}.transformed_normal(normal);
        const RotationSum<T> rotation(entry);
        n = sum<T>(n, rotation.displacement(n));
        return unit_normal<T>(sum<T>(n, rotation.displacement(n)), normal);
    }
};

}  // namespace
}  // namespace dfd
