#pragma once

// The tables of transforms that the kernels blend, and the job of a kernel, for posing and for its gradients.

#include "dfd/common/require.hpp"
#include "dfd/pose.hpp"

#include <algorithm>
#include <vector>

namespace dfd {

using Point = Vector3d;
using Matrix3d = std::array<double, 9>;  // row-major

inline double dot(const Point& a, const Point& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

inline Point product(const Matrix3d& m, const Point& p)
{
    return {dot({m[0], m[1], m[2]}, p), dot({m[3], m[4], m[5]}, p), dot({m[6], m[7], m[8]}, p)};
}

inline Point cross(const Point& a, const Point& b)
{
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline Point sum(const Point& a, const Point& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }

inline Point difference(const Point& a, const Point& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

/// A transform that displaces a point p by `change` p + `shift`.
struct Displacement {
    Matrix3d change;  // linear part minus the identity
    Point shift;
};

inline Displacement displacement_of(const Affine& transform)
{
    Displacement d{{}, {transform[3], transform[7], transform[11]}};
    for (std::size_t row = 0; row < 3; ++row)
        for (std::size_t column = 0; column < 3; ++column)
            d.change[row * 3 + column] = transform[row * 4 + column] - (row == column ? 1.0 : 0.0);
    return d;
}

/// Returns R p - p for a `point` p and the matrix R of a unit quaternion. The result is exactly 0 if R is the identity.
inline Point rotation_displacement(const std::array<double, 4>& rotation, const Point& point)
{
    const Point v{rotation[1], rotation[2], rotation[3]}, around = cross(v, point);
    const double w = rotation[0];
    const Point half = cross(v, {w * point[0] + around[0], w * point[1] + around[1], w * point[2] + around[2]});
    return {2 * half[0], 2 * half[1], 2 * half[2]};
}

/// Returns R M R for the matrices M = `m` and R = `reflection`.
inline Matrix3d reflected(const Matrix3d& m, const Matrix3d& reflection)
{
    Matrix3d half{}, result{};
    for (std::size_t i = 0; i < 9; ++i)
        for (std::size_t k = 0; k < 3; ++k) half[i] += reflection[i / 3 * 3 + k] * m[k * 3 + i % 3];
    for (std::size_t i = 0; i < 9; ++i)
        for (std::size_t k = 0; k < 3; ++k) result[i] += half[i / 3 * 3 + k] * reflection[k * 3 + i % 3];
    return result;
}

/// Returns the linear part R of the reflection p ↦ R p + a across the mirror plane of Eq. (8).
inline Matrix3d reflection_of(const Mirror& mirror)
{
    Matrix3d reflection;
    for (std::size_t i = 0; i < 9; ++i)
        reflection[i] = (i % 4 == 0 ? 1.0 : 0.0) - 2 * mirror.normal[i / 3] * mirror.normal[i % 3];
    return reflection;
}

/// Returns the translation a of the reflection p ↦ R p + a.
inline Point across_of(const Mirror& mirror)
{
    const double twice = 2 * mirror.offset;
    return {twice * mirror.normal[0], twice * mirror.normal[1], twice * mirror.normal[2]};
}

/// Returns the displacement of R D R in Eq. (8), in which R is the reflection across the mirror plane.
inline Displacement reflected(const Displacement& d, const Mirror& mirror)
{
    const Matrix3d reflection = reflection_of(mirror);
    const Point across = across_of(mirror);
    return {reflected(d.change, reflection), product(reflection, sum(product(d.change, across), d.shift))};
}

inline bool has_stretch(const Polar& polar)
{
    const auto moves = [](double entry) { return entry != 0; };
    return std::any_of(polar.stretch.begin(), polar.stretch.end(), moves) ||
           std::any_of(polar.stretch_shift.begin(), polar.stretch_shift.end(), moves);
}

/// Appends the entries of a transform (see `entries_of`) to `table`. They apply to points relative to `center`.
inline void append(std::vector<double>& table, const Displacement& d, const Point& center)
{
    const Point shift = sum(d.shift, product(d.change, center));
    for (std::size_t row = 0; row < 3; ++row) {
        table.insert(table.end(), &d.change[3 * row], &d.change[3 * row] + 3);
        table.push_back(shift[row]);
    }
}

inline void append(std::vector<double>& table, const Polar& polar, const Point& center, bool stretched)
{
    const auto& q = polar.rotation;
    const Point t = sum(rotation_displacement(q, center), polar.shift);
    table.push_back(q[0] - 1);
    table.insert(table.end(), q.begin() + 1, q.end());
    table.push_back(-0.5 * (t[0] * q[1] + t[1] * q[2] + t[2] * q[3]));
    for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t a = (k + 1) % 3, b = (k + 2) % 3;
        table.push_back(0.5 * (q[0] * t[k] + t[a] * q[b + 1] - t[b] * q[a + 1]));
    }
    table.insert(table.end(), polar.translation.begin(), polar.translation.end());
    if (!stretched) return;
    table.insert(table.end(), polar.stretch.begin(), polar.stretch.end());
    const auto& [xx, yy, zz, yz, zx, xy] = polar.stretch;
    const Point shift = sum(product({xx, xy, zx, xy, yy, yz, zx, yz, zz}, center), polar.stretch_shift);
    table.insert(table.end(), shift.begin(), shift.end());
}

/// Replaces `table` (H, entries) by `mixing` · `table`. Blending is linear in the entries, so the effect is the same as
/// that of weights · `mixing`.
inline void mix(std::vector<double>& table, const Motion& motion, std::size_t entries)
{
    if (motion.mixing.empty() || table.empty()) return;
    const std::size_t count = motion.transforms.size();
    const std::vector<double> given = table;
    for (std::size_t m = 0; m < count; ++m) {
        for (std::size_t e = 0; e < entries; ++e) {
            double& entry = table[m * entries + e] = 0;
            for (std::size_t k = 0; k < count; ++k) entry += motion.mixing[m * count + k] * given[k * entries + e];
        }
    }
}

template <class T>
std::vector<T> narrowed(const std::vector<double>& numbers)
{
    std::vector<T> result;
    result.reserve(numbers.size());
    for (const double number : numbers) result.push_back(static_cast<T>(number));
    return result;
}

/// The entries (see `entries_of`) that kernels blend. `rest` has the entries of D_0. `positive` and `negative` have the
/// handles' entries for vertices on each side of the mirror plane. `shares` (H) are the row sums of `mixing`, or empty.
template <class T>
struct Tables {
    std::vector<T> rest, positive, negative, shares;
    bool stretched;

    Tables(const Motion& motion, const Point& center)
    {
        const std::size_t handle_count = motion.transforms.size();
        stretched = std::any_of(motion.polar.begin(), motion.polar.end(), has_stretch);
        std::vector<double> positive_entries, negative_entries, rest_entries;
        const auto add = [&](std::vector<double>& table, std::size_t k, bool mirrored) {
            if (motion.blend != Blend::linear) {
                append(table, motion.polar[mirrored ? handle_count + k : k], center, stretched);
            } else {
                const Displacement d = displacement_of(motion.transforms[k]);
                append(table, mirrored ? reflected(d, *motion.mirror) : d, center);
            }
        };
        for (std::size_t k = 0; k < handle_count; ++k) {
            const bool on_negative_side = motion.mirror && !motion.mirror->positive[k];
            add(positive_entries, k, on_negative_side);
            if (motion.mirror) add(negative_entries, k, !on_negative_side);
        }
        if (motion.blend == Blend::linear) append(rest_entries, displacement_of(motion.rest), center);
        else append(rest_entries, motion.polar.back(), center, stretched);
        const std::size_t entries = entries_of(motion.blend, stretched);
        mix(positive_entries, motion, entries);
        mix(negative_entries, motion, entries);
        rest = narrowed<T>(rest_entries);
        positive = narrowed<T>(positive_entries);
        negative = narrowed<T>(negative_entries);
        const std::size_t count = motion.mixing.empty() ? 0 : handle_count;
        for (std::size_t m = 0; m < count; ++m) {
            double share = 0;
            for (std::size_t k = 0; k < count; ++k) share += motion.mixing[m * count + k];
            shares.push_back(static_cast<T>(share));
        }
    }
};

template <class T>
bool is_n_by_3(const Matrix<T>& matrix, std::size_t rows)
{
    return matrix.rows == rows && matrix.columns == 3;
}

inline void require_finite_transforms(const Motion& motion)
{
    for (std::size_t k = 0; k < motion.transforms.size(); ++k) {
        const Affine& transform = motion.transforms[k];
        const auto found = std::find_if(transform.begin(), transform.end(), [](double x) { return !std::isfinite(x); });
        if (found == transform.end()) continue;
        const auto entry = static_cast<std::size_t>(found - transform.begin());
        refuse("pose: `transforms` must be finite", *found, {k, entry / 4, entry % 4});
    }
    require_finite(Matrix<const double>{motion.rest.data(), 3, 4}, "pose", "default");
}

/// Returns the point to which the coordinates of transforms are relative: the first vertex.
template <class T>
Point center_of(const PoseArrays<T>& arrays)
{
    Point center;
    for (std::size_t axis = 0; axis < 3; ++axis) center[axis] = static_cast<double>(arrays.vertices.data[axis]);
    return center;
}

/// Returns the job that poses `arrays`, which are not empty. It refers to `tables`.
template <class T>
PoseJob<T> pose_job(const PoseArrays<T>& arrays, const Motion& motion, const Tables<T>& tables, const Point& center)
{
    PoseJob<T> job;
    job.vertices = arrays.vertices.data;
    job.vertex_count = arrays.vertices.rows;
    job.weights = arrays.weights.data;
    job.row_stride = arrays.weights.row_stride;
    job.column_stride = arrays.weights.column_stride;
    job.handle_count = motion.transforms.size();
    job.overlap = motion.overlap;
    job.blend = motion.blend;
    job.stretched = tables.stretched;
    job.positive = tables.positive.data();
    job.negative = motion.mirror ? tables.negative.data() : nullptr;
    const bool identity = std::all_of(tables.rest.begin(), tables.rest.end(), [](T entry) { return entry == 0; });
    job.rest = identity || arrays.base.data != nullptr ? nullptr : tables.rest.data();
    job.shares = tables.shares.empty() ? nullptr : tables.shares.data();
    job.base = arrays.base.data;
    job.normals = arrays.normals.data;
    job.posed_normals = arrays.posed_normals.data;
    job.posed = arrays.posed.data;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        job.center[axis] = static_cast<T>(center[axis]);
        if (motion.mirror) job.normal[axis] = static_cast<T>(motion.mirror->normal[axis]);
    }
    if (motion.mirror) {
        const auto& [normal, offset, band, sides] = *motion.mirror;
        job.height = static_cast<T>(normal[0] * center[0] + normal[1] * center[1] + normal[2] * center[2] - offset);
        job.steepness = band > 0 ? static_cast<T>(0.5 / band) : T{0};
    }
    return job;
}

}  // namespace dfd
