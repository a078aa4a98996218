#pragma once

#include "dfd/kernels/kernels.hpp"
#include "dfd/common/matrix.hpp"

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace dfd {

/// A linear map, and for a hidden layer the LayerNorm that follows its ReLU.
struct Layer {
    Matrix<const float> weight;   // (outputs, inputs)
    std::span<const float> bias;  // (outputs)
    std::span<const float> gain;  // (outputs) of the LayerNorm; empty for the last layer
    std::span<const float> shift; // (outputs) likewise
};

/// The feature field Φ: a multilayer perceptron from points of space to unit features (paper, supplement L).
///
/// The weights are rearranged once, when it is made; evaluating it changes nothing, so threads may share one.
class Field {
public:
    /// @param layers the hidden ones, then the last; the first takes 3 + 6 `octaves` inputs
    /// @param octaves wavelengths of sines and cosines of the coordinates that follow them: π/2 · 2^k per unit
    /// @param center, scale points p come in as (p - center) · scale
    /// @throws std::invalid_argument if the shapes do not follow each other
    Field(std::span<const Layer> layers, std::size_t octaves, std::array<double, 3> center, double scale);

    std::size_t dimension() const { return layers_.back().outputs; }

    /// Unit features (N, D) of points (N, 3).
    /// @throws std::invalid_argument if the shapes disagree
    void evaluate(Matrix<const double> points, Matrix<float> features, int threads, const Kernels& kernels) const;

private:
    std::vector<std::vector<float>> memory_;
    std::vector<FieldLayer> layers_;
    std::size_t octaves_, widest_ = 0;
    std::array<double, 3> center_;
    double scale_;
};

}  // namespace dfd
