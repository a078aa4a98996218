#include "dfd/fit.hpp"

#include "check.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace {

std::vector<float> normal(std::size_t count, float deviation)
{
    std::mt19937 random(11);
    std::normal_distribution<float> draw(0, deviation);
    std::vector<float> values(count);
    for (float& value : values) value = draw(random);
    return values;
}

struct Fitted {
    std::vector<float> state, losses;
};

constexpr std::size_t points = 300, batch = 130, steps = 40;

/// A network of one hidden layer that learns to turn what it is given by a quarter.
Fitted fitted(int threads, const dfd::Kernels& kernels)
{
    const std::vector<std::size_t> widths{8, 64, 64};
    const std::size_t size = dfd::fit_size(widths);
    Fitted result{std::vector<float>(3 * size), std::vector<float>(steps)};
    const std::vector<float> first = normal(size, 0.3f);
    std::copy(first.begin(), first.end(), result.state.begin());
    std::vector<float> inputs(points * 8), targets(points * 64);
    for (std::size_t i = 0; i < points; ++i) {
        const float angle = 6.28f * float(i) / points;
        inputs[8 * i] = std::cos(angle), inputs[8 * i + 1] = std::sin(angle);
        targets[64 * i] = -std::sin(angle), targets[64 * i + 1] = std::cos(angle);
    }
    std::vector<std::int32_t> chosen(steps * batch);
    for (std::size_t i = 0; i < chosen.size(); ++i) chosen[i] = std::int32_t(i * 7 % points);
    const std::vector<double> rates(steps, 0.02), momenta(steps, 0.9);
    dfd::fit({result.state.data(), 3, size}, widths, {inputs.data(), points, 8}, {targets.data(), points, 64},
             {chosen.data(), steps, batch}, {rates, momenta}, result.losses, threads, kernels);
    return result;
}

}  // namespace

CASE("a fit comes nearer to its targets, to the same bits on any number of threads")
    for (const std::string& name : dfd::instruction_sets()) {
        const Fitted alone = fitted(1, dfd::kernels(name));
        CHECK(alone.losses.back() < 0.3f * alone.losses.front());
        for (const int threads : {2, 3, 7}) {
            const Fitted shared = fitted(threads, dfd::kernels(name));
            CHECK(shared.state == alone.state);
            CHECK(shared.losses == alone.losses);
        }
    }
END

CASE("a fit refuses what does not fit together")
    const dfd::Kernels& kernels = dfd::kernels(dfd::instruction_sets().front());
    const std::vector<std::size_t> widths{8, 64, 64}, none{4};
    CHECK_THROWS(dfd::fit_size(none), "layer");
    std::vector<float> state(3 * dfd::fit_size(widths)), rows(64 * 2), losses(1);
    std::vector<std::int32_t> beyond{2};
    const std::vector<double> one{0.1};
    CHECK_THROWS(dfd::fit({state.data(), 3, state.size() / 3}, widths, {rows.data(), 2, 8}, {rows.data(), 2, 64},
                          {beyond.data(), 1, 1}, {one, one}, losses, 1, kernels),
                 "`chosen` must hold numbers of points");
END
