#include "dfd/bind.hpp"

#include "dfd/parallel.hpp"
#include "dfd/require.hpp"

#include <array>
#include <atomic>
#include <cmath>

namespace dfd {
namespace {

// A distance is summed in this many interleaved lanes, whatever the width of the machine's vectors.
constexpr std::size_t lanes = 16;
constexpr std::size_t grain = 64;           // rows
constexpr float geodesic_slack = 1e-5f;     // what rounding may add to the largest distance

float distance(const float* a, const float* b, std::size_t size)
{
    std::array<float, lanes> sum{};
    std::size_t k = 0;
    for (; k + lanes <= size; k += lanes) {
        for (std::size_t lane = 0; lane < lanes; ++lane) {
            const float difference = a[k + lane] - b[k + lane];
            sum[lane] += difference * difference;
        }
    }
    for (std::size_t lane = 0; k < size; ++k, ++lane) {
        const float difference = a[k] - b[k];
        sum[lane] += difference * difference;
    }
    for (std::size_t width = lanes / 2; width > 0; width /= 2)
        for (std::size_t lane = 0; lane < width; ++lane) sum[lane] += sum[lane + width];
    return std::sqrt(sum[0]);
}

float weight(float distance) { return std::max(1.0f - distance, 0.0f); }  // Equations (4) and (5)

}  // namespace

void bind(Matrix<const float> features, Matrix<const float> handles, const Constraints& constraints,
          Matrix<float> weights, int threads)
{
    const auto& [fixed, geodesic, locality] = constraints;
    const std::size_t dimension = features.columns;
    const bool local = !locality.empty();
    require(handles.rows == 0 || handles.columns == dimension, "bind: `handles` and `features` differ in dimension");
    require(fixed.rows == 0 || fixed.columns == dimension, "bind: `fixed` and `features` differ in dimension");
    require(weights.rows == features.rows && weights.columns == handles.rows, "bind: `weights` must be (V, H)");
    require(!local || (locality.size() == handles.rows && geodesic.rows == handles.rows &&
                       geodesic.columns == features.rows),
            "bind: `geodesic` must be (H, V) and `locality` (H)");
    require_finite(handles, "bind", "handles");
    require_finite(fixed, "bind", "fixed");
    for (const float exponent : locality)
        require(std::isfinite(exponent) && exponent >= 0, "bind: `locality` must be finite and at least 0");

    std::atomic<bool> features_finite = true;
    std::atomic<bool> geodesic_valid = true;
    parallel_ranges(features.rows, grain, threads, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const float* row = features.row(i).data();
            // An overflowing sum of finite features is infinite as well; the slow check tells them apart.
            bool suspect = false;
            float held = 0;
            for (std::size_t p = 0; p < fixed.rows; ++p) {
                const float d = distance(row, fixed.row(p).data(), dimension);
                suspect |= !std::isfinite(d);
                held = std::max(held, weight(d));
            }
            for (std::size_t j = 0; j < handles.rows; ++j) {
                const float d = distance(row, handles.row(j).data(), dimension);
                suspect |= !std::isfinite(d);
                float w = std::max(weight(d) - held, 0.0f);  // Equation (6)
                if (local) {
                    const float g = geodesic.row(j)[i];
                    if (!(g >= 0.0f && g <= 1.0f + geodesic_slack)) geodesic_valid = false;
                    w *= std::pow(std::max(1.0f - g, 0.0f), locality[j]);  // Equation (7)
                }
                weights.row(i)[j] = w;
            }
            if (suspect && !all_finite(features.row(i))) features_finite = false;
        }
    });
    if (!features_finite) require_finite(features, "bind", "features");
    require(geodesic_valid, "bind: `geodesic` must lie in [0, 1]");
}

}  // namespace dfd
