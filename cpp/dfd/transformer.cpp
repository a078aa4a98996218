#include "dfd/transformer.hpp"

#include "dfd/common/require.hpp"

#include <algorithm>

namespace dfd {

Transformer::Transformer(std::span<const BlockWeights> blocks, std::span<const float> gain,
                         std::span<const float> shift, std::size_t heads, float epsilon,
                         const Kernels& kernels)
    : kernels_(kernels.transformer)
{
    require(!blocks.empty() && heads > 0, "Transformer: there must be at least one block, and one head");
    job_.width = gain.size();
    job_.hidden = blocks[0].widen.rows;
    job_.heads = heads;
    job_.epsilon = epsilon;
    const std::size_t columns = kernels_.columns();
    require(job_.width > 0 && job_.width % (heads * columns) == 0 && job_.hidden > 0 && job_.hidden % columns == 0,
            "Transformer: the widths of heads and perceptrons must be multiples of what the kernels take together");
    const std::size_t width = job_.width, hidden = job_.hidden;
    for (const BlockWeights& block : blocks) {
        TransformerBlock& own = blocks_.emplace_back();
        own.project = packed(block.project, 3 * width, width);
        own.mix = packed(block.mix, width, width);
        own.widen = packed(block.widen, hidden, width);
        own.narrow = packed(block.narrow, width, hidden);
        own.project_bias = kept(block.project_bias, 3 * width);
        own.mix_bias = kept(block.mix_bias, width);
        own.widen_bias = kept(block.widen_bias, hidden);
        own.narrow_bias = kept(block.narrow_bias, width);
        own.gain_1 = kept(block.gain_1, width);
        own.shift_1 = kept(block.shift_1, width);
        own.gain_2 = kept(block.gain_2, width);
        own.shift_2 = kept(block.shift_2, width);
    }
    job_.gain = kept(gain, width);
    job_.shift = kept(shift, width);
    job_.blocks = blocks_.data();
    job_.block_count = blocks_.size();
}

void Transformer::run(Matrix<const float> tokens, Matrix<float> features) const
{
    require(tokens.columns == job_.width && features.columns == job_.width && features.rows == tokens.rows,
            "Transformer: `tokens` and `features` must have shape (N, D)");
    if (tokens.rows == 0) return;
    const Scratch scratch(1, kernels_.scratch(job_, tokens.rows));
    kernels_.run(job_, tokens.data, tokens.rows, features.data, scratch.of(0));
}

const float* Transformer::packed(Matrix<const float> weight, std::size_t outputs, std::size_t inputs)
{
    require(weight.rows == outputs && weight.columns == inputs, "Transformer: a matrix has another shape than its place");
    float* panels = memory_.emplace_back(1, outputs * inputs).of(0);  // whole panels: widths were checked
    kernels_.pack(weight.data, outputs, inputs, panels);
    return panels;
}

const float* Transformer::kept(std::span<const float> values, std::size_t size)
{
    require(values.size() == size, "Transformer: a vector has another length than its place");
    float* copy = memory_.emplace_back(1, size).of(0);
    std::copy(values.begin(), values.end(), copy);
    return copy;
}

}  // namespace dfd
