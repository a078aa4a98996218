// Steps of a field's fit (paper, Eq. 3): gradients of 48 points at a time, each in its lane, as in kernels/field.cpp;
// then, weight by weight, the sum over all points and the step of Adam (Kingma and Ba 2015), so that no gradient is kept.

#include "dfd/kernels/neurons.hpp"
#include "dfd/kernels/tile.hpp"
#include "dfd/kernels/transpose.hpp"
#include "dfd/kernels/variants.hpp"

namespace dfd {
namespace {

// Sums that are kept in registers: of activations for some points, and of some rows of a matrix's gradient.
#if defined(__AVX512F__)
constexpr std::size_t tile_neurons = 8, tile_vectors = 3, gradient_rows = 8;
#elif defined(__AVX2__)
constexpr std::size_t tile_neurons = 4, tile_vectors = 2, gradient_rows = 4;
#else
constexpr std::size_t tile_neurons = 2, tile_vectors = 4, gradient_rows = 4;
#endif
constexpr std::size_t tile_points = tile_vectors * lanes<float>;
// Columns of a gradient that are summed together: what they take of all points stays in the nearest cache meanwhile.
constexpr std::size_t gradient_vectors = 2, gradient_columns = gradient_vectors * lanes<float>;
static_assert(field_points % tile_points == 0 && field_points % block_size == 0 && fit_group % tile_neurons == 0);
static_assert(fit_rows % gradient_rows == 0 && fit_columns % gradient_columns == 0 && block_size % lanes<float> == 0);

DFD_INLINE const FitActivations& of(const FitJob& job, std::size_t unit, std::size_t layer)
{
    return job.activations[unit * job.layer_count + layer];
}

// Where the entry of an input and an output lies in the matrix of a layer: (groups, inputs, 16), so that it is gone
// through in the order of its memory both ways.
DFD_INLINE std::size_t place_of(const FitLayer& layer, std::size_t input, std::size_t output)
{
    return layer.weight + (output / block_size * layer.inputs + input) * block_size + output % block_size;
}

template <class Done>
DFD_INLINE void leave(const Float (&sums)[tile_neurons][tile_vectors], std::size_t first, std::size_t point,
                      const Done& done)
{
#pragma GCC unroll 8
    for (std::size_t r = 0; r < tile_neurons; ++r)
#pragma GCC unroll 4
        for (std::size_t v = 0; v < tile_vectors; ++v) done(first + r, point + v * lanes<float>, sums[r][v]);
}

// What a layer makes of activations (inputs, 48), to `done(output, point, sums)`.
template <class Done>
void multiply(const FitJob& job, const FitLayer& layer, const float* in, const Done& done)
{
    for (std::size_t point = 0; point < field_points; point += tile_points)
        for (std::size_t first = 0; first < layer.outputs; first += tile_neurons) {
            Float sums[tile_neurons][tile_vectors]{};
            add_products(job.values + place_of(layer, 0, first), 1, block_size, in + point, row, layer.inputs, sums);
            leave(sums, first, point, done);
        }
}

// What a gradient (outputs, 48) of its outputs makes of its inputs, to `done(input, point, sums)`.
template <class Done>
void multiply_back(const FitJob& job, const FitLayer& layer, const float* gradient, const Done& done)
{
    for (std::size_t point = 0; point < field_points; point += tile_points)
        for (std::size_t first = 0; first < layer.inputs; first += tile_neurons) {
            Float sums[tile_neurons][tile_vectors]{};
            for (std::size_t output = 0; output < layer.outputs; output += block_size)
                add_products(job.values + place_of(layer, first, output), block_size, 1, gradient + output * row + point,
                             row, block_size, sums);
            leave(sums, first, point, done);
        }
}

// The gradient (outputs, 48) to rows of points, for the sums of all points: (panels, points, gradient_columns).
void turn(const FitJob& job, std::size_t unit, std::size_t outputs, const float* gradient, float* turned)
{
    float lanes_of[gradient_columns * block_size];
    for (std::size_t output = 0; output < outputs; output += gradient_columns)
        for (std::size_t point = 0; point < field_points; point += block_size) {
            for (std::size_t c = 0; c < gradient_columns; ++c)
                copy(gradient + (output + c) * row + point, block_size, lanes_of + c * block_size);
            lanes_to_rows(lanes_of, gradient_columns,
                          turned + output * job.units * field_points + (unit * field_points + point) * gradient_columns,
                          gradient_columns);
        }
}

DFD_INLINE float sum_of(const float* points)
{
    Float sum{};
    for (std::size_t point = 0; point < field_points; point += lanes<float>) sum += load<Float>(points + point);
    return sum_of(sum);
}

// ReLU is done; (x - mean) / sqrt(variance + 1e-5) to `unit`, and its gain and shift to `out`.
void normalize_layer(const FitLayer& layer, const float* values, const float* in, const FitActivations& unit, float* out)
{
    for (std::size_t point = 0; point < field_points; point += lanes<float>) {
        const auto [mean, factor] = moments_of(in + point, layer.outputs);
        store(unit.factor + point, factor);
        store(unit.least + point, (Float{} - mean) * factor);
        for (std::size_t k = 0; k < layer.outputs; ++k) {
            const Float normal = (load<Float>(in + k * row + point) - mean) * factor;
            store(unit.normal + k * row + point, normal);
            store(out + k * row + point,
                  multiply_add(normal, splat(values[layer.gain + k]), splat(values[layer.shift + k])));
        }
    }
}

// From the gradient of what `normalize_layer` gave to that of what went into the ReLU, in place.
void normalize_back(const FitLayer& layer, const float* values, const FitActivations& unit, float* gradient)
{
    const Float share = splat(1.0f / static_cast<float>(layer.outputs));
    for (std::size_t k = 0; k < layer.outputs; ++k) {
        float* own = gradient + k * row;
        unit.shift[k] = sum_of(own);
        Float along{};
        for (std::size_t point = 0; point < field_points; point += lanes<float>)
            along = multiply_add(load<Float>(own + point), load<Float>(unit.normal + k * row + point), along);
        unit.gain[k] = sum_of(along);
    }
    for (std::size_t point = 0; point < field_points; point += lanes<float>) {
        Float sum{}, along{};
        for (std::size_t k = 0; k < layer.outputs; ++k) {
            const Float scaled = load<Float>(gradient + k * row + point) * splat(values[layer.gain + k]);
            sum += scaled;
            along = multiply_add(scaled, load<Float>(unit.normal + k * row + point), along);
        }
        const Float factor = load<Float>(unit.factor + point), least = load<Float>(unit.least + point);
        for (std::size_t k = 0; k < layer.outputs; ++k) {
            float* place = gradient + k * row + point;
            const Float normal = load<Float>(unit.normal + k * row + point);
            const Float scaled = load<Float>(place) * splat(values[layer.gain + k]);
            const Float inner = (scaled - sum * share - normal * along * share) * factor;
            store(place, select(at_least(least, normal), Float{}, inner));  // where the ReLU gave 0
        }
    }
}

// The loss of the points, and its gradient (D, 48) in place of what the last layer gave, by their `targets` (D, 48).
// Points from `count` on are none.
float finish(const FitJob& job, std::size_t count, std::size_t outputs, const float* targets, float* values)
{
    alignas(64) float counted[field_points], loss[field_points];
    for (std::size_t point = 0; point < field_points; ++point) counted[point] = point < count ? 1.0f : 0.0f;
    const Float twice = splat(2 / static_cast<float>(job.batch));
    for (std::size_t point = 0; point < field_points; point += lanes<float>) {
        Float squares{}, along{}, missed{};
        for (std::size_t k = 0; k < outputs; ++k) {
            const Float entry = load<Float>(values + k * row + point);
            squares = multiply_add(entry, entry, squares);
        }
        const Float shorter = splat(1.0f) / maximum(sqrt(squares), splat(1e-12f));
        for (std::size_t k = 0; k < outputs; ++k) {
            const Float feature = load<Float>(values + k * row + point) * shorter;
            const Float difference = feature - load<Float>(targets + k * row + point);
            missed = multiply_add(difference, difference, missed);
            along = multiply_add(feature, difference, along);
        }
        const Float counts = load<Float>(counted + point), factor = twice * shorter * counts;
        for (std::size_t k = 0; k < outputs; ++k) {
            const Float feature = load<Float>(values + k * row + point) * shorter;
            const Float difference = feature - load<Float>(targets + k * row + point);
            store(values + k * row + point, factor * (difference - feature * along));
        }
        store(loss + point, missed * counts);
    }
    return sum_of(loss);
}

// The rows (N, width) of the unit's points, as columns.
void gather(const FitJob& job, std::size_t unit, std::size_t count, const float* rows, std::size_t width, float* columns)
{
    for (std::size_t point = 0; point < field_points; ++point) {
        const std::int32_t chosen = job.chosen[unit * field_points + (point < count ? point : 0)];
        const float* from = rows + static_cast<std::size_t>(chosen) * width;
        for (std::size_t k = 0; k < width; ++k) columns[k * row + point] = from[k];
    }
}

// Adam's step for a vector of values, by their gradient.
DFD_INLINE void step(const FitJob& job, std::size_t place, Float gradient)
{
    const Float first = multiply_add(gradient - load<Float>(job.first + place), splat(1 - job.momentum),
                                     load<Float>(job.first + place));
    const Float second = multiply_add(gradient * gradient - load<Float>(job.second + place), splat(1 - job.decay),
                                      load<Float>(job.second + place));
    store(job.first + place, first);
    store(job.second + place, second);
    const Float root = multiply_add(sqrt(second), splat(job.root), splat(job.epsilon));
    store(job.values + place, load<Float>(job.values + place) - splat(job.rate) * first / root);
}

// Steps of a vector of parameters, from `place` on, whose gradients each unit has summed over its points.
template <class Sums>
void step_vector(const FitJob& job, std::size_t place, std::size_t first, const Sums& sums)
{
    for (std::size_t k = first; k < first + fit_columns; k += lanes<float>) {
        Float gradient{};
        for (std::size_t unit = 0; unit < job.units; ++unit) gradient += load<Float>(sums(unit) + k);
        step(job, place + k, gradient);
    }
}

// Steps of the columns of a matrix that are summed together.
void step_columns(const FitJob& job, std::size_t number, std::size_t column)
{
    const FitLayer& layer = job.layers[number];
    const float* panel = job.turned[number] + column * job.units * field_points;
    for (std::size_t first = 0; first < layer.inputs; first += gradient_rows) {
        Float sums[gradient_rows][gradient_vectors]{};
        for (std::size_t unit = 0; unit < job.units; ++unit)
            add_products(of(job, unit, number).in + first * row, row, 1,
                         panel + unit * field_points * gradient_columns, gradient_columns, field_points, sums);
        for (std::size_t r = 0; r < gradient_rows; ++r)
            for (std::size_t v = 0; v < gradient_vectors; ++v)
                step(job, place_of(layer, first + r, column + v * lanes<float>), sums[r][v]);
    }
}

}  // namespace

void DFD_VARIANT::fit_gradients(const FitJob& job, std::size_t unit)
{
    const std::size_t begin = unit * field_points, last = job.layer_count - 1;
    const std::size_t count = job.batch - begin < field_points ? job.batch - begin : field_points;
    float *gradient = job.gradients[2 * unit], *other = job.gradients[2 * unit + 1];
    gather(job, unit, count, job.inputs, job.layers[0].inputs, of(job, unit, 0).in);
    for (std::size_t number = 0; number < job.layer_count; ++number) {
        const FitLayer& layer = job.layers[number];
        const FitActivations& unit_of = of(job, unit, number);
        const float* bias = job.values + layer.bias;
        multiply(job, layer, unit_of.in, [&](std::size_t k, std::size_t point, Float sums) {
            const Float entry = sums + splat(bias[k]);
            store(gradient + k * row + point, number == last ? entry : maximum(entry, Float{}));
        });
        if (number != last)
            normalize_layer(layer, job.values, gradient, unit_of, of(job, unit, number + 1).in);
    }
    gather(job, unit, count, job.targets, job.layers[last].outputs, other);
    job.losses[unit] = finish(job, count, job.layers[last].outputs, other, gradient);
    for (std::size_t number = job.layer_count; number-- > 0;) {
        const FitLayer& layer = job.layers[number];
        const FitActivations& unit_of = of(job, unit, number);
        if (number != last) normalize_back(layer, job.values, unit_of, gradient);
        for (std::size_t k = 0; k < layer.outputs; ++k) unit_of.bias[k] = sum_of(gradient + k * row);
        turn(job, unit, layer.outputs, gradient, job.turned[number]);
        if (number == 0) break;
        multiply_back(job, layer, gradient,
                      [&](std::size_t k, std::size_t point, Float sums) { store(other + k * row + point, sums); });
        float* next = other;
        other = gradient;
        gradient = next;
    }
}

void DFD_VARIANT::fit_steps(const FitJob& job, std::size_t number, std::size_t first)
{
    const FitLayer& layer = job.layers[number];
    for (std::size_t column = first; column < first + fit_columns; column += gradient_columns)
        step_columns(job, number, column);
    step_vector(job, layer.bias, first, [&](std::size_t unit) { return of(job, unit, number).bias; });
    if (number + 1 == job.layer_count) return;
    step_vector(job, layer.gain, first, [&](std::size_t unit) { return of(job, unit, number).gain; });
    step_vector(job, layer.shift, first, [&](std::size_t unit) { return of(job, unit, number).shift; });
}

}  // namespace dfd
