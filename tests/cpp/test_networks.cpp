#include "dfd/fit.hpp"
#include "dfd/transformer.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace {

std::vector<float> normal(std::size_t count, float deviation)
{
    std::mt19937 random(11);
    std::normal_distribution<float> draw(0, deviation);
    std::vector<float> values(count);
    for (float& value : values) value = draw(random);
    return values;
}

struct Fitted {
    std::vector<float> state, losses;
};

constexpr std::size_t points = 300, batch = 130, steps = 40;

/// A network of one hidden layer that learns to turn what it is given by a quarter.
Fitted fitted(int threads, const dfd::Kernels& kernels)
{
    const std::vector<std::size_t> widths{8, 64, 64};
    const std::size_t size = dfd::fit_size(widths);
    Fitted result{std::vector<float>(3 * size), std::vector<float>(steps)};
    const std::vector<float> first = normal(size, 0.3f);
    std::copy(first.begin(), first.end(), result.state.begin());
    std::vector<float> inputs(points * 8), targets(points * 64);
    for (std::size_t i = 0; i < points; ++i) {
        const float angle = 6.28f * float(i) / points;
        inputs[8 * i] = std::cos(angle), inputs[8 * i + 1] = std::sin(angle);
        targets[64 * i] = -std::sin(angle), targets[64 * i + 1] = std::cos(angle);
    }
    std::vector<std::int32_t> chosen(steps * batch);
    for (std::size_t i = 0; i < chosen.size(); ++i) chosen[i] = std::int32_t(i * 7 % points);
    const std::vector<double> rates(steps, 0.02), momenta(steps, 0.9);
    dfd::fit({result.state.data(), 3, size}, widths, {inputs.data(), points, 8}, {targets.data(), points, 64},
             {chosen.data(), steps, batch}, {rates, momenta}, result.losses, threads, kernels);
    return result;
}

}  // namespace

CASE("a fit comes nearer to its targets, to the same bits on any number of threads")
    for (const std::string& name : dfd::instruction_sets()) {
        const Fitted alone = fitted(1, dfd::kernels(name));
        CHECK(alone.losses.back() < 0.3f * alone.losses.front());
        for (const int threads : {2, 3, 7}) {
            const Fitted shared = fitted(threads, dfd::kernels(name));
            CHECK(shared.state == alone.state);
            CHECK(shared.losses == alone.losses);
        }
    }
END

CASE("a fit refuses what does not fit together")
    const dfd::Kernels& kernels = dfd::kernels(dfd::instruction_sets().front());
    const std::vector<std::size_t> widths{8, 64, 64}, none{4};
    CHECK_THROWS(dfd::fit_size(none), "layer");
    std::vector<float> state(3 * dfd::fit_size(widths)), rows(64 * 2), losses(1);
    std::vector<std::int32_t> beyond{2};
    const std::vector<double> one{0.1};
    CHECK_THROWS(dfd::fit({state.data(), 3, state.size() / 3}, widths, {rows.data(), 2, 8}, {rows.data(), 2, 64},
                          {beyond.data(), 1, 1}, {one, one}, losses, 1, kernels),
                 "`chosen` must hold numbers of points");
END

CASE("blocks that have learned nothing leave the last LayerNorm")
    constexpr std::size_t width = 128, hidden = 192, count = 37;
    const std::vector<float> zeros(3 * width * width + hidden * width), ones(3 * width, 1.0f);
    const auto matrix = [&](std::size_t rows, std::size_t columns) {
        return dfd::Matrix<const float>{zeros.data(), rows, columns};
    };
    const auto vector = [](const std::vector<float>& values, std::size_t size) {
        return std::span<const float>(values).first(size);
    };
    const dfd::BlockWeights block{matrix(3 * width, width), matrix(width, width),  matrix(hidden, width),
                                  matrix(width, hidden),    vector(zeros, 3 * width), vector(zeros, width),
                                  vector(zeros, hidden),    vector(zeros, width),  vector(ones, width),
                                  vector(zeros, width),     vector(ones, width),   vector(zeros, width)};
    const std::vector<dfd::BlockWeights> blocks{block, block};
    const std::vector<float> tokens = normal(count * width, 2.0f);
    for (const std::string& name : dfd::instruction_sets()) {
        std::vector<float> features(count * width);
        const dfd::Transformer network(blocks, vector(ones, width), vector(zeros, width), 2, 1e-6f, dfd::kernels(name));
        network.run({tokens.data(), count, width}, {features.data(), count, width});
        for (std::size_t i = 0; i < count; ++i) {
            double mean = 0, square = 0;
            for (std::size_t k = 0; k < width; ++k) mean += double(tokens[i * width + k]) / width;
            for (std::size_t k = 0; k < width; ++k) square += std::pow(double(tokens[i * width + k]) - mean, 2) / width;
            for (std::size_t k = 0; k < width; k += 31)
                CHECK_NEAR(features[i * width + k], (double(tokens[i * width + k]) - mean) / std::sqrt(square + 1e-6), 1e-5);
        }
        CHECK_THROWS(network.run({tokens.data(), count, width - 1}, {features.data(), count, width}), "shape (N, D)");
    }
END
