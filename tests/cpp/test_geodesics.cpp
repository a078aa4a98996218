#include "dfd/geodesics.hpp"

#include "check.hpp"
#include "dfd/interpolation.hpp"
#include "dfd/topology.hpp"
#include "dfd/surface/march.hpp"

#include <cmath>
#include <cstdint>
#include <vector>

namespace {

/// A flat square of n × n vertices, 1 wide.
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

CASE("a wave crosses a triangle as from a point in its plane")
    CHECK_NEAR(dfd::across_triangle(1, 1, 1, 1, 1), std::sqrt(3.0), 1e-12);
    CHECK_NEAR(dfd::across_triangle(0.5, 0.5, 1, std::sqrt(0.5), std::sqrt(0.5)), 0.5, 1e-12);
    CHECK(dfd::across_triangle(0.1, 2, 1, 1, 1) == dfd::unreached);     // no such triangle
    CHECK(dfd::across_triangle(1, 1, 0, 1, 1) == dfd::unreached);       // no side to cross
    CHECK(dfd::across_triangle(5, 5.9, 1, 1, 1) == dfd::unreached);     // the straight line passes beside it
END

CASE("flat ground is measured exactly, and through samples nearly so")
    CHECK(largest_error(Grid(40), 1600) < 1e-5);
    CHECK(largest_error(Grid(120), 800) < 0.012);
END

CASE("links lead across, and where none does all is separate")
    const std::vector<double> line = {0, 0, 0, 1, 0, 0, 1.5, 0, 0, 9, 9, 9};
    const std::vector<std::int32_t> faces = {0, 0, 1}, links = {1, 2};
    const dfd::Geodesics geodesics({line.data(), 4, 3}, {faces.data(), 1, 3}, {links.data(), 1, 2}, 100, 1);
    CHECK_NEAR(geodesics.extent(), 1.5, 1e-6);
    const auto found = from(geodesics, 0);
    CHECK_NEAR(found[1], 1 / 1.5, 1e-6);
    CHECK_NEAR(found[2], 1, 1e-6);
    CHECK_NEAR(found[3], 0.5, 0);
END

CASE("threads change no bit, nor does asking again")
    const Grid grid(100);
    const dfd::Geodesics geodesics(grid.points(), grid.triangles(), {}, 500, 3);
    const auto found = from(geodesics, 77);
    CHECK(from(geodesics, 77, 4) == found);
    const dfd::Geodesics alone(grid.points(), grid.triangles(), {}, 500, 1);
    CHECK(from(alone, 77) == found);
END

CASE("no vertices, no faces, one vertex")
    CHECK(dfd::Geodesics({nullptr, 0, 3}, {}, {}, 1, 1).vertex_count() == 0);
    const std::vector<double> point = {0, 0, 0};
    const dfd::Geodesics one({point.data(), 1, 3}, {}, {}, 1, 1);
    CHECK(from(one, 0) == std::vector<float>{0});
    CHECK(one.extent() == 0);
END

CASE("components are numbered by their first vertices")
    const std::vector<std::int32_t> faces = {5, 1, 6, 0, 2, 2}, links = {4, 6};
    const auto found = dfd::components(7, {faces.data(), 2, 3}, {links.data(), 1, 2});
    CHECK((found == std::vector<std::int32_t>{0, 1, 0, 2, 1, 1, 1}));
    CHECK_THROWS(dfd::components(6, {faces.data(), 2, 3}, {}), "components: `faces` must be (F, 3) vertex indices");
END

CASE("faces have their longest sides and areas")
    const std::vector<double> points = {0, 0, 0, 3, 0, 0, 3, 4, 0};
    const std::vector<std::int32_t> faces = {2, 0, 1, 1, 1, 0};
    std::vector<double> out(4);
    dfd::face_sizes({points.data(), 3, 3}, {faces.data(), 2, 3}, {out.data(), 2, 2}, 2);
    CHECK((out == std::vector<double>{5, 6, 3, 0}));
    CHECK_THROWS(dfd::face_sizes({points.data(), 2, 3}, {faces.data(), 2, 3}, {out.data(), 2, 2}, 1), "`faces` must be");
    CHECK_THROWS(dfd::face_sizes({points.data(), 3, 3}, {faces.data(), 2, 3}, {out.data(), 1, 2}, 1), "`out` must have");
END

CASE("values of clusters are interpolated at vertices")
    const std::vector<double> points = {0, 0, 0, 1, 0, 0, 2, 0, 0, 9, 0, 0}, centers = {0, 0, 0, 2, 0, 0, 9, 0, 0};
    const std::vector<std::int32_t> of_vertex = {0, 0, 1, 2}, starts = {0, 2, 4, 5}, neighbors = {0, 1, 0, 1, 2};
    const std::vector<std::int32_t> chosen = {1, 3, 0};
    const std::vector<float> values = {0, 1, 4, 1, 7, 1};
    std::vector<float> out(6);
    const dfd::Clusters clusters{{centers.data(), 3, 3}, of_vertex, starts, neighbors};
    const dfd::Matrix<const double> vertices{points.data(), 4, 3};
    dfd::interpolate(vertices, clusters, chosen, {values.data(), 3, 2}, {out.data(), 3, 2}, 2);
    CHECK_NEAR(out[0], 2, 1e-5);  // halfway between two centers
    CHECK(out[2] == 7 && out[4] > 0 && out[4] < 0.1);
    for (const std::size_t i : {1, 3, 5}) CHECK_NEAR(out[i], 1, 1e-6);
    const std::vector<std::int32_t> beyond = {4};
    CHECK_THROWS(dfd::interpolate(vertices, clusters, beyond, {values.data(), 3, 2}, {out.data(), 1, 2}, 1),
                 "`chosen` must be vertex indices");
    CHECK_THROWS(dfd::interpolate(vertices, clusters, chosen, {values.data(), 2, 2}, {out.data(), 3, 2}, 1),
                 "`values` must have one row per cluster");
    const dfd::Clusters wrong{{centers.data(), 3, 3}, of_vertex, starts, beyond};
    CHECK_THROWS(dfd::interpolate(vertices, wrong, chosen, {values.data(), 3, 2}, {out.data(), 3, 2}, 1), "`starts` must");
END

CASE("bad input is refused")
    const Grid grid(3);
    const std::vector<std::int32_t> faces = {0, 1, 9}, links = {-1, 0};
    const std::vector<double> bad = {0, 0, NAN};
    CHECK_THROWS(dfd::Geodesics(grid.points(), {faces.data(), 1, 3}, {}, 9, 1), "`faces` must be (F, 3)");
    CHECK_THROWS(dfd::Geodesics(grid.points(), {}, {links.data(), 1, 2}, 9, 1), "`links` must be (L, 2)");
    CHECK_THROWS(dfd::Geodesics({bad.data(), 1, 3}, {}, {}, 9, 1), "`vertices` must be finite");
    CHECK_THROWS(dfd::Geodesics({bad.data(), 1, 2}, {}, {}, 9, 1), "`vertices` must have shape (V, 3)");
    CHECK_THROWS(dfd::Geodesics(grid.points(), grid.triangles(), {}, 0, 1), "`sample_count` must be at least 1");
    const dfd::Geodesics geodesics(grid.points(), grid.triangles(), {}, 9, 1);
    CHECK_THROWS(from(geodesics, 9), "`sources` must be vertex indices");
    CHECK_THROWS(geodesics.distances({}, 1, {nullptr, 1, 9}, 1), "`out` must have shape (H, V)");
END
