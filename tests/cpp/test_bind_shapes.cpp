#include "dfd/bind.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <random>
#include <vector>

namespace {

constexpr std::size_t count = 101, dimension = 20;

std::vector<float> made_features()
{
    std::mt19937 random(7);
    std::normal_distribution<float> normal(0, 0.12f);
    std::vector<float> features(count * dimension);
    for (float& entry : features) entry = normal(random);
    return features;
}

double distance(const std::vector<float>& features, std::size_t a, std::size_t b)
{
    double square = 0;
    for (std::size_t k = 0; k < dimension; ++k)
        square += std::pow(double(features[a * dimension + k]) - double(features[b * dimension + k]), 2);
    return std::sqrt(square);
}

double fallen(double x, dfd::Falloff falloff)
{
    switch (falloff) {
    case dfd::Falloff::smooth: return x * x * (3 - 2 * x);
    case dfd::Falloff::sharp: return x * x;
    case dfd::Falloff::root: return std::sqrt(x);
    case dfd::Falloff::sphere: return std::sqrt(x * (2 - x));
    case dfd::Falloff::constant: return x > 0 ? 1 : 0;
    default: return x;
    }
}

}  // namespace

CASE("regions, reaches, falloffs and strengths give the expected weights on every instruction set")
    const std::vector<float> features = made_features();
    const std::vector<std::int64_t> points{3, 9, 27, 81, 40, 41, 5, 6, 7, 8, 60, 61, 62}, held{90, 91, 92};
    const std::vector<std::uint32_t> members{1, 2, 3, 4, 1, 2};
    const std::vector<dfd::Extent> extents{{1, dfd::Falloff::linear},   {0.9f, dfd::Falloff::smooth},
                                           {0.7f, dfd::Falloff::sharp}, {0.8f, dfd::Falloff::root},
                                           {2, dfd::Falloff::sphere},   {0.75f, dfd::Falloff::constant}};
    const std::vector<float> strengths{1, 0.5f, 0};
    const dfd::Features source{dfd::Features::Layout::rows, features.data(), count, dimension};
    for (const std::string& name : dfd::instruction_sets()) {
        std::vector<float> weights(count * 6), columns(count * 6);
        const dfd::Constraints constraints{.fixed = {.vertices = held}, .strengths = strengths, .extents = extents};
        const dfd::Points handles{.vertices = points, .members = members};
        dfd::bind(source, handles, constraints, {weights.data(), count, 6}, 2, dfd::kernels(name));
        dfd::bind(source, handles, constraints, {columns.data(), count, 6, 1, count}, 1, dfd::kernels(name));
        for (std::size_t i = 0; i < count; ++i) {
            const double taken = std::max(std::max(1 - distance(features, i, 90), 0.0),
                                          0.5 * std::max(1 - distance(features, i, 91), 0.0));
            for (std::size_t j = 0, next = 0; j < 6; ++j) {
                double nearest = 1e9;
                for (std::size_t m = 0; m < members[j]; ++m, ++next)
                    nearest = std::min(nearest, distance(features, i, std::size_t(points[next])));
                const double x = std::max(1 - nearest / double(extents[j].reach), 0.0);
                if (extents[j].falloff == dfd::Falloff::constant && std::abs(x) < 1e-5) continue;
                const double wanted = std::max(fallen(x, extents[j].falloff) - taken, 0.0);
                CHECK_NEAR(weights[i * 6 + j], wanted, extents[j].falloff == dfd::Falloff::root ? 2e-3 : 1e-5);
                CHECK(columns[j * count + i] == weights[i * 6 + j]);
            }
        }
    }
END

CASE("invalid distances are refused, and invalid byte features give weights from 0 to 1")
    const std::vector<float> features = made_features();
    const std::vector<std::int64_t> points{3};
    const std::vector<float> locality{2.5f};
    std::vector<float> weights(count), geodesic(count, 0.5f);
    const dfd::Features source{dfd::Features::Layout::rows, features.data(), count, dimension};
    for (const float wrong : {-1e30f, 1e30f, std::numeric_limits<float>::infinity(),
                              std::numeric_limits<float>::quiet_NaN(), -0.001f}) {
        geodesic[77] = wrong;
        CHECK_THROWS(dfd::bind(source, {.vertices = points},
                               {.geodesic = {geodesic.data(), 1, count}, .locality = locality},
                               {weights.data(), count, 1}, 1, dfd::kernels()),
                     "`geodesic` must lie in [0, 1]");
    }
    std::vector<std::uint8_t> bytes(16 * 8, 255);  // the squared length of a row is stored as -1, which is invalid
    bytes[16 * 4 + 3] = 127;                       // the squared length of the first row is the largest integer
    const dfd::Features made{dfd::Features::Layout::bytes, bytes.data(), 16, 4, 0.1f};
    for (const std::string& name : dfd::instruction_sets()) {
        dfd::bind(made, {.vertices = points}, {.fixed = {.vertices = points}}, {weights.data(), 16, 1}, 1,
                  dfd::kernels(name));
        for (std::size_t i = 0; i < 16; ++i) CHECK(weights[i] >= 0 && weights[i] <= 1);
    }
END
