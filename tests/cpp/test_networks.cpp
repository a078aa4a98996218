#include "dfd/transformer.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <cmath>
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

}  // namespace

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
