#include "dfd/shading.hpp"

#include "dfd/common/require.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dfd {
namespace {

constexpr float cancelled = 0.2f;  // a blend of unit normals shorter than this says nothing

template <class T>
using Vector = std::array<T, 3>;

template <class T>
T dot(const Vector<T>& a, const Vector<T>& b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// Rows that three indices name, without a look at what the rest of the matrix holds.
struct Corners {
    Corners(Matrix<const float> values, const std::int32_t* rows)
    {
        for (std::size_t i = 0; i < 3; ++i) of[i] = values.data + static_cast<std::size_t>(rows[i]) * values.columns;
    }
    float blended(std::size_t column, const float* weights) const
    {
        return weights[0] * of[0][column] + weights[1] * of[1][column] + weights[2] * of[2][column];
    }
    Vector<double> edge(std::size_t corner) const
    {
        Vector<double> edge;
        for (std::size_t i = 0; i < 3; ++i) edge[i] = static_cast<double>(of[corner][i]) - static_cast<double>(of[0][i]);
        return edge;
    }
    const float* of[3];
};

/// The unit normal of a triangle; zero for one without area.
Vector<float> triangle_normal(const Corners& corners)
{
    const Vector<double> u = corners.edge(1), v = corners.edge(2);
    const Vector<double> crossed{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    const double length = std::max<double>(std::sqrt(dot(crossed, crossed)), std::numeric_limits<float>::min());
    return {static_cast<float>(crossed[0] / length), static_cast<float>(crossed[1] / length),
            static_cast<float>(crossed[2] / length)};
}

void require_below(std::span<const std::int64_t> indices, std::size_t count, const char* message)
{
    for (const std::int64_t index : indices) require(index >= 0 && static_cast<std::size_t>(index) < count, message);
}

}  // namespace

void blend(Matrix<const float> values, Matrix<const std::int32_t> rows, Matrix<const float> weights, Matrix<float> out)
{
    require_indices(rows, 3, values.rows, "blend: `rows` must be (N, 3) rows of `values`");
    require(weights.rows == rows.rows && weights.columns == 3, "blend: `weights` must have shape (N, 3)");
    require(out.rows == rows.rows && out.columns == values.columns, "blend: `out` must have shape (N, K)");
    for (std::size_t point = 0; point < rows.rows; ++point) {
        const Corners corners(values, rows.data + 3 * point);
        for (std::size_t k = 0; k < out.columns; ++k)
            out.data[point * out.columns + k] = corners.blended(k, weights.data + 3 * point);
    }
}

void facing(Matrix<const float> vertices, Matrix<const float> normals, const RayHits& hits, Matrix<float> out)
{
    const std::size_t count = hits.corners.rows;
    require(vertices.columns == 3, "facing: `vertices` must have shape (V, 3)");
    require(normals.columns == 3 && normals.rows == vertices.rows, "facing: `normals` must have shape (V, 3)");
    require_indices(hits.corners, 3, vertices.rows, "facing: `corners` must be (N, 3) vertex indices");
    require(hits.barycentric.rows == count && hits.barycentric.columns == 3,
            "facing: `barycentric` must have shape (N, 3)");
    require(hits.rays.size() == count, "facing: `rays` must have shape (N,)");
    require(hits.directions.columns == 3, "facing: `directions` must have a row of 3 for each ray");
    require_below(hits.rays, hits.directions.rows, "facing: `rays` must be rows of `directions`");
    require(out.rows == count && out.columns == 1, "facing: `out` must have shape (N, 1)");
    for (std::size_t hit = 0; hit < count; ++hit) {
        const std::int32_t* rows = hits.corners.data + 3 * hit;
        const float* weights = hits.barycentric.data + 3 * hit;
        const Corners around(normals, rows);
        Vector<float> normal{around.blended(0, weights), around.blended(1, weights), around.blended(2, weights)};
        float length = std::sqrt(dot(normal, normal));
        if (length < cancelled) {
            normal = triangle_normal({vertices, rows});
            length = 1;
        }
        const float* direction = hits.directions.data + 3 * static_cast<std::size_t>(hits.rays[hit]);
        const float along = std::abs(dot(normal, {direction[0], direction[1], direction[2]}));
        out.data[hit] = std::min(along / length, 1.0f);
    }
}

void paint(Matrix<const float> colors, std::span<const std::int64_t> pixels, Matrix<std::uint8_t> image)
{
    require(colors.columns == 4 && colors.rows == pixels.size(), "paint: `colors` must have shape (N, 4)");
    require(image.columns == 3, "paint: `image` must have shape (pixels, 3)");
    require_below(pixels, image.rows, "paint: `pixels` must be rows of `image`");
    for (std::size_t i = 0; i < pixels.size(); ++i)
        for (std::size_t k = 0; k < 3; ++k)
            image.data[3 * static_cast<std::size_t>(pixels[i]) + k] =
                static_cast<std::uint8_t>(std::min(std::max(0.0f, colors.data[4 * i + k] * 255.0f + 0.5f), 255.0f));
}

}  // namespace dfd
