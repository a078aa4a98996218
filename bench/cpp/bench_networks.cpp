// Times the steps of a fit: bench_networks [threads] [instruction set].
//
// What products reach is told beside the machine's own ceiling: multiply-adds on numbers that stay in registers.

#include "dfd/fit.hpp"

#include "dfd/kernels/dispatch.hpp"
#include "measure.hpp"

#include <array>
#include <vector>

namespace {

std::vector<float> made(std::size_t count, float scale)
{
    std::vector<float> values(count);
    for (float& value : values) value = scale * (2 * bench::uniform() - 1);
    return values;
}

void report(const char* variant, const char* work, bench::Timing timing, double operations, double ceiling)
{
    const double rate = operations / timing.best / 1e9;
    std::printf("%-9s %-28s %9.3f %9.3f %9.1f %6.0f %%\n", variant, work, 1e3 * timing.best, 1e3 * timing.median, rate,
                100 * rate / ceiling);
    std::fflush(stdout);
}

/// Operations a second of multiply-adds that wait for nothing, on vectors as long as this file is compiled for.
double ceiling()
{
    constexpr std::size_t sums = 12, times = 1 << 16;
#if defined(__AVX512F__)
    constexpr std::size_t bytes = 64;
#else
    constexpr std::size_t bytes = 32;
#endif
    typedef float Vector __attribute__((vector_size(bytes)));
    static volatile float sink;
    const bench::Timing timing = bench::measure([&] {
        dfd::parallel_tasks(static_cast<std::size_t>(bench::thread_count), bench::thread_count, [&](std::size_t) {
            Vector sum[sums];
            for (std::size_t k = 0; k < sums; ++k) sum[k] = Vector{} + float(k);
            const Vector one = Vector{} + 0.999f, other = Vector{} + 1e-3f;
            for (std::size_t i = 0; i < times; ++i) {
#pragma GCC unroll 12
                for (std::size_t k = 0; k < sums; ++k) sum[k] = sum[k] * one + other;
            }
            Vector total{};
            for (const Vector& each : sum) total += each;
            sink = total[0];
        });
    });
    return 2.0 * sums * times * (bytes / sizeof(float)) * bench::thread_count / timing.best / 1e9;
}

void fit(const dfd::Kernels& kernels, double most)
{
    constexpr std::size_t points = 12'000, batch = 192, steps = 20;
    const std::array<std::size_t, 6> widths{40, 256, 256, 256, 256, 64};
    const std::size_t size = dfd::fit_size(widths);
    std::vector<float> state = made(3 * size, 0.06f), losses(steps);
    std::fill(state.begin() + static_cast<std::ptrdiff_t>(size), state.end(), 0.0f);
    const auto inputs = made(points * widths.front(), 1), targets = made(points * widths.back(), 0.2f);
    std::vector<std::int32_t> chosen(steps * batch);
    for (std::int32_t& point : chosen) point = static_cast<std::int32_t>(bench::random_bits() % points);
    const std::vector<double> rates(steps, 1e-4), momenta(steps, 0.9);
    const bench::Timing timing = bench::measure([&] {
        dfd::fit({state.data(), 3, size}, widths, {inputs.data(), points, widths.front()},
                 {targets.data(), points, widths.back()}, {chosen.data(), steps, batch}, {rates, momenta, 0}, losses,
                 bench::thread_count, kernels);
    });
    double products = 0;
    for (std::size_t i = 0; i + 1 < widths.size(); ++i)
        products += (i == 0 ? 2.0 : 3.0) * double(widths[i]) * double(widths[i + 1]);
    report(kernels.name, "20 steps of a fit", timing, 2.0 * products * double(batch * steps), most);
}

}  // namespace

int main(int argc, char** argv)
{
    if (argc > 1) bench::thread_count = std::atoi(argv[1]);
    const double most = ceiling();
    std::printf("%d threads; at most %.0f GFLOP/s\n%38s %9s %9s %9s\n", bench::thread_count, most, "", "best ms",
                "median ms", "GFLOP/s");
    for (const std::string& name : dfd::instruction_sets())
        if (argc <= 2 || name == argv[2]) fit(dfd::kernels(name), most);
}
