#pragma once

#include "dfd/kernels/kernels.hpp"
#include "dfd/common/matrix.hpp"

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace dfd {

/// A layer of the network: a linear map. In a hidden layer, a ReLU follows, and then a LayerNorm.
struct Layer {
    Matrix<const float> weight;   // (outputs, inputs)
    std::span<const float> bias;  // (outputs)
    std::span<const float> gain;  // (outputs) gain of the LayerNorm; empty for the last layer
    std::span<const float> shift; // (outputs) shift of the LayerNorm; empty for the last layer
};

/// The feature field Φ: a multilayer perceptron from points in space to unit features (paper, supplement L).
///
/// Several threads may evaluate one field at the same time.
class Field {
public:
    /// @param layers the hidden layers, then the last layer; the first layer has 3 + 6 `octaves` inputs
    /// @param octaves number of frequencies π/2 · 2^k, for k from 0
    /// @param center, scale for a point p, the inputs are x = (p - center) · scale, then sin and cos of π/2 · 2^k · x
    /// @throws std::invalid_argument if the outputs of a layer do not match the inputs of the next layer
    Field(std::span<const Layer> layers, std::size_t octaves, std::array<double, 3> center, double scale);

    std::size_t dimension() const { return layers_.back().outputs; }

    /// Writes the unit-length features of `points` (N, 3) to `features` (N, D).
    /// @throws std::invalid_argument if the array shapes disagree
    void evaluate(Matrix<const double> points, Matrix<float> features, int threads, const Kernels& kernels) const;

private:
    std::vector<std::vector<float>> memory_;
    std::vector<FieldLayer> layers_;
    std::size_t octaves_, widest_ = 0;
    std::array<double, 3> center_;
    double scale_;
};

}  // namespace dfd
