#include "dfd/components.hpp"

#include "dfd/common/require.hpp"

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
        // the smaller index stays on top, so that numbers follow the order of first vertices
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

}  // namespace dfd
