#include "dfd/common/polar.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dfd {
namespace {

constexpr double rounding = 1e-12;  // entries of the stretch with a smaller absolute value are set to 0

double dot(const Vector3d& a, const Vector3d& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Vector3d cross(const Vector3d& a, const Vector3d& b)
{
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vector3d combined(double a, const Vector3d& u, double b, const Vector3d& v)
{
    return {a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2]};
}

using Columns = std::array<Vector3d, 3>;

double determinant(const Columns& m) { return dot(m[0], cross(m[1], m[2])); }

/// A singular value decomposition A = U diag(sizes) Vᵀ, in which U and V have unit columns.
struct Svd {
    Columns u, v;
    Vector3d sizes;
};

/// Returns the component of `direction` that is perpendicular to the unit vector `axis`.
Vector3d perpendicular(const Vector3d& direction, const Vector3d& axis)
{
    return combined(1, direction, -dot(direction, axis), axis);
}

/// Sets the columns of U whose singular value is 0, so that U is orthogonal and R = U Vᵀ is a small rotation. `largest`
/// is the largest singular value.
void complete_u(Svd& svd, double largest)
{
    std::array<bool, 3> known;
    for (std::size_t j = 0; j < 3; ++j) known[j] = svd.sizes[j] > 1e-14 * largest;
    const auto count = std::count(known.begin(), known.end(), true);
    if (count == 3) return;
    if (count == 0) {
        svd.u = svd.v;
        return;
    }
    if (count == 1) {
        const auto j = static_cast<std::size_t>(std::find(known.begin(), known.end(), true) - known.begin());
        const std::size_t a = (j + 1) % 3, b = (j + 2) % 3;
        const Vector3d first = perpendicular(svd.v[a], svd.u[j]), second = perpendicular(svd.v[b], svd.u[j]);
        const bool take_first = dot(first, first) >= dot(second, second);
        const Vector3d& taken = take_first ? first : second;
        svd.u[take_first ? a : b] = combined(1 / std::sqrt(dot(taken, taken)), taken, 0, taken);
        known[take_first ? a : b] = true;
    }
    const auto j = static_cast<std::size_t>(std::find(known.begin(), known.end(), false) - known.begin());
    svd.u[j] = cross(svd.u[(j + 1) % 3], svd.u[(j + 2) % 3]);
    if (determinant(svd.v) < 0) svd.u[j] = combined(-1, svd.u[j], 0, svd.u[j]);
}

/// Returns the singular value decomposition of I + `change` by one-sided Jacobi rotations. For a stretch along the
/// coordinate axes, V is the identity.
Svd singular_values(const Matrix3d& change)
{
    Columns a, v{Vector3d{1, 0, 0}, Vector3d{0, 1, 0}, Vector3d{0, 0, 1}};
    double unit = 1;  // scale that prevents overflow of squares
    for (const double entry : change) unit = std::max(unit, std::abs(entry));
    for (std::size_t row = 0; row < 3; ++row)
        for (std::size_t column = 0; column < 3; ++column)
            a[column][row] = (change[row * 3 + column] + (row == column ? 1.0 : 0.0)) / unit;
    constexpr int sweeps = 30;  // matrices of three columns converge in far fewer sweeps
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        bool turned = false;
        for (const auto& [p, q] : {std::pair<std::size_t, std::size_t>{0, 1}, {0, 2}, {1, 2}}) {
            const double pp = dot(a[p], a[p]), qq = dot(a[q], a[q]), pq = dot(a[p], a[q]);
            if (!(std::abs(pq) > 1e-16 * std::sqrt(pp * qq))) continue;
            turned = true;
            const double zeta = (qq - pp) / (2 * pq);
            const double tangent = (zeta >= 0 ? 1 : -1) / (std::abs(zeta) + std::hypot(1.0, zeta));
            const double cosine = 1 / std::hypot(1.0, tangent), sine = cosine * tangent;
            for (Columns* m : {&a, &v}) {
                const Vector3d column = (*m)[p];
                (*m)[p] = combined(cosine, column, -sine, (*m)[q]);
                (*m)[q] = combined(sine, column, cosine, (*m)[q]);
            }
        }
        if (!turned) break;
    }
    Svd result{a, v, {}};
    double largest = 0;
    for (std::size_t j = 0; j < 3; ++j) {
        const double size = std::sqrt(dot(a[j], a[j]));
        largest = std::max(largest, size);
        result.sizes[j] = size * unit;
        if (size > 0) result.u[j] = combined(1 / size, a[j], 0, a[j]);
    }
    complete_u(result, largest * unit);
    return result;
}

/// Returns the quaternion of R = U Vᵀ. The largest of its four components is computed first (S. W. Shepperd, 1978).
Quaternion quaternion_of(const Columns& u, const Columns& v)
{
    const auto r = [&](std::size_t row, std::size_t column) {
        return u[0][row] * v[0][column] + u[1][row] * v[1][column] + u[2][row] * v[2][column];
    };
    const double x = r(0, 0), y = r(1, 1), z = r(2, 2);
    const std::array<double, 4> squares{1 + x + y + z, 1 + x - y - z, 1 - x + y - z, 1 - x - y + z};
    Quaternion q;
    switch (std::max_element(squares.begin(), squares.end()) - squares.begin()) {
    case 0: q = {squares[0], r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)}; break;
    case 1: q = {r(2, 1) - r(1, 2), squares[1], r(0, 1) + r(1, 0), r(0, 2) + r(2, 0)}; break;
    case 2: q = {r(0, 2) - r(2, 0), r(0, 1) + r(1, 0), squares[2], r(1, 2) + r(2, 1)}; break;
    default: q = {r(1, 0) - r(0, 1), r(0, 2) + r(2, 0), r(1, 2) + r(2, 1), squares[3]}; break;
    }
    const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const double signed_length = q[0] < 0 ? -length : length;
    for (double& entry : q) entry /= signed_length;
    return q;
}

}  // namespace

Polar polar_decomposition(const Matrix3d& change)
{
    if (std::all_of(change.begin(), change.end(), [](double entry) { return entry == 0; })) return {{1, 0, 0, 0}, {}};
    Svd svd = singular_values(change);
    if (determinant(svd.u) * determinant(svd.v) < 0) {
        Vector3d agreement;  // dot product of column j of U with column j of V; the sum over j is R's trace
        for (std::size_t j = 0; j < 3; ++j) agreement[j] = dot(svd.u[j], svd.v[j]);
        const double trace = agreement[0] + agreement[1] + agreement[2];
        const auto least = std::min_element(agreement.begin(), agreement.end());
        const auto flipped = static_cast<std::size_t>(least - agreement.begin());
        for (std::size_t j = 0; j < 3; ++j) {
            if (j != flipped && -trace <= trace - 2 * agreement[flipped]) continue;
            svd.u[j] = combined(-1, svd.u[j], 0, svd.u[j]);
            svd.sizes[j] = -svd.sizes[j];
        }
    }
    Polar result{quaternion_of(svd.u, svd.v), {}};
    constexpr std::array<std::size_t, 6> rows{0, 1, 2, 1, 2, 0}, columns{0, 1, 2, 2, 0, 1};
    for (std::size_t e = 0; e < 6; ++e) {
        const std::size_t row = rows[e], column = columns[e];
        for (std::size_t j = 0; j < 3; ++j) result.stretch[e] += (svd.sizes[j] - 1) * svd.v[j][row] * svd.v[j][column];
        if (std::abs(result.stretch[e]) < rounding) result.stretch[e] = 0;
    }
    return result;
}

Vector3d rotation_displacement(const Quaternion& rotation, const Vector3d& point)
{
    const Vector3d v{rotation[1], rotation[2], rotation[3]};
    const Vector3d sideways = combined(rotation[0], point, 1, cross(v, point));
    return combined(2, cross(v, sideways), 0, point);
}

}  // namespace dfd
