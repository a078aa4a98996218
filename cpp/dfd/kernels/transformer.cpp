// The blocks of a vision transformer (Dosovitskiy et al. 2021, with the LayerScale of Touvron et al. 2021 in its weights)
// for the tokens of one picture: what one core does while another does the next picture.

#include "dfd/kernels/exponential.hpp"
#include "dfd/kernels/product.hpp"
#include "dfd/kernels/variants.hpp"

namespace dfd {
namespace {

constexpr std::size_t queries = 24;  // whose scores are kept at once
static_assert(queries % tile_rows == 0);

// Pieces of one memory, each aligned for the widest vectors; without a memory they are only counted.
struct Pieces {
    float* memory;
    std::size_t used = 0;  // floats
    float* take(std::size_t count)
    {
        float* piece = memory == nullptr ? nullptr : memory + used;
        used += up_to(count, 64 / sizeof(float));
        return piece;
    }
};

struct Memory {
    Memory(const TransformerJob& job, std::size_t count, Pieces pieces)
        : tokens(up_to(count, tile_rows)), keys(up_to(count, tile_columns)), head(job.width / job.heads)
    {
        stream = pieces.take(tokens * job.width);
        entering = pieces.take(tokens * job.width);
        projected = pieces.take(tokens * 3 * job.width);
        hidden = pieces.take(tokens * job.hidden);
        key_panels = pieces.take(keys * head);
        value_panels = pieces.take(keys * head);
        scores = pieces.take(queries * keys);
        mean = pieces.take(head);
        size = pieces.used;
    }
    std::size_t tokens, keys, head;  // filled up to whole tiles, and the width of a head
    float* stream;                   // (tokens, D) what every block adds to
    float* entering;                 // (tokens, D) what goes into a product
    float* projected;                // (tokens, 3 D) queries, keys and values
    float* hidden;                   // (tokens, H)
    float *key_panels, *value_panels;
    float* scores;                   // (queries, keys), then their shares of the values
    float* mean;                     // (D / heads) of a head's keys
    std::size_t size;                // floats in all
};

// (x - mean) / sqrt(variance + epsilon) · gain + shift over a token, to `done`.
template <class Done>
DFD_INLINE void normalize(const float* token, std::size_t width, const float* gain, const float* shift, float epsilon,
                          const Done& done)
{
    const float share = 1.0f / static_cast<float>(width);
    Float sum{}, squares{};
    for (std::size_t k = 0; k < width; k += lanes<float>) sum += load<Float>(token + k);
    const Float mean = splat(sum_of(sum) * share);
    for (std::size_t k = 0; k < width; k += lanes<float>) {
        const Float difference = load<Float>(token + k) - mean;
        squares = multiply_add(difference, difference, squares);
    }
    const Float factor = splat(1.0f) / sqrt(splat(sum_of(squares) * share + epsilon));
    for (std::size_t k = 0; k < width; k += lanes<float>)
        done(k, multiply_add((load<Float>(token + k) - mean) * factor, load<Float>(gain + k), load<Float>(shift + k)));
}

void normalize_all(const TransformerJob& job, const float* gain, const float* shift, const Memory& memory)
{
    for (std::size_t token = 0; token < memory.tokens; ++token)
        normalize(memory.stream + token * job.width, job.width, gain, shift, job.epsilon,
                  [&](std::size_t k, Float values) { store(memory.entering + token * job.width + k, values); });
}

// Adds `rows` (tokens, depths) times a matrix, and its bias, to the stream.
void add_to_stream(const TransformerJob& job, const float* rows, std::size_t depths, const float* panels,
                   const float* bias, const Memory& memory)
{
    multiply(rows, memory.tokens, depths, panels, depths, job.width,
             [&](std::size_t row, std::size_t column, Float sums) {
                 float* place = memory.stream + row * job.width + column;
                 store(place, load<Float>(place) + sums + load<Float>(bias + column));
             });
}

// Lets the scores of a query become its shares of the values, but for their sum, which is returned.
float soften(float* scores, std::size_t count, std::size_t keys)
{
    Float most = load<Float>(scores);
    for (std::size_t k = lanes<float>; k < keys; k += lanes<float>) most = maximum(most, load<Float>(scores + k));
    float largest = most[0];
    for (std::size_t lane = 1; lane < lanes<float>; ++lane) largest = most[lane] > largest ? most[lane] : largest;
    Float sum{};
    for (std::size_t k = 0; k < keys; k += lanes<float>) {
        const Float share = exponential(load<Float>(scores + k) - splat(largest));
        if (k + lanes<float> <= count) {
            sum += share;
            store(scores + k, share);
        } else {
            for (std::size_t lane = 0; lane < lanes<float>; ++lane) {
                const float own = k + lane < count ? share[lane] : 0.0f;
                sum[lane] += own;
                scores[k + lane] = own;
            }
        }
    }
    return sum_of(sum);
}

// What one head of a block mixes, from `projected` to its columns of `entering`.
void attend(const TransformerJob& job, std::size_t count, std::size_t head, const Memory& memory)
{
    const std::size_t row = 3 * job.width, width = memory.head;
    const float* query = memory.projected + head * width;
    const float *key = query + job.width, *value = key + job.width;
    // The mean key adds the same to all scores of a query, which changes no share; keys nearer to 0 round off less, and
    // the largest score is never below the 0 of what fills up the tiles.
    float* mean = memory.mean;
    for (std::size_t k = 0; k < width; ++k) mean[k] = 0;
    for (std::size_t token = 0; token < count; ++token)
        for (std::size_t k = 0; k < width; ++k) mean[k] += key[token * row + k];
    for (std::size_t k = 0; k < width; ++k) mean[k] /= static_cast<float>(count);
    pack(width, count, [&](std::size_t k, std::size_t token) { return key[token * row + k] - mean[k]; },
         memory.key_panels);
    pack(count, width, [&](std::size_t token, std::size_t k) { return value[token * row + k]; }, memory.value_panels);
    for (std::size_t first = 0; first < memory.tokens; first += queries) {
        const std::size_t some = memory.tokens - first < queries ? memory.tokens - first : queries;
        multiply(query + first * row, some, row, memory.key_panels, width, memory.keys,
                 [&](std::size_t i, std::size_t token, Float sums) { store(memory.scores + i * memory.keys + token, sums); });
        float factors[queries];
        for (std::size_t i = 0; i < some; ++i)
            factors[i] = 1 / soften(memory.scores + i * memory.keys, count, memory.keys);
        multiply(memory.scores, some, memory.keys, memory.value_panels, count, width,
                 [&](std::size_t i, std::size_t k, Float sums) {
                     store(memory.entering + (first + i) * job.width + head * width + k, sums * splat(factors[i]));
                 });
    }
}

void attention(const TransformerJob& job, const TransformerBlock& block, std::size_t count, const Memory& memory)
{
    normalize_all(job, block.gain_1, block.shift_1, memory);
    multiply(memory.entering, memory.tokens, job.width, block.project, job.width,
             3 * job.width, [&](std::size_t row, std::size_t column, Float sums) {
                 store(memory.projected + row * 3 * job.width + column, sums + load<Float>(block.project_bias + column));
             });
    for (std::size_t head = 0; head < job.heads; ++head) attend(job, count, head, memory);
    add_to_stream(job, memory.entering, job.width, block.mix, block.mix_bias, memory);
}

void perceptron(const TransformerJob& job, const TransformerBlock& block, const Memory& memory)
{
    normalize_all(job, block.gain_2, block.shift_2, memory);
    multiply(memory.entering, memory.tokens, job.width, block.widen, job.width, job.hidden,
             [&](std::size_t row, std::size_t column, Float sums) {
                 store(memory.hidden + row * job.hidden + column,
                               gaussian_error_unit(sums + load<Float>(block.widen_bias + column)));
             });
    add_to_stream(job, memory.hidden, job.hidden, block.narrow, block.narrow_bias, memory);
}

}  // namespace

std::size_t DFD_VARIANT::transformer_columns() { return tile_columns; }

void DFD_VARIANT::transformer_pack(const float* weight, std::size_t outputs, std::size_t inputs, float* panels)
{
    pack(inputs, outputs, [&](std::size_t input, std::size_t output) { return weight[output * inputs + input]; },
         panels);
}

std::size_t DFD_VARIANT::transformer_scratch(const TransformerJob& job, std::size_t count)
{
    return Memory(job, count, {nullptr}).size;
}

void DFD_VARIANT::transformer(const TransformerJob& job, const float* tokens, std::size_t count, float* features,
                              float* scratch)
{
    const Memory memory(job, count, {scratch});
    copy(tokens, count * job.width, memory.stream);
    for (std::size_t k = count * job.width; k < memory.tokens * job.width; ++k) memory.stream[k] = 0;
    for (std::size_t b = 0; b < job.block_count; ++b) {
        attention(job, job.blocks[b], count, memory);
        perceptron(job, job.blocks[b], memory);
    }
    for (std::size_t token = 0; token < count; ++token)
        normalize(memory.stream + token * job.width, job.width, job.gain, job.shift, job.epsilon,
                  [&](std::size_t k, Float values) { store(features + token * job.width + k, values); });
}

}  // namespace dfd
