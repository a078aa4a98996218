#include "dfd/faces.hpp"

#include "dfd/common/parallel.hpp"
#include "dfd/common/require.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace dfd {

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

}  // namespace dfd
