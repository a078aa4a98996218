#pragma once

#include "dfd/common/matrix.hpp"
#include "dfd/common/scratch.hpp"
#include "dfd/kernels/kernels.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace dfd {

/// What one block of a vision transformer has learned; H is the width of its perceptron.
struct BlockWeights {
    Matrix<const float> project, mix, widen, narrow;  // (3 D, D) queries, keys and values; (D, D); (H, D); (D, H)
    std::span<const float> project_bias, mix_bias, widen_bias, narrow_bias;
    std::span<const float> gain_1, shift_1, gain_2, shift_2;  // (D) of the LayerNorms before attention and perceptron
};

/// The blocks of a vision transformer and the LayerNorm after them, its weights packed once for the kernels.
///
/// Queries must come scaled by the root of their width, and what LayerScale multiplies by multiplied, in the weights.
/// Running it changes nothing, so threads may share one.
/// Source: Dosovitskiy et al., "An image is worth 16x16 words" (ICLR 2021); Oquab et al., "DINOv2" (TMLR 2024).
class Transformer {
public:
    /// @throws std::invalid_argument if shapes disagree, or widths are no multiples of what the kernels take together
    Transformer(std::span<const BlockWeights> blocks, std::span<const float> gain, std::span<const float> shift,
                std::size_t heads, float epsilon, const Kernels& kernels);

    Transformer(const Transformer&) = delete;  // its job points into it
    Transformer& operator=(const Transformer&) = delete;

    std::size_t width() const { return job_.width; }

    /// Tokens (N, D) of one picture, positions added, to what the last LayerNorm makes of them, (N, D); on one thread.
    /// @throws std::invalid_argument if the shapes disagree
    void run(Matrix<const float> tokens, Matrix<float> features) const;

private:
    const float* packed(Matrix<const float> weight, std::size_t outputs, std::size_t inputs);
    const float* kept(std::span<const float> values, std::size_t size);

    std::vector<Scratch> memory_;
    std::vector<TransformerBlock> blocks_;
    TransformerKernels kernels_;
    TransformerJob job_;
};

}  // namespace dfd
