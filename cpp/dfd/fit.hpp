#pragma once

#include "dfd/common/matrix.hpp"
#include "dfd/kernels/kernels.hpp"

#include <cstddef>
#include <cstdint>
#include <span>

namespace dfd {

/// How Adam goes along: one entry a step.
struct FitSchedule {
    std::span<const double> rates, momenta;  // the rate, and the decay of the first moment
    std::size_t steps_before = 0;            // that the moments have seen
};

/// Floats of a network's parameters: of each layer the matrix (outputs / 16, inputs, 16), the bias, and of a hidden one the gain and
/// the shift of its LayerNorm.
/// @param widths of what enters the first layer, a multiple of `fit_rows`, and of each layer's outputs, of `fit_group`
/// @throws std::invalid_argument if there is no layer, or a width is none
std::size_t fit_size(std::span<const std::size_t> widths);

/// Goes on with the fit of a field's network (paper, Eq. 3): follows the gradient of the mean of ‖Φ(P) − Z‖² over a batch
/// of points, with Adam (Kingma and Ba, ICLR 2015).
///
/// The bits do not depend on the number of threads.
/// @param state (3, fit_size) the parameters, their first moments and their second moments
/// @param inputs (N, widths[0]) what the network is given of each point
/// @param targets (N, last width) unit rows
/// @param chosen (steps, batch) the points of each step
/// @param losses (steps) the mean of each step before it was taken
/// @throws std::invalid_argument if shapes disagree or a number in `chosen` is none of a point
void fit(Matrix<float> state, std::span<const std::size_t> widths, Matrix<const float> inputs,
         Matrix<const float> targets, Matrix<const std::int32_t> chosen, const FitSchedule& schedule,
         std::span<float> losses, int threads, const Kernels& kernels);

}  // namespace dfd
