#include "dfd/camera.hpp"
#include "dfd/shading.hpp"

#include "check.hpp"

#include <cstdint>

namespace {

// At the origin, looking along -z; at distance 1 the picture is 2 wide.
const std::vector<double> frame{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};

dfd::Camera camera(std::size_t resolution) { return {{frame.data(), 4, 3}, 1.0, resolution}; }

std::vector<std::uint8_t> shown(const std::vector<float>& vertices, const std::vector<std::int32_t>& faces,
                                std::size_t resolution)
{
    std::vector<std::uint8_t> out(resolution * resolution, 7);
    dfd::may_show(camera(resolution), {vertices.data(), vertices.size() / 3, 3}, {faces.data(), faces.size() / 3, 3},
                  {out.data(), resolution, resolution});
    return out;
}

}  // namespace

CASE("rays of two by two pixels")
    const std::vector<std::int64_t> pixels{0, 3};
    std::vector<float> out(6);
    dfd::ray_directions(camera(2), pixels, {out.data(), 2, 3});
    const double shorter = 1 / std::sqrt(1.5);
    CHECK_NEAR(out[0], -0.5 * shorter, 1e-7);
    CHECK_NEAR(out[1], 0.5 * shorter, 1e-7);
    CHECK_NEAR(out[2], -shorter, 1e-7);
    CHECK_NEAR(out[3], 0.5 * shorter, 1e-7);
    CHECK_NEAR(out[4], -0.5 * shorter, 1e-7);
    const std::vector<std::int64_t> beyond{4, 0};
    CHECK_THROWS(dfd::ray_directions(camera(2), beyond, {out.data(), 2, 3}), "`pixels` must be those of the picture");
END

CASE("squares around a triangle and around nothing")
    const auto far = shown({-0.9f, 0.9f, -1, -0.8f, 0.9f, -1, -0.9f, 0.8f, -1}, {0, 1, 2}, 64);
    CHECK(far[0] == 1 && far[63] == 0 && far[64 * 63] == 0 && far[64 * 63 + 63] == 0);
    const auto behind = shown({0, 0, 1, 1, 0, -1, 0, 1, -1}, {0, 1, 2}, 9);
    for (const std::uint8_t pixel : behind) CHECK(pixel == 1);
    const auto whole = shown({-9, -9, -1, 9, -9, -1, 0, 99, -1}, {0, 1, 2}, 20);
    for (const std::uint8_t pixel : whole) CHECK(pixel == 1);
    const auto none = shown({0, 0, -1}, {}, 20);
    for (const std::uint8_t pixel : none) CHECK(pixel == 0);
    CHECK_THROWS(shown({0, 0, -1}, {0, 0, 1}, 4), "`faces` must be (F, 3) vertex indices");
END

CASE("light of a triangle whose normals cancel out is its own")
    const std::vector<float> vertices{0, 0, 0, 1, 0, 0, 0, 1, 0};
    const std::vector<float> normals{1, 0, 0, -1, 0, 0, 0, 1, 0};
    const std::vector<std::int32_t> corners{0, 1, 2, 2, 2, 2, 0, 0, 1};
    const std::vector<float> barycentric{0.5f, 0.5f, 0, 0, 0, 1, 0.5f, 0, 0.5f};
    const std::vector<std::int64_t> rays{0, 1, 0};
    const std::vector<float> directions{0, 0, -1, 0, 0.6f, 0.8f};
    std::vector<float> light(3);
    const dfd::RayHits hits{
        {corners.data(), 3, 3}, {barycentric.data(), 3, 3}, rays, {directions.data(), 2, 3}};
    dfd::facing({vertices.data(), 3, 3}, {normals.data(), 3, 3}, hits, {light.data(), 3, 1});
    CHECK_NEAR(light[0], 1, 1e-7);    // normals cancel: the triangle faces +z
    CHECK_NEAR(light[1], 0.6, 1e-7);  // the third corner's own normal
    CHECK_NEAR(light[2], 0, 1e-7);    // normals cancel, and there is no area
    CHECK_THROWS(dfd::facing({vertices.data(), 3, 3}, {normals.data(), 2, 3}, hits, {light.data(), 3, 1}),
                 "`normals` must have shape (V, 3)");
END

CASE("blends and bytes")
    const std::vector<float> values{1, 10, 2, 20, 3, 30};
    const std::vector<std::int32_t> rows{0, 1, 2};
    const std::vector<float> weights{0.5f, 0.25f, 0.25f};
    std::vector<float> out(2);
    dfd::blend({values.data(), 3, 2}, {rows.data(), 1, 3}, {weights.data(), 1, 3}, {out.data(), 1, 2});
    CHECK_NEAR(out[0], 1.75, 1e-7);
    CHECK_NEAR(out[1], 17.5, 1e-6);
    const std::vector<float> color{0, 0.5f, 1, 1};
    const std::vector<std::int64_t> pixel{1};
    std::vector<std::uint8_t> image(6, 9);
    dfd::paint({color.data(), 1, 4}, pixel, {image.data(), 2, 3});
    CHECK((image == std::vector<std::uint8_t>{9, 9, 9, 0, 128, 255}));
END
