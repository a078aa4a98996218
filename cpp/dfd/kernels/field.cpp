// Evaluates the network of a feature field. The activations of 48 points, computed together, fit into the cache.

#include "dfd/kernels/layout.hpp"

#include <cmath>

namespace dfd {
namespace {

// A tile has `tile_outputs` outputs, each for `tile_vectors` vectors of points. Its sums fit into registers.
#if defined(__AVX512F__)
constexpr std::size_t tile_outputs = 8, tile_vectors = 3;
#elif defined(__AVX2__)
constexpr std::size_t tile_outputs = 4, tile_vectors = 2;
#else
constexpr std::size_t tile_outputs = 2, tile_vectors = 4;
#endif
constexpr std::size_t tile_points = tile_vectors * lanes<float>;
static_assert(field_points % tile_points == 0 && field_group % tile_outputs == 0);

// Activations have the array shape (neurons, 48). `row` is the number of floats from one neuron to the next.
constexpr std::size_t row = field_points;

// Writes the network's inputs (3 + 6 octaves, 48): coordinates, then the sines and cosines of each octave. The angles
// double with each octave. So double-angle formulas give the next octave, with negligible error in double precision.
void write_inputs(const FieldJob& job, std::size_t begin, std::size_t count, float* out)
{
    constexpr double quarter_turn = 1.5707963267948966;
    for (std::size_t point = 0; point < field_points; ++point) {
        const double* position = job.points + 3 * (begin + (point < count ? point : count - 1));
        for (std::size_t axis = 0; axis < 3; ++axis) {
            // The coordinate is rounded to float, because the network was fitted to sines of float coordinates.
            const float x = static_cast<float>((position[axis] - job.center[axis]) * job.scale);
            out[axis * row + point] = x;
            double sine = 0, cosine = 1;
            if (job.octaves > 0) {
                sine = std::sin(quarter_turn * static_cast<double>(x));
                cosine = std::cos(quarter_turn * static_cast<double>(x));
            }
            for (std::size_t octave = 0; octave < job.octaves; ++octave) {
                out[(3 + 6 * octave + axis) * row + point] = static_cast<float>(sine);
                out[(6 + 6 * octave + axis) * row + point] = static_cast<float>(cosine);
                const double doubled = 2 * sine * cosine;
                cosine = 1 - 2 * sine * sine;
                sine = doubled;
            }
        }
    }
}

// Computes a tile of the outputs (outputs, 48) of a linear map, with a ReLU if `Rectified`.
template <bool Rectified>
DFD_INLINE void multiply(const float* weights, const float* bias, std::size_t inputs, const float* in, float* out)
{
    Float sums[tile_outputs][tile_vectors];
#pragma GCC unroll 8
    for (std::size_t o = 0; o < tile_outputs; ++o)
#pragma GCC unroll 4
        for (std::size_t v = 0; v < tile_vectors; ++v) sums[o][v] = splat(bias[o]);
    for (std::size_t k = 0; k < inputs; ++k) {
        Float entries[tile_vectors];
#pragma GCC unroll 4
        for (std::size_t v = 0; v < tile_vectors; ++v) entries[v] = load<Float>(in + k * row + v * lanes<float>);
#pragma GCC unroll 8
        for (std::size_t o = 0; o < tile_outputs; ++o) {
            const Float weight = splat(weights[k * field_group + o]);
#pragma GCC unroll 4
            for (std::size_t v = 0; v < tile_vectors; ++v) sums[o][v] = multiply_add(weight, entries[v], sums[o][v]);
        }
    }
#pragma GCC unroll 8
    for (std::size_t o = 0; o < tile_outputs; ++o)
#pragma GCC unroll 4
        for (std::size_t v = 0; v < tile_vectors; ++v)
            // If the sum is NaN, `maximum` returns its second operand, the NaN.
            store(out + o * row + v * lanes<float>, Rectified ? maximum(Float{}, sums[o][v]) : sums[o][v]);
}

template <bool Rectified>
void linear(const FieldLayer& layer, const float* in, float* out)
{
    for (std::size_t output = 0; output < layer.outputs; output += field_group) {
        const float* weights = layer.weights + output * layer.inputs;
        for (std::size_t point = 0; point < field_points; point += tile_points)
            for (std::size_t o = 0; o < field_group; o += tile_outputs)
                multiply<Rectified>(weights + o, layer.bias + output + o, layer.inputs, in + point,
                                    out + (output + o) * row + point);
    }
}

// Applies the LayerNorm over the neurons of each point: (x - mean) / sqrt(variance + 1e-5) · gain + shift.
void normalize_layer(const FieldLayer& layer, float* values)
{
    const Float share = splat(1.0f / static_cast<float>(layer.outputs));
    for (std::size_t point = 0; point < field_points; point += lanes<float>) {
        Float sum{}, squares{};
        for (std::size_t k = 0; k < layer.outputs; ++k) sum += load<Float>(values + k * row + point);
        const Float mean = sum * share;
        for (std::size_t k = 0; k < layer.outputs; ++k) {
            const Float difference = load<Float>(values + k * row + point) - mean;
            squares = multiply_add(difference, difference, squares);
        }
        const Float factor = splat(1.0f) / sqrt(squares * share + splat(1e-5f));
        for (std::size_t k = 0; k < layer.outputs; ++k) {
            float* place = values + k * row + point;
            store(place, multiply_add((load<Float>(place) - mean) * factor, splat(layer.gain[k]), splat(layer.shift[k])));
        }
    }
}

// Scales the columns of `values` (D, 48) to unit length, and writes `count` columns as rows of `features` (count, D).
void write_features(const FieldLayer& layer, float* values, float* features, std::size_t count)
{
    for (std::size_t point = 0; point < field_points; point += lanes<float>) {
        Float squares{};
        for (std::size_t k = 0; k < layer.outputs; ++k) {
            const Float entry = load<Float>(values + k * row + point);
            squares = multiply_add(entry, entry, squares);
        }
        const Float factor = splat(1.0f) / maximum(sqrt(squares), splat(1e-12f));
        for (std::size_t k = 0; k < layer.outputs; ++k) {
            float* place = values + k * row + point;
            store(place, load<Float>(place) * factor);
        }
    }
    constexpr std::size_t columns = 32;  // number of columns that are transposed together
    float turned[columns * block_size];
    for (std::size_t point = 0; point < count; point += block_size) {
        const std::size_t rows = count - point < block_size ? count - point : block_size;
        for (std::size_t k = 0; k < layer.outputs; k += columns) {
            const std::size_t some = layer.outputs - k < columns ? layer.outputs - k : columns;
            for (std::size_t c = 0; c < some; ++c) copy(values + (k + c) * row + point, block_size, turned + c * block_size);
            float* to = features + point * layer.outputs + k;
            if (rows == block_size) {
                lanes_to_rows(turned, some, to, layer.outputs);
            } else {
                for (std::size_t i = 0; i < rows; ++i)
                    for (std::size_t c = 0; c < some; ++c) to[i * layer.outputs + c] = turned[c * block_size + i];
            }
        }
    }
}

}  // namespace

namespace DFD_VARIANT {

void field(const FieldJob& job, std::size_t begin, std::size_t end, float* scratch)
{
    const FieldLayer& last = job.layers[job.layer_count - 1];
    for (std::size_t i = begin; i < end; i += field_points) {
        const std::size_t count = end - i < field_points ? end - i : field_points;
        float *in = scratch, *out = scratch + job.widest * row;
        write_inputs(job, i, count, in);
        for (const FieldLayer* layer = job.layers; layer != &last; ++layer) {
            linear<true>(*layer, in, out);
            normalize_layer(*layer, out);
            float* next = in;
            in = out;
            out = next;
        }
        linear<false>(last, in, out);
        write_features(last, out, job.features + i * last.outputs, count);
    }
}

}  // namespace DFD_VARIANT
}  // namespace dfd
