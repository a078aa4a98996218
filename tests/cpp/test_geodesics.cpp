#include "dfd/geodesics.hpp"

#include "check.hpp"

#include <cmath>
#include <cstdint>
#include <vector>

namespace {

/// A flat unit square of n × n vertices.
struct Grid {
    std::vector<double> vertices;
    std::vector<std::int32_t> faces;
    std::size_t n;

    explicit Grid(std::size_t side) : n(side)
    {
        for (std::size_t y = 0; y < n; ++y)
            for (std::size_t x = 0; x < n; ++x)
                vertices.insert(vertices.end(), {double(x) / double(n - 1), double(y) / double(n - 1), 0.0});
        for (std::size_t y = 0; y + 1 < n; ++y)
            for (std::size_t x = 0; x + 1 < n; ++x) {
                const auto a = std::int32_t(y * n + x), b = a + 1, c = a + std::int32_t(n), d = c + 1;
                faces.insert(faces.end(), {a, b, d, a, d, c});
            }
    }

    dfd::Matrix<const double> points() const { return {vertices.data(), vertices.size() / 3, 3}; }
    dfd::Matrix<const std::int32_t> triangles() const { return {faces.data(), faces.size() / 3, 3}; }
};

std::vector<float> from(const dfd::Geodesics& geodesics, std::int64_t source, int threads = 1)
{
    std::vector<float> out(geodesics.vertex_count());
    geodesics.distances({&source, 1}, 0.5f, {out.data(), 1, out.size()}, threads);
    return out;
}

double largest_error(const Grid& grid, std::size_t samples)
{
    const dfd::Geodesics geodesics(grid.points(), grid.triangles(), {}, samples, 2);
    const std::size_t source = grid.n / 3 * grid.n + grid.n / 4;
    const auto found = from(geodesics, std::int64_t(source));
    double largest = 0;
    for (std::size_t v = 0; v < found.size(); ++v) {
        const double x = grid.vertices[3 * v] - grid.vertices[3 * source];
        const double y = grid.vertices[3 * v + 1] - grid.vertices[3 * source + 1];
        largest = std::max(largest, std::abs(found[v] * geodesics.extent() - std::hypot(x, y)));
    }
    return largest;
}

}  // namespace

CASE("distances on a flat square are exact, and with samples they are within 1.2 % of its width")
    CHECK(largest_error(Grid(40), 1600) < 1e-5);
    CHECK(largest_error(Grid(120), 800) < 0.012);
END

CASE("distances are bitwise equal for every number of threads and in repeated calls")
    const Grid grid(100);
    const dfd::Geodesics geodesics(grid.points(), grid.triangles(), {}, 500, 3);
    const auto found = from(geodesics, 77);
    CHECK(from(geodesics, 77, 4) == found);
    const dfd::Geodesics alone(grid.points(), grid.triangles(), {}, 500, 1);
    CHECK(from(alone, 77) == found);
END
