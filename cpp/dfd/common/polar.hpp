#pragma once

#include <array>

namespace dfd {

using Vector3d = std::array<double, 3>;
using Matrix3d = std::array<double, 9>;     // row-major
using Quaternion = std::array<double, 4>;   // w, x, y, z
using Symmetric3d = std::array<double, 6>;  // xx, yy, zz, yz, zx, xy

/// A linear map A = R S: a stretch along perpendicular axes, followed by a rotation.
struct Polar {
    Quaternion rotation;  // unit, w >= 0
    Symmetric3d stretch;  // S - I
};

/// Returns the polar decomposition of I + `change`. If the map contains a reflection, S reflects along one of its axes
/// or along all three, whichever makes R the smaller rotation.
Polar polar_decomposition(const Matrix3d& change);

/// Returns R p - p for a `point` p and the matrix R of a unit quaternion. The result is exactly 0 if R is the identity.
Vector3d rotation_displacement(const Quaternion& rotation, const Vector3d& point);

}  // namespace dfd
