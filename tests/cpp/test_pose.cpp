#include "dfd/pose.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <array>
#include <random>
#include <vector>

namespace {

constexpr dfd::Affine identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
constexpr std::array<dfd::Blend, 2> blends{dfd::Blend::linear, dfd::Blend::dual_quaternion};
constexpr std::array<dfd::Overlap, 3> overlaps{dfd::Overlap::add, dfd::Overlap::paper, dfd::Overlap::normalize};

// Returns a scale by `factor` and a rotation by `angle`, in radians, about the axis along z through (x, y).
dfd::Affine turn(double angle, double x, double y, double factor = 1)
{
    const double c = factor * std::cos(angle), s = factor * std::sin(angle);
    return {c, -s, 0, x - c * x + s * y, s, c, 0, y - s * x - c * y, 0, 0, factor, 0};
}

// Returns the decomposition of a transform that `turn` made with the same arguments.
dfd::Polar polar_of(double angle, double x, double y, double factor = 1)
{
    const double c = std::cos(angle / 2), s = std::sin(angle / 2), more = factor - 1;
    return {{std::cos(angle / 4), 0, 0, std::sin(angle / 4)}, {x - c * x + s * y, y - s * x - c * y, 0},
            {more, more, more, 0, 0, 0}, {-more * x, -more * y, 0}, {}};
}

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
        for (std::size_t k = 0; k < v * h; ++k)
            weights.push_back(static_cast<float>(std::abs(uniform(random)) * 2 / double(h)));
        for (std::size_t k = 0; k < h; ++k) {
            transforms.push_back(identity);
            for (double& entry : transforms.back()) entry += 0.3 * uniform(random);
        }
    }

    void pose(const dfd::Motion& motion, const dfd::Kernels& kernels = dfd::kernels(), int threads = 2)
    {
        dfd::PoseArrays<T> arrays;
        arrays.vertices = {vertices.data(), vertex_count, 3};
        arrays.weights = {weights.data(), vertex_count, handles};
        arrays.posed = {posed.data(), vertex_count, 3};
        dfd::pose<T>(arrays, motion, threads, kernels);
    }

    // Returns a vertex posed by Equation (1), computed entry by entry.
    std::array<double, 3> expected(std::size_t i, const dfd::Affine& rest) const
    {
        double remainder = 1;
        dfd::Affine blend{};
        for (std::size_t k = 0; k < handles; ++k) {
            remainder -= double(weights[i * handles + k]);
            for (std::size_t entry = 0; entry < 12; ++entry)
                blend[entry] += double(weights[i * handles + k]) * transforms[k][entry];
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
                scene.pose({scene.transforms, rest, {}, dfd::Overlap::paper}, dfd::kernels(name));
                for (std::size_t i = 0; i < count; ++i) {
                    const auto wanted = scene.expected(i, rest);
                    for (std::size_t axis = 0; axis < 3; ++axis)
                        CHECK_NEAR(scene.posed[i * 3 + axis], wanted[axis], 5e-6);
                }
            }
        }
    }
}

}  // namespace

CASE("vertices are posed by Equation (1), with a default transform")
    blends_with_default<float>();
    blends_with_default<double>();
END

CASE("vertices are bitwise equal for every number of threads")
    Scene<float> scene(5000, 6);
    const dfd::Motion motion{scene.transforms, identity, {}, dfd::Overlap::paper};
    scene.pose(motion, dfd::kernels(), 1);
    const std::vector<float> once = scene.posed;
    for (const int threads : {2, 3, 8}) {
        scene.pose(motion, dfd::kernels(), threads);
        CHECK(scene.posed == once);
    }
END

CASE("identity transforms change no bit of a vertex, for any sum of weights")
    const std::array<bool, 4> sides{true, false, true, false};
    const std::vector<dfd::Affine> transforms(4, identity);
    const std::vector<dfd::Polar> polar(9, {{1, 0, 0, 0}, {}, {}, {}, {}});
    for (const std::string& name : dfd::instruction_sets()) {
        for (const dfd::Blend blend : blends) {
            for (const dfd::Overlap overlap : {dfd::Overlap::add, dfd::Overlap::normalize}) {
                Scene<float> scene(333, 4);
                dfd::Motion motion{transforms, identity, {}, overlap, blend, {polar.data(), 5}, {}};
                scene.pose(motion, dfd::kernels(name));
                CHECK(scene.posed == scene.vertices);
                motion.polar = polar;
                motion.mirror = dfd::Mirror{{0.6, 0, 0.8}, 0.123, 0.4, sides};
                scene.pose(motion, dfd::kernels(name));
                CHECK(scene.posed == scene.vertices);
            }
        }
    }
END

CASE("a full weight gives the whole transform, however far a dual quaternion rotates")
    for (const double angle : {0.0, 0.3, 2.0, 3.2, 5.0, 6.5}) {
        Scene<double> scene(64, 1);
        scene.weights.assign(64, 1.0f);
        scene.transforms = {turn(angle, 0.3, -0.2, 1.5)};
        dfd::Polar polar = polar_of(angle, 0.3, -0.2, 1.5);
        polar.translation = {0.1, 0.2, 0.3};
        for (std::size_t axis = 0; axis < 3; ++axis) scene.transforms[0][4 * axis + 3] += polar.translation[axis];
        const std::vector<dfd::Polar> rows{polar, {{1, 0, 0, 0}, {}, {}, {}, {}}};
        scene.pose({scene.transforms, identity, {}, dfd::Overlap::add, dfd::Blend::dual_quaternion, rows, {}});
        const std::vector<double> rotated = scene.posed;
        scene.pose({scene.transforms, identity, {}, dfd::Overlap::add, dfd::Blend::linear, {}, {}});
        std::size_t wrong = 0;
        for (std::size_t k = 0; k < rotated.size(); ++k) wrong += std::abs(rotated[k] - scene.posed[k]) > 1e-12;
        CHECK(wrong == 0);
    }
END

CASE("all instruction sets and numbers of threads give the same vertices")
    std::vector<dfd::Affine> transforms;
    std::vector<dfd::Polar> polar;
    for (std::size_t k = 0; k < 10; ++k) {
        const double angle = 0.5 * double(k), factor = 1 + 0.1 * double(k);
        if (k < 5) transforms.push_back(turn(angle, 0.1 * double(k), 0.2, factor));
        polar.push_back(polar_of(angle, 0.1 * double(k), 0.2, factor));
    }
    polar.push_back(polar_of(0.2, 0, 0));
    const std::array<bool, 5> sides{true, false, true, false, true};
    const std::vector<double> mixing{2, -1, 0, 0, 0, -1, 2, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1};
    for (const dfd::Blend blend : blends) {
        for (const dfd::Overlap overlap : overlaps) {
            const dfd::Mirror mirror{{1, 0, 0}, 0.1, 0.3, sides};
            dfd::Motion motion{transforms, turn(0.2, 0, 0), mirror, overlap, blend, polar, {}};
            if (overlap == dfd::Overlap::add) motion.mixing = mixing;
            Scene<float> scene(3000, 5);
            scene.pose(motion, dfd::kernels("baseline"), 1);
            const std::vector<float> wanted = scene.posed;
            for (const std::string& name : dfd::instruction_sets()) {
                scene.pose(motion, dfd::kernels(name), 1);
                const std::vector<float> once = scene.posed;
                std::size_t wrong = 0;
                for (std::size_t k = 0; k < once.size(); ++k) wrong += std::abs(once[k] - wanted[k]) > 2e-5f;
                CHECK(wrong == 0);
                scene.pose(motion, dfd::kernels(name), 5);
                CHECK(scene.posed == once);
            }
        }
    }
END
