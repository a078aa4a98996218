#include "dfd/pose.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <array>
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

    void pose(const dfd::Affine& rest = identity, int threads = 2, const dfd::Kernels& kernels = dfd::kernels())
    {
        dfd::PoseArrays<T> arrays;
        arrays.vertices = {vertices.data(), vertex_count, 3};
        arrays.weights = {weights.data(), vertex_count, handles};
        arrays.posed = {posed.data(), vertex_count, 3};
        dfd::pose<T>(arrays, {transforms, rest, {}, dfd::Overlap::paper}, threads, kernels);
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
                scene.pose(rest, 2, dfd::kernels(name));
                for (std::size_t i = 0; i < count; ++i) {
                    const auto wanted = scene.expected(i, scene.transforms, rest);
                    for (std::size_t axis = 0; axis < 3; ++axis)
                        CHECK_NEAR(scene.posed[i * 3 + axis], wanted[axis], 5e-6);
                }
            }
        }
    }
}

}  // namespace

CASE("blending with the default transform, Equation (1)")
    blends_with_default<float>();
    blends_with_default<double>();
END

CASE("the same bits for every number of threads")
    Scene<float> scene(5000, 6);
    scene.pose(identity, 1);
    const std::vector<float> once = scene.posed;
    for (const int threads : {2, 3, 8}) {
        scene.pose(identity, threads);
        CHECK(scene.posed == once);
    }
END
