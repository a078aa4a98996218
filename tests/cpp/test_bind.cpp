#include "dfd/bind.hpp"

#include "check.hpp"

#include <limits>
#include <random>
#include <vector>

namespace {

struct Problem {
    std::size_t vertices, dimension, handles;
    std::vector<float> features, rows, weights;

    Problem(std::size_t v, std::size_t d, std::size_t h, float spread = 0.5f) : vertices(v), dimension(d), handles(h)
    {
        std::mt19937 random(static_cast<unsigned>(v + 31 * d + 1009 * h));
        std::normal_distribution<float> normal(0, spread / std::sqrt(static_cast<float>(d)));
        for (std::size_t k = 0; k < v * d; ++k) features.push_back(normal(random));
        for (std::size_t k = 0; k < h * d; ++k) rows.push_back(features[k]);
        weights.assign(v * h, -1);
    }

    std::vector<float>& bind(const dfd::Constraints& constraints = {}, int threads = 2)
    {
        dfd::bind({features.data(), vertices, dimension}, {rows.data(), handles, dimension}, constraints,
                  {weights.data(), vertices, handles}, threads);
        return weights;
    }

    double expected(std::size_t i, const float* row) const
    {
        double square = 0;
        for (std::size_t k = 0; k < dimension; ++k) {
            const double difference = double(features[i * dimension + k]) - double(row[k]);
            square += difference * difference;
        }
        return std::max(1 - std::sqrt(square), 0.0);
    }
};

}  // namespace

CASE("distance and clamp, Equations (4) and (5)")
    for (const std::size_t dimension : {1u, 3u, 16u, 33u, 384u}) {
        for (const std::size_t handles : {1u, 2u, 7u, 25u}) {
            Problem problem(101, dimension, handles);
            problem.bind();
            for (std::size_t i = 0; i < problem.vertices; ++i) {
                for (std::size_t j = 0; j < handles; ++j) {
                    const float weight = problem.weights[i * handles + j];
                    CHECK_NEAR(weight, problem.expected(i, &problem.rows[j * dimension]), 1e-6);
                    if (i == j) CHECK(weight == 1.0f);
                }
            }
        }
    }
END

CASE("fixed points, Equation (6)")
    Problem problem(50, 20, 3);
    const float* fixed = &problem.features[10 * 20];  // the rows of vertices 10 and 11
    problem.bind({.fixed = {fixed, 2, 20}, .geodesic = {}, .locality = {}});
    for (std::size_t i = 0; i < 50; ++i) {
        const double held = std::max(problem.expected(i, fixed), problem.expected(i, fixed + 20));
        for (std::size_t j = 0; j < 3; ++j)
            CHECK_NEAR(problem.weights[i * 3 + j], std::max(problem.expected(i, &problem.rows[j * 20]) - held, 0.0), 1e-6);
    }
    for (std::size_t j = 0; j < 6; ++j) CHECK(problem.weights[10 * 3 + j] == 0.0f);
END

CASE("geodesic falloff, Equation (7)")
    Problem problem(64, 8, 3);
    std::vector<float> geodesic, locality{0.0f, 1.0f, 2.5f};
    for (std::size_t k = 0; k < 3 * 64; ++k) geodesic.push_back(static_cast<float>(k % 64) / 63.0f);
    problem.bind({.fixed = {}, .geodesic = {geodesic.data(), 3, 64}, .locality = locality});
    for (std::size_t i = 0; i < 64; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
            const double wanted = problem.expected(i, &problem.rows[j * 8]) *
                                  std::pow(1.0 - double(geodesic[j * 64 + i]), double(locality[j]));
            CHECK_NEAR(problem.weights[i * 3 + j], wanted, 1e-6);
        }
    }
END

CASE("the same bits for every number of threads and every place of a row")
    Problem problem(333, 37, 9);
    for (std::size_t i = 1; i < 333; i += 2)
        std::copy_n(&problem.features[0], 37, &problem.features[i * 37]);
    const std::vector<float> once = problem.bind({}, 1);
    for (const int threads : {2, 3, 8}) CHECK(problem.bind({}, threads) == once);
    for (std::size_t i = 1; i < 333; i += 2)
        for (std::size_t j = 0; j < 9; ++j) CHECK(once[i * 9 + j] == once[j]);
END

CASE("empty shapes")
    CHECK(Problem(0, 5, 0).bind().empty());
    CHECK(Problem(9, 5, 0).bind().empty());
END

CASE("bad input is named")
    Problem problem(40, 6, 2);
    std::vector<float> geodesic(80, 0.5f), locality{1.0f, 1.0f};
    const dfd::Matrix<const float> distances{geodesic.data(), 2, 40};
    CHECK_THROWS(problem.bind({.fixed = {problem.rows.data(), 2, 5}, .geodesic = {}, .locality = {}}), "`fixed`");
    CHECK_THROWS(problem.bind({.fixed = {}, .geodesic = {}, .locality = locality}), "`geodesic` must be (H, V)");
    geodesic[77] = 1.5f;
    CHECK_THROWS(problem.bind({.fixed = {}, .geodesic = distances, .locality = locality}), "`geodesic` must lie in [0, 1]");
    geodesic[77] = std::numeric_limits<float>::quiet_NaN();
    CHECK_THROWS(problem.bind({.fixed = {}, .geodesic = distances, .locality = locality}), "`geodesic` must lie in [0, 1]");
    geodesic[77] = 0.5f;
    locality[1] = -1;
    CHECK_THROWS(problem.bind({.fixed = {}, .geodesic = distances, .locality = locality}), "`locality` must be");
    problem.rows[8] = std::numeric_limits<float>::infinity();
    CHECK_THROWS(problem.bind(), "`handles` must be finite, got inf at [1, 2]");
    problem.rows[8] = 0;
    problem.features[39 * 6 + 5] = std::numeric_limits<float>::quiet_NaN();
    CHECK_THROWS(problem.bind(), "`features` must be finite, got nan at [39, 5]");
    problem.dimension = 5;
    CHECK_THROWS(dfd::bind({problem.features.data(), 40, 6}, {problem.rows.data(), 2, 5}, {},
                           {problem.weights.data(), 40, 2}, 1),
                 "`handles` and `features` differ");
END
