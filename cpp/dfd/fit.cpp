#include "dfd/fit.hpp"

#include "dfd/common/parallel.hpp"
#include "dfd/common/require.hpp"
#include "dfd/common/scratch.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <vector>

namespace dfd {
namespace {

constexpr double decay = 0.999, epsilon = 1e-8;

std::vector<FitLayer> layers_of(std::span<const std::size_t> widths, std::size_t& size)
{
    require(widths.size() > 1, "fit: there must be at least one layer");
    require(widths[0] > 0 && widths[0] % fit_rows == 0, "fit: the width of `inputs` must be a multiple of 8");
    std::vector<FitLayer> layers(widths.size() - 1);
    size = 0;
    const auto take = [&size](std::size_t count) { return (size += count) - count; };
    for (std::size_t i = 0; i < layers.size(); ++i) {
        FitLayer& layer = layers[i];
        layer.inputs = widths[i];
        layer.outputs = widths[i + 1];
        require(layer.outputs > 0 && layer.outputs % fit_group == 0, "fit: widths of layers must be multiples of 64");
        layer.weight = take(layer.inputs * layer.outputs);
        layer.bias = take(layer.outputs);
        if (i + 1 == layers.size()) continue;
        layer.gain = take(layer.outputs);
        layer.shift = take(layer.outputs);
    }
    return layers;
}

/// What a step needs besides the state, taken once for all steps.
class Memory {
public:
    Memory(const std::vector<FitLayer>& layers, std::size_t units) : units_(units)
    {
        std::size_t widest = 0;
        for (const FitLayer& layer : layers) widest = std::max({widest, layer.inputs, layer.outputs});
        for (std::size_t unit = 0; unit < units; ++unit) {
            for (const FitLayer& layer : layers) {
                FitActivations& own = activations.emplace_back();
                own.in = take(layer.inputs * field_points);
                own.normal = take(layer.outputs * field_points);
                own.factor = take(field_points);
                own.least = take(field_points);
                own.bias = take(layer.outputs);
                own.gain = take(layer.outputs);
                own.shift = take(layer.outputs);
            }
            for (int i = 0; i < 2; ++i) gradients.push_back(take(widest * field_points));
        }
        for (const FitLayer& layer : layers) turned.push_back(take(layer.outputs * units_ * field_points));
        losses.resize(units);
    }

    std::vector<FitActivations> activations;
    std::vector<float*> gradients, turned;
    std::vector<float> losses;

private:
    float* take(std::size_t floats) { return memory_.emplace_back(1, floats).of(0); }

    std::size_t units_;
    std::deque<Scratch> memory_;
};

}  // namespace

std::size_t fit_size(std::span<const std::size_t> widths)
{
    std::size_t size = 0;
    layers_of(widths, size);
    return size;
}

void fit(Matrix<float> state, std::span<const std::size_t> widths, Matrix<const float> inputs,
         Matrix<const float> targets, Matrix<const std::int32_t> chosen, const FitSchedule& schedule,
         std::span<float> losses, int threads, const Kernels& kernels)
{
    std::size_t size = 0;
    const std::vector<FitLayer> layers = layers_of(widths, size);
    require(state.rows == 3 && state.columns == size, "fit: `state` must have shape (3, fit_size)");
    require(inputs.columns == widths.front() && targets.columns == widths.back() && inputs.rows == targets.rows,
            "fit: `inputs` and `targets` must have a row for each point, as wide as the network's ends");
    require(chosen.rows == losses.size() && chosen.rows == schedule.rates.size() &&
                chosen.rows == schedule.momenta.size() && chosen.columns > 0,
            "fit: there must be a loss, a rate and a momentum for every step, and a point");
    for (std::size_t i = 0; i < chosen.rows * chosen.columns; ++i)
        require(chosen.data[i] >= 0 && static_cast<std::size_t>(chosen.data[i]) < inputs.rows,
                "fit: `chosen` must hold numbers of points");
    struct Columns {
        std::size_t layer, first;
    };
    std::vector<Columns> columns;
    for (std::size_t i = 0; i < layers.size(); ++i)
        for (std::size_t first = 0; first < layers[i].outputs; first += fit_columns) columns.push_back({i, first});
    FitJob job;
    job.values = state.data;
    job.first = state.data + size;
    job.second = state.data + 2 * size;
    job.layers = layers.data();
    job.layer_count = layers.size();
    job.inputs = inputs.data;
    job.targets = targets.data;
    job.batch = chosen.columns;
    job.units = (job.batch + field_points - 1) / field_points;
    Memory memory(layers, job.units);
    job.activations = memory.activations.data();
    job.gradients = memory.gradients.data();
    job.turned = memory.turned.data();
    job.losses = memory.losses.data();
    for (std::size_t i = 0; i < chosen.rows; ++i) {
        const double step = static_cast<double>(schedule.steps_before + i + 1), momentum = schedule.momenta[i];
        job.chosen = chosen.row(i).data();
        job.rate = static_cast<float>(schedule.rates[i] / (1 - std::pow(momentum, step)));
        job.momentum = static_cast<float>(momentum);
        job.decay = static_cast<float>(decay);
        job.root = static_cast<float>(1 / std::sqrt(1 - std::pow(decay, step)));
        job.epsilon = static_cast<float>(epsilon);
        parallel_tasks(job.units, threads, [&](std::size_t unit) { kernels.fit_gradients(job, unit); });
        double sum = 0;
        for (const float loss : memory.losses) sum += static_cast<double>(loss);
        losses[i] = static_cast<float>(sum / static_cast<double>(job.batch));
        parallel_tasks(columns.size(), threads,
                       [&](std::size_t k) { kernels.fit_steps(job, columns[k].layer, columns[k].first); });
    }
}

}  // namespace dfd
