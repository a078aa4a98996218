#include "dfd/common/polar.hpp"

#include "check.hpp"

#include <random>

namespace {

using dfd::Matrix3d;

// Returns R S - I for the rotation R and the stretch S of a decomposition.
Matrix3d composed(const dfd::Polar& polar)
{
    const auto& [xx, yy, zz, yz, zx, xy] = polar.stretch;
    const Matrix3d s{xx + 1, xy, zx, xy, yy + 1, yz, zx, yz, zz + 1};
    Matrix3d result;
    for (std::size_t column = 0; column < 3; ++column) {
        const dfd::Vector3d axis{s[column], s[3 + column], s[6 + column]};
        const dfd::Vector3d turned = dfd::rotation_displacement(polar.rotation, axis);
        for (std::size_t row = 0; row < 3; ++row)
            result[row * 3 + column] = axis[row] + turned[row] - (row == column ? 1 : 0);
    }
    return result;
}

void check_composed(const Matrix3d& change, double size = 1)
{
    const dfd::Polar polar = dfd::polar_decomposition(change);
    const Matrix3d again = composed(polar);
    for (std::size_t k = 0; k < 9; ++k) CHECK_NEAR(again[k], change[k], 1e-12 * size);
    const auto& [w, x, y, z] = polar.rotation;
    CHECK_NEAR(w * w + x * x + y * y + z * z, 1, 1e-14);
    CHECK(w >= 0);
}

}  // namespace

CASE("the product of rotation and stretch is the decomposed matrix")
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    for (int trial = 0; trial < 2000; ++trial) {
        Matrix3d change;
        for (double& entry : change) entry = normal(random);
        check_composed(change);
    }
END

CASE("the identity and pure stretches have the identity rotation")
    const dfd::Polar still = dfd::polar_decomposition({});
    CHECK(still.rotation == (dfd::Quaternion{1, 0, 0, 0}) && still.stretch == dfd::Symmetric3d{});
    for (const double x : {1.0, -0.5, -1.0, -2.0, 1e100}) {
        const dfd::Polar scaled = dfd::polar_decomposition({x, 0, 0, 0, 0.5, 0, 0, 0, 0});
        CHECK(scaled.rotation == (dfd::Quaternion{1, 0, 0, 0}));
        CHECK_NEAR(scaled.stretch[0] / x, 1, 1e-14);
        CHECK_NEAR(scaled.stretch[1], 0.5, 1e-14);
    }
END

CASE("maps onto a plane, a line or a point, and maps with large entries are decomposed")
    check_composed({-1, 0, 0, 0, 0, 0, 0, 0, 0});
    check_composed({-1, 0, 0, 0, -1, 0, 0, 0, 1});
    check_composed({-1, 0, 0, 0, -1, 0, 0, 0, -1});
    check_composed({-1, 1, 0, 0, -1, 0, 0, 0, -1});  // (x, y, z) -> (y, 0, 0)
    check_composed({0, 1, 2, 2, 1, 4, 3, 3, 5});     // the rows of the matrix are linearly dependent
    check_composed({1e150, 2e150, -1e150, 3e150, 0, 1e150, 5e149, 1e150, 2e150}, 4e150);
    for (const Matrix3d& change : {Matrix3d{-1, 0, 0, 0, 0, 0, 0, 0, 0}, Matrix3d{-1, 0, 0, 0, -1, 0, 0, 0, 1},
                                   Matrix3d{-1, 0, 0, 0, -1, 0, 0, 0, -1}})
        CHECK_NEAR(dfd::polar_decomposition(change).rotation[0], 1, 1e-14);
END
