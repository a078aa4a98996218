#include "dfd/topology.hpp"

#include "dfd/common/parallel.hpp"
#include "dfd/common/require.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace dfd {

std::vector<std::int32_t> components(std::size_t vertex_count, Matrix<const std::int32_t> faces,
                                     Matrix<const std::int32_t> links)
{
    require_indices(faces, 3, vertex_count, "components: `faces` must be (F, 3) vertex indices");
    require_indices(links, 2, vertex_count, "components: `links` must be (L, 2) vertex indices");
    std::vector<std::int32_t> parent(vertex_count);
    std::iota(parent.begin(), parent.end(), 0);
    const auto find = [&](std::int32_t vertex) {
        auto v = static_cast<std::size_t>(vertex);
        while (parent[v] != static_cast<std::int32_t>(v)) {
            parent[v] = parent[static_cast<std::size_t>(parent[v])];
            v = static_cast<std::size_t>(parent[v]);
        }
        return static_cast<std::int32_t>(v);
    };
    const auto join = [&](std::int32_t a, std::int32_t b) {
        a = find(a), b = find(b);
        // The smaller index is the root, so that components are numbered in the order of their first vertices.
        if (a < b) parent[static_cast<std::size_t>(b)] = a;
        else parent[static_cast<std::size_t>(a)] = b;
    };
    for (std::size_t f = 0; f < faces.rows; ++f) {
        join(faces.row(f)[0], faces.row(f)[1]);
        join(faces.row(f)[1], faces.row(f)[2]);
    }
    for (std::size_t l = 0; l < links.rows; ++l) join(links.row(l)[0], links.row(l)[1]);
    std::vector<std::int32_t> number(vertex_count);
    std::int32_t count = 0;
    for (std::size_t v = 0; v < vertex_count; ++v) {
        const std::int32_t top = find(static_cast<std::int32_t>(v));
        number[v] = top == static_cast<std::int32_t>(v) ? count++ : number[static_cast<std::size_t>(top)];
    }
    return number;
}

void face_sizes(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<double> out, int threads)
{
    using Vector = std::array<double, 3>;
    require(vertices.columns == 3, "face_sizes: `vertices` must have shape (V, 3)");
    require_indices(faces, 3, vertices.rows, "face_sizes: `faces` must be (F, 3) vertex indices");
    require(out.rows == faces.rows && out.columns == 2, "face_sizes: `out` must have shape (F, 2)");
    const auto difference = [&](std::int32_t from, std::int32_t to) {
        const auto a = vertices.row(static_cast<std::size_t>(from)), b = vertices.row(static_cast<std::size_t>(to));
        return Vector{b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    };
    const auto squared = [](const Vector& v) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; };
    parallel_ranges(faces.rows, 4096, threads, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t f = begin; f < end; ++f) {
            const auto corners = faces.row(f);
            const Vector u = difference(corners[0], corners[1]), v = difference(corners[0], corners[2]);
            const Vector w = difference(corners[1], corners[2]);
            const Vector crossed{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
            out.row(f)[0] = std::sqrt(std::max({squared(u), squared(v), squared(w)}));
            out.row(f)[1] = std::sqrt(squared(crossed)) / 2;
        }
    });
}

void piece_sizes(Matrix<const double> vertices, Matrix<const std::int32_t> faces, Matrix<const std::int32_t> piece,
                 Matrix<const std::int32_t> flipped, Matrix<double> out)
{
    using Vector = std::array<double, 3>;
    require(vertices.columns == 3, "piece_sizes: `vertices` must have shape (V, 3)");
    require_indices(faces, 3, vertices.rows, "piece_sizes: `faces` must be (F, 3) vertex indices");
    require_indices(piece, 1, out.rows, "piece_sizes: `piece` must be (F, 1) rows of `out`");
    require(piece.rows == faces.rows && flipped.rows == faces.rows && flipped.columns == 1,
            "piece_sizes: `piece` and `flipped` must have shape (F, 1)");
    require(out.columns == 3, "piece_sizes: `out` must have shape (P, 3)");
    std::vector<Vector> centers(out.rows);
    std::fill_n(out.data, 3 * out.rows, 0.0);
    // In the second round, `centers` are known.
    for (const bool second : {false, true}) {
        for (std::size_t f = 0; f < faces.rows; ++f) {
            std::array<const double*, 3> corners;
            for (std::size_t k = 0; k < 3; ++k) corners[k] = &vertices.row(static_cast<std::size_t>(faces.row(f)[k]))[0];
            const auto [a, b, c] = corners;
            const Vector u{b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v{c[0] - a[0], c[1] - a[1], c[2] - a[2]};
            const Vector n{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
            const auto number = static_cast<std::size_t>(piece.row(f)[0]);
            const double sign = flipped.row(f)[0] == 0 ? 1 : -1;
            const auto sizes = out.row(number);
            Vector& center = centers[number];
            if (second) {
                const double height = n[0] * (a[0] - center[0]) + n[1] * (a[1] - center[1]) + n[2] * (a[2] - center[2]);
                sizes[2] += sign * height / 6;
            } else {
                const double area = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2;
                sizes[0] += area;
                sizes[1] += sign * area;
                for (std::size_t k = 0; k < 3; ++k) center[k] += area * (a[k] + b[k] + c[k]) / 3;
            }
        }
        for (std::size_t p = 0; p < out.rows && !second; ++p)
            for (double& coordinate : centers[p]) coordinate /= std::max(out.row(p)[0], std::numeric_limits<double>::min());
    }
}

}  // namespace dfd
