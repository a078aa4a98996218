#include "dfd/pose.hpp"

#include "dfd/parallel.hpp"
#include "dfd/require.hpp"

#include <atomic>
#include <cmath>
#include <vector>

namespace dfd {
namespace {

constexpr std::size_t grain = 256;  // vertices

using Point = std::array<double, 3>;

template <class T>
using Displacement = std::array<T, 12>;

/// D - I about `center`: what D adds to a point p is linear (p - center) + translation.
template <class T>
Displacement<T> displacement(const Affine& transform, const Point& center)
{
    Displacement<T> result;
    for (std::size_t row = 0; row < 3; ++row) {
        double shift = transform[row * 4 + 3];
        for (std::size_t column = 0; column < 3; ++column) {
            const double entry = transform[row * 4 + column] - (row == column ? 1.0 : 0.0);
            shift += entry * center[column];
            result[row * 4 + column] = static_cast<T>(entry);
        }
        result[row * 4 + 3] = static_cast<T>(shift);
    }
    return result;
}

/// R D R for the reflection R across the plane.
Affine reflected(const Affine& transform, const Mirror& mirror)
{
    const auto& n = mirror.normal;
    const auto multiply = [](const Affine& a, const Affine& b) {
        Affine product{};
        for (std::size_t row = 0; row < 3; ++row) {
            for (std::size_t column = 0; column < 4; ++column) {
                for (std::size_t k = 0; k < 3; ++k) product[row * 4 + column] += a[row * 4 + k] * b[k * 4 + column];
            }
            product[row * 4 + 3] += a[row * 4 + 3];
        }
        return product;
    };
    Affine reflection;
    for (std::size_t row = 0; row < 3; ++row) {
        for (std::size_t column = 0; column < 3; ++column)
            reflection[row * 4 + column] = (row == column ? 1.0 : 0.0) - 2.0 * n[row] * n[column];
        reflection[row * 4 + 3] = 2.0 * mirror.offset * n[row];
    }
    return multiply(multiply(reflection, transform), reflection);
}

/// How much of a vertex belongs to the positive side, in [0, 1]: a step, or a smoothstep over the band.
double positive_share(double signed_distance, double band)
{
    if (!(band > 0)) return signed_distance >= 0 ? 1.0 : 0.0;
    const double t = std::min(std::max(signed_distance / (2 * band) + 0.5, 0.0), 1.0);
    return t * t * (3 - 2 * t);
}

/// What the handles with their `weights` add to the point `p`, given relative to the center.
template <class T>
std::array<T, 3> blended(const std::vector<Displacement<T>>& table, std::span<const float> weights, T left,
                         const Displacement<T>& rest, const std::array<T, 3>& p)
{
    Displacement<T> blend;
    for (std::size_t entry = 0; entry < 12; ++entry) blend[entry] = left * rest[entry];
    for (std::size_t k = 0; k < table.size(); ++k)
        for (std::size_t entry = 0; entry < 12; ++entry) blend[entry] += static_cast<T>(weights[k]) * table[k][entry];
    std::array<T, 3> result;
    for (std::size_t row = 0; row < 3; ++row)
        result[row] = blend[row * 4] * p[0] + blend[row * 4 + 1] * p[1] + blend[row * 4 + 2] * p[2] + blend[row * 4 + 3];
    return result;
}

}  // namespace

template <class T>
void pose(Matrix<const T> vertices, Matrix<const float> weights, std::span<const Affine> transforms,
          const Affine& rest, const std::optional<Mirror>& mirror, Matrix<T> posed, int threads)
{
    require(vertices.columns == 3 && posed.columns == 3 && posed.rows == vertices.rows,
            "pose: `vertices` and `out` must be (V, 3)");
    require(weights.rows == vertices.rows && weights.columns == transforms.size(), "pose: `weights` must be (V, H)");
    require(!mirror || mirror->positive.size() == transforms.size(), "pose: `symmetry` must know every handle's side");
    if (vertices.rows == 0) return;

    Point center;
    for (std::size_t axis = 0; axis < 3; ++axis) center[axis] = static_cast<double>(vertices.data[axis]);
    const Displacement<T> default_displacement = displacement<T>(rest, center);
    std::vector<Displacement<T>> positive, negative;  // what the handles do on either side
    for (std::size_t k = 0; k < transforms.size(); ++k) {
        const Displacement<T> own = displacement<T>(transforms[k], center);
        if (!mirror) {
            positive.push_back(own);
            continue;
        }
        const Displacement<T> other = displacement<T>(reflected(transforms[k], *mirror), center);
        positive.push_back(mirror->positive[k] ? own : other);
        negative.push_back(mirror->positive[k] ? other : own);
    }

    std::atomic<bool> finite = true;
    parallel_ranges(vertices.rows, grain, threads, [&](std::size_t begin, std::size_t end) {
        bool all = true;
        for (std::size_t i = begin; i < end; ++i) {
            const T* vertex = vertices.row(i).data();
            std::array<T, 3> p;
            for (std::size_t axis = 0; axis < 3; ++axis) p[axis] = vertex[axis] - static_cast<T>(center[axis]);
            T sum = 0;
            for (const float w : weights.row(i)) sum += static_cast<T>(w);
            const T left = std::max(T{1} - sum, T{0});
            const T excess = std::max(sum - T{1}, T{0});  // Equation (1) scales a vertex whose weights pass 1

            double share = 1;
            if (mirror) {
                double height = -mirror->offset;
                for (std::size_t axis = 0; axis < 3; ++axis)
                    height += mirror->normal[axis] * static_cast<double>(vertex[axis]);
                share = positive_share(height, mirror->band);
            }
            const auto& main = share > 0 ? positive : negative;
            std::array<T, 3> shift = blended(main, weights.row(i), left, default_displacement, p);
            if (share > 0 && share < 1) {
                const auto other = blended(negative, weights.row(i), left, default_displacement, p);
                for (std::size_t axis = 0; axis < 3; ++axis)
                    shift[axis] = other[axis] + static_cast<T>(share) * (shift[axis] - other[axis]);
            }
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const T moved = vertex[axis] + (shift[axis] + excess * vertex[axis]);
                all &= std::isfinite(moved);
                posed.row(i)[axis] = moved;
            }
        }
        if (!all) finite = false;
    });
    if (finite) return;
    require_finite(vertices, "pose", "vertices");
    require_finite(weights, "pose", "weights");
    throw std::invalid_argument("pose: `transforms` move a vertex beyond the largest number that its type holds");
}

template void pose(Matrix<const float>, Matrix<const float>, std::span<const Affine>, const Affine&,
                   const std::optional<Mirror>&, Matrix<float>, int);
template void pose(Matrix<const double>, Matrix<const float>, std::span<const Affine>, const Affine&,
                   const std::optional<Mirror>&, Matrix<double>, int);

}  // namespace dfd
