#include "dfd/pose.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <array>
#include <limits>
#include <memory>
#include <random>
#include <vector>

namespace {

constexpr dfd::Affine identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

template <class T>
struct Scene {
    std::size_t vertex_count, handles;
    std::vector<T> vertices, posed;
    std::vector<float> weights;
    std::vector<dfd::Affine> transforms;

    Scene(std::size_t v, std::size_t h) : vertex_count(v), handles(h), posed(3 * v, T{-9})
    {
        std::mt19937 random(static_cast<unsigned>(v + 97 * h));
        std::uniform_real_distribution<double> uniform(-1, 1);
        for (std::size_t k = 0; k < 3 * v; ++k) vertices.push_back(static_cast<T>(uniform(random)));
        for (std::size_t k = 0; k < v * h; ++k) weights.push_back(static_cast<float>(std::abs(uniform(random)) * 2 / double(h)));
        for (std::size_t k = 0; k < h; ++k) {
            transforms.push_back(identity);
            for (double& entry : transforms.back()) entry += 0.3 * uniform(random);
        }
    }

    void pose(const dfd::Affine& rest = identity, const std::optional<dfd::Mirror>& mirror = {}, int threads = 2,
              const dfd::Kernels& kernels = dfd::kernels())
    {
        dfd::PoseArrays<T> arrays;
        arrays.vertices = {vertices.data(), vertex_count, 3};
        arrays.weights = {weights.data(), vertex_count, handles};
        arrays.posed = {posed.data(), vertex_count, 3};
        dfd::pose<T>(arrays, {transforms, rest, mirror, dfd::Overlap::paper}, threads, kernels);
    }

    // Equation (1), entry by entry.
    std::array<double, 3> expected(std::size_t i, const std::vector<dfd::Affine>& moves, const dfd::Affine& rest) const
    {
        double remainder = 1;
        dfd::Affine blend{};
        for (std::size_t k = 0; k < handles; ++k) {
            remainder -= double(weights[i * handles + k]);
            for (std::size_t entry = 0; entry < 12; ++entry)
                blend[entry] += double(weights[i * handles + k]) * moves[k][entry];
        }
        for (std::size_t entry = 0; entry < 12; ++entry) blend[entry] += std::max(remainder, 0.0) * rest[entry];
        std::array<double, 3> result;
        for (std::size_t row = 0; row < 3; ++row) {
            result[row] = blend[row * 4 + 3];
            for (std::size_t axis = 0; axis < 3; ++axis)
                result[row] += blend[row * 4 + axis] * double(vertices[i * 3 + axis]);
        }
        return result;
    }
};

// D seen in the mirror x -> 2 offset - x.
dfd::Affine mirrored_in_x(dfd::Affine d, double offset)
{
    d[3] = 2 * offset - d[3] - 2 * offset * d[0];
    d[1] = -d[1];
    d[2] = -d[2];
    d[7] += 2 * offset * d[4];
    d[4] = -d[4];
    d[11] += 2 * offset * d[8];
    d[8] = -d[8];
    return d;
}

template <class T>
void blends_with_default()
{
    dfd::Affine rest = identity;
    rest[3] = 0.7;
    rest[5] = 1.5;
    for (const std::size_t handles : {1u, 2u, 5u, 40u}) {
        for (const std::size_t count : {1u, 15u, 16u, 17u, 300u}) {
            for (const std::string& name : dfd::instruction_sets()) {
                Scene<T> scene(count, handles);
                scene.pose(rest, {}, 2, dfd::kernels(name));
                for (std::size_t i = 0; i < count; ++i) {
                    const auto wanted = scene.expected(i, scene.transforms, rest);
                    for (std::size_t axis = 0; axis < 3; ++axis)
                        CHECK_NEAR(scene.posed[i * 3 + axis], wanted[axis], 5e-6);
                }
            }
        }
    }
}

template <class T>
void mirrors()
{
    const double offset = 0.2;
    Scene<T> scene(200, 3);
    const std::array<bool, 3> positive{true, false, true};
    std::vector<dfd::Affine> right = scene.transforms, left = scene.transforms;
    for (std::size_t k = 0; k < 3; ++k)
        (positive[k] ? left : right)[k] = mirrored_in_x(scene.transforms[k], offset);
    for (const double band : {0.0, 0.5}) {
        scene.pose(identity, dfd::Mirror{{1, 0, 0}, offset, band, positive});
        for (std::size_t i = 0; i < 200; ++i) {
            const double height = double(scene.vertices[i * 3]) - offset;
            const double t = std::min(std::max(height / (2 * band) + 0.5, 0.0), 1.0);
            const double share = band > 0 ? t * t * (3 - 2 * t) : height >= 0 ? 1.0 : 0.0;
            const auto above = scene.expected(i, right, identity), below = scene.expected(i, left, identity);
            for (std::size_t axis = 0; axis < 3; ++axis)
                CHECK_NEAR(scene.posed[i * 3 + axis], share * above[axis] + (1 - share) * below[axis], 5e-6);
        }
    }
}

}  // namespace

CASE("blending with the default transform, Equation (1)")
    blends_with_default<float>();
    blends_with_default<double>();
END

CASE("mirrored blending, Equation (8)")
    mirrors<float>();
    mirrors<double>();
END

CASE("identity transforms keep every bit where weights sum to at most 1")
    Scene<float> scene(333, 4);
    for (float& weight : scene.weights) weight /= 2;
    for (float& value : scene.vertices) value += 1e5f;
    scene.transforms.assign(4, identity);
    scene.pose();
    CHECK(scene.posed == scene.vertices);
END

CASE("the same bits for every number of threads")
    Scene<float> scene(5000, 6);
    scene.pose(identity, {}, 1);
    const std::vector<float> once = scene.posed;
    for (const int threads : {2, 3, 8}) {
        scene.pose(identity, {}, threads);
        CHECK(scene.posed == once);
    }
END

CASE("no vertices, no handles")
    Scene<float> nothing(0, 2);
    nothing.pose();
    Scene<double> still(10, 0);
    still.pose();
    CHECK(still.posed == still.vertices);
END

CASE("bad input is named")
    Scene<float> scene(40, 2);
    scene.vertices[50] = std::numeric_limits<float>::quiet_NaN();
    CHECK_THROWS(scene.pose(), "`vertices` must be finite, got nan at [16, 2]");
    scene.vertices[50] = 0;
    scene.weights[7] = std::numeric_limits<float>::infinity();
    CHECK_THROWS(scene.pose(), "`weights` must be finite, got inf at [3, 1]");
    scene.weights[7] = 1;
    scene.transforms[1][3] = 1e300;
    CHECK_THROWS(scene.pose(), "`transforms` move a vertex beyond");
    scene.transforms.pop_back();
    CHECK_THROWS(scene.pose(), "`weights` must be (V, H)");
    scene.transforms.push_back(identity);
    CHECK_THROWS(scene.pose(identity, dfd::Mirror{{1, 0, 0}, 0, 0, {}}), "every handle's side");
END
