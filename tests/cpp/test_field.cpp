#include "dfd/field.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <cmath>
#include <random>
#include <vector>

namespace {

constexpr std::size_t octaves = 2, inputs = 3 + 6 * octaves;
const std::array<double, 3> center{1, -2, 0.5};
constexpr double scale = 0.25;

/// A network of two hidden layers and an output layer. Some widths are not multiples of 8, the group size of the kernel.
struct Network {
    std::vector<std::size_t> widths;
    std::vector<std::vector<float>> numbers;
    std::vector<dfd::Layer> layers;

    explicit Network(std::size_t dimension) : widths{inputs, 13, 24, dimension}
    {
        std::mt19937 random(static_cast<unsigned>(dimension));
        std::normal_distribution<float> normal(0, 0.4f);
        const auto made = [&](std::size_t count) {
            for (numbers.emplace_back(); numbers.back().size() < count;) numbers.back().push_back(normal(random));
            return numbers.back().data();
        };
        numbers.reserve(12);
        for (std::size_t k = 1; k < widths.size(); ++k) {
            const std::size_t outputs = widths[k], normalized = k + 1 < widths.size() ? outputs : 0;
            layers.push_back({{made(outputs * widths[k - 1]), outputs, widths[k - 1]}, {made(outputs), outputs},
                              {made(normalized), normalized}, {made(normalized), normalized}});
        }
    }

    /// Returns the features at a point, computed in double with a direct formula for each sine and each layer.
    std::vector<double> expected(const double* point) const
    {
        std::vector<double> values(inputs);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double x = static_cast<float>((point[axis] - center[axis]) * scale);
            values[axis] = x;
            for (std::size_t octave = 0; octave < octaves; ++octave) {
                const double angle = std::ldexp(std::acos(-1.0) / 2 * x, static_cast<int>(octave));
                values[3 + 6 * octave + axis] = std::sin(angle);
                values[6 + 6 * octave + axis] = std::cos(angle);
            }
        }
        for (const auto& [weight, bias, gain, shift] : layers) {
            std::vector<double> out(weight.rows);
            double mean = 0, variance = 0, square = 0;
            for (std::size_t o = 0; o < out.size(); ++o) {
                out[o] = double(bias[o]);
                for (std::size_t k = 0; k < weight.columns; ++k) out[o] += double(weight.row(o)[k]) * values[k];
                if (!gain.empty()) out[o] = std::max(out[o], 0.0);
                mean += out[o] / double(out.size());
                square += out[o] * out[o];
            }
            for (const double value : out) variance += (value - mean) * (value - mean) / double(out.size());
            for (std::size_t o = 0; o < out.size(); ++o)
                out[o] = gain.empty() ? out[o] / std::sqrt(square)
                                      : (out[o] - mean) / std::sqrt(variance + 1e-5) * double(gain[o]) + double(shift[o]);
            values = out;
        }
        return values;
    }
};

}  // namespace

CASE("features equal those computed in double, for all sizes and instruction sets")
    std::mt19937 random(5);
    std::uniform_real_distribution<double> uniform(-4, 4);
    std::vector<double> points(3 * 101);
    for (double& coordinate : points) coordinate = uniform(random);
    for (const std::size_t dimension : {1u, 7u, 40u}) {
        const Network network(dimension);
        const dfd::Field field(network.layers, octaves, center, scale);
        CHECK(field.dimension() == dimension);
        for (const std::string& name : dfd::instruction_sets()) {
            for (const std::size_t count : {1u, 47u, 101u}) {
                std::vector<float> features(count * dimension + 1, -9);
                field.evaluate({points.data(), count, 3}, {features.data(), count, dimension}, 2, dfd::kernels(name));
                CHECK(features.back() == -9);
                for (std::size_t i = 0; i < count; ++i) {
                    const std::vector<double> wanted = network.expected(&points[3 * i]);
                    for (std::size_t k = 0; k < dimension; ++k) CHECK_NEAR(features[i * dimension + k], wanted[k], 2e-5);
                }
            }
        }
    }
END
