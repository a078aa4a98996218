#include "dfd/pose_gradients.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <array>
#include <memory>
#include <random>
#include <vector>

namespace {

template <class T>
struct Scene {
    std::size_t count, handles;
    bool columns;  // whether the weights and their gradients are stored by columns
    std::vector<T> vertices, direction;
    std::vector<float> weights;
    std::vector<dfd::Affine> transforms;
    dfd::Affine rest;
    std::unique_ptr<bool[]> sides;

    Scene(std::size_t v, std::size_t h, bool by_columns = false)
        : count(v), handles(h), columns(by_columns), rest{1, 0.1, 0, 0.3, 0, 1.2, 0, -0.4, 0.2, 0, 0.9, 0.1},
          sides(new bool[h])
    {
        std::mt19937 random(static_cast<unsigned>(v + 97 * h));
        std::uniform_real_distribution<double> uniform(-1, 1);
        for (std::size_t k = 0; k < 3 * v; ++k) {
            vertices.push_back(static_cast<T>(uniform(random)));
            direction.push_back(static_cast<T>(uniform(random)));
        }
        for (std::size_t k = 0; k < v * h; ++k)
            weights.push_back(static_cast<float>(std::abs(uniform(random)) * 2.2 / double(h)));
        for (std::size_t k = 0; k < h; ++k) {
            transforms.push_back({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
            for (double& entry : transforms.back()) entry += 0.3 * uniform(random);
            sides[k] = k % 3 != 1;
        }
    }

    template <class W>
    dfd::StridedMatrix<W> strided(W* data) const
    {
        if (columns) return {data, count, handles, 1, count};
        return {data, count, handles};
    }

    dfd::Motion motion(dfd::Overlap overlap, bool mirrored, double band) const
    {
        dfd::Motion result{transforms, rest, {}, overlap};
        if (mirrored) result.mirror = dfd::Mirror{{0.6, 0, 0.8}, 0.05, band, {sides.get(), handles}};
        return result;
    }

    dfd::PoseArrays<T> arrays(std::vector<T>& posed) const
    {
        dfd::PoseArrays<T> result;
        result.vertices = {vertices.data(), count, 3};
        result.weights = strided(weights.data());
        result.posed = {posed.data(), count, 3};
        return result;
    }

    /// Returns the sum of the products of the posed vertices with `direction`.
    double height(const dfd::Motion& how) const
    {
        std::vector<T> posed(3 * count);
        dfd::pose<T>(arrays(posed), how, 1, dfd::kernels("baseline"));
        double sum = 0;
        for (std::size_t k = 0; k < posed.size(); ++k) sum += double(posed[k]) * double(direction[k]);
        return sum;
    }

    struct Result {
        std::vector<T> vertices, weights;
        std::vector<dfd::Affine> transforms;
        dfd::Affine rest;
        bool operator==(const Result&) const = default;
    };

    Result gradients(const dfd::Motion& how, const dfd::Kernels& kernels, int threads = 2) const
    {
        std::vector<T> posed(3 * count);
        Result result{std::vector<T>(3 * count), std::vector<T>(count * handles), std::vector<dfd::Affine>(handles), {}};
        dfd::PoseGradients<T> wanted;
        wanted.posed = {direction.data(), count, 3};
        wanted.vertices = {result.vertices.data(), count, 3};
        wanted.weights = strided(result.weights.data());
        wanted.transforms = result.transforms;
        wanted.rest = &result.rest;
        dfd::pose_gradients<T>(arrays(posed), how, wanted, threads, kernels);
        return result;
    }
};

/// Compares a gradient with the difference quotient for the step `step` of `value`, which then has its former value.
template <class T, class Height>
void check_quotient(T& value, double step, double gradient, double tolerance, const Height& height)
{
    const T before = value;
    value = static_cast<T>(double(before) + step);
    const T ahead = value;
    const double above = height();
    value = static_cast<T>(double(before) - step);
    const double taken = double(ahead) - double(value), below = height();
    value = before;
    CHECK_NEAR((above - below) / taken, gradient, tolerance);
}

void compare_with_quotients(dfd::Overlap overlap, bool mirrored, double band, bool columns)
{
    Scene<double> scene(37, 4, columns);
    for (const std::string& name : dfd::instruction_sets()) {
        const auto how = [&] { return scene.motion(overlap, mirrored, band); };
        const auto found = scene.gradients(how(), dfd::kernels(name));
        const auto height = [&] { return scene.height(how()); };
        for (std::size_t k = 0; k < 3 * scene.count; ++k)
            check_quotient(scene.vertices[k], 1e-6, found.vertices[k], 2e-8, height);
        for (std::size_t i = 0; i < scene.count; ++i) {
            const std::size_t row = columns ? 1 : scene.handles, column = columns ? scene.count : 1;
            double sum = 0;
            for (std::size_t k = 0; k < scene.handles; ++k) sum += double(scene.weights[i * row + k * column]);
            if (std::abs(sum - 1) < 0.01) continue;  // the gradient jumps where the sum is 1
            for (std::size_t k = 0; k < scene.handles; ++k)
                check_quotient(scene.weights[i * row + k * column], 1e-3, found.weights[i * row + k * column], 1e-5,
                               height);
        }
        for (std::size_t k = 0; k < scene.handles; ++k)
            for (std::size_t e = 0; e < 12; ++e)
                check_quotient(scene.transforms[k][e], 0.1, found.transforms[k][e], 1e-12, height);
        for (std::size_t e = 0; e < 12; ++e) check_quotient(scene.rest[e], 0.1, found.rest[e], 1e-12, height);
    }
}

}  // namespace

CASE("gradients are those of difference quotients")
    for (const dfd::Overlap overlap : {dfd::Overlap::add, dfd::Overlap::paper, dfd::Overlap::normalize}) {
        compare_with_quotients(overlap, false, 0, false);
        compare_with_quotients(overlap, true, 0, true);
        compare_with_quotients(overlap, true, 0.4, false);
    }
END

CASE("all instruction sets and layouts give the same gradients, and any number of threads the same bits")
    for (const std::size_t count : {1u, 15u, 16u, 130u, 9001u}) {
        for (const std::size_t handles : {0u, 1u, 5u, 33u}) {
            const Scene<float> rows(count, handles);
            Scene<float> columns(count, handles, true);
            for (std::size_t i = 0; i < count; ++i)
                for (std::size_t k = 0; k < handles; ++k)
                    columns.weights[k * count + i] = rows.weights[i * handles + k];
            const auto motion = rows.motion(dfd::Overlap::paper, true, 0.3);
            const auto wanted = rows.gradients(motion, dfd::kernels("baseline"), 1);
            for (const std::string& name : dfd::instruction_sets()) {
                const auto found = rows.gradients(motion, dfd::kernels(name), 1);
                const auto by_columns = columns.gradients(motion, dfd::kernels(name), 3);
                CHECK(found == rows.gradients(motion, dfd::kernels(name), 3));
                CHECK(found.transforms == by_columns.transforms && found.vertices == by_columns.vertices);
                std::size_t wrong = 0;
                for (std::size_t i = 0; i < count; ++i)
                    for (std::size_t k = 0; k < handles; ++k) {
                        wrong += found.weights[i * handles + k] != by_columns.weights[k * count + i];
                        wrong += std::abs(found.weights[i * handles + k] - wanted.weights[i * handles + k]) > 1e-5f;
                    }
                for (std::size_t k = 0; k < 3 * count; ++k)
                    wrong += std::abs(found.vertices[k] - wanted.vertices[k]) > 1e-5f;
                for (std::size_t k = 0; k < handles; ++k)
                    for (std::size_t e = 0; e < 12; ++e)
                        wrong += std::abs(found.transforms[k][e] - wanted.transforms[k][e]) > 1e-6 * (1 + double(count));
                CHECK(wrong == 0);
            }
        }
    }
END
