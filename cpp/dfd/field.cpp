#include "dfd/field.hpp"

#include "dfd/common/parallel.hpp"
#include "dfd/common/require.hpp"
#include "dfd/common/scratch.hpp"

#include <algorithm>

namespace dfd {
namespace {

constexpr std::size_t grain_points = 8 * field_points;  // least number of points for each thread

std::size_t padded(std::size_t outputs) { return (outputs + field_group - 1) / field_group * field_group; }

/// Returns `weight` (outputs, inputs) as (groups, inputs, 8). A group has 8 outputs, and zeros fill the last group.
std::vector<float> grouped(Matrix<const float> weight)
{
    std::vector<float> result(padded(weight.rows) * weight.columns);
    for (std::size_t output = 0; output < weight.rows; ++output)
        for (std::size_t input = 0; input < weight.columns; ++input)
            result[(output / field_group * weight.columns + input) * field_group + output % field_group] =
                weight.row(output)[input];
    return result;
}

Matrix<const float> column(std::span<const float> values) { return {values.data(), values.size(), 1}; }

}  // namespace

Field::Field(std::span<const Layer> layers, std::size_t octaves, std::array<double, 3> center, double scale)
    : octaves_(octaves), center_(center), scale_(scale)
{
    require(!layers.empty(), "Field: `layers` must have at least one layer");
    std::size_t inputs = 3 + 6 * octaves;
    widest_ = inputs;
    for (const Layer& layer : layers) {
        const std::size_t outputs = layer.weight.rows;
        const bool last = &layer == &layers.back();
        require(layer.weight.columns == inputs && outputs > 0,
                "Field: each layer must have as many inputs as the layer before has outputs");
        require(layer.bias.size() == outputs, "Field: `bias` must have an entry for every output");
        require(layer.gain.size() == (last ? 0 : outputs) && layer.shift.size() == layer.gain.size(),
                "Field: every layer except the last must have a LayerNorm");
        const auto keep = [this](Matrix<const float> values) { return memory_.emplace_back(grouped(values)).data(); };
        FieldLayer& kept = layers_.emplace_back();
        kept.inputs = inputs;
        kept.outputs = outputs;
        kept.weights = keep(layer.weight);
        kept.bias = keep(column(layer.bias));
        if (!last) {
            kept.gain = keep(column(layer.gain));
            kept.shift = keep(column(layer.shift));
        }
        widest_ = std::max(widest_, padded(outputs));
        inputs = outputs;
    }
}

void Field::evaluate(Matrix<const double> points, Matrix<float> features, int threads, const Kernels& kernels) const
{
    require(points.columns == 3, "Field: `points` must have shape (N, 3)");
    require(features.rows == points.rows && features.columns == dimension(), "Field: `features` must have shape (N, D)");
    FieldJob job;
    job.points = points.data;
    std::copy(center_.begin(), center_.end(), job.center);
    job.scale = scale_;
    job.octaves = octaves_;
    job.layers = layers_.data();
    job.layer_count = layers_.size();
    job.widest = widest_;
    job.features = features.data;
    const Scratch scratch(threads, field_scratch(widest_));
    parallel_ranges(points.rows, grain_points, threads, [&](std::size_t worker, std::size_t begin, std::size_t end) {
        kernels.field(job, begin, end, scratch.of(worker));
    });
}

}  // namespace dfd
