// Times the blocks of a vision transformer: bench_networks [tokens] [threads] [instruction set].
//
// What products reach is told beside the machine's own ceiling: multiply-adds on numbers that stay in registers.

#include "dfd/transformer.hpp"

#include "dfd/kernels/dispatch.hpp"
#include "measure.hpp"

#include <deque>
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

void transformer(std::size_t tokens, const dfd::Kernels& kernels, double most)
{
    constexpr std::size_t width = 384, hidden = 4 * width, heads = 6, block_count = 3;
    std::deque<std::vector<float>> memory;
    const auto matrix = [&](std::size_t rows, std::size_t columns) -> dfd::Matrix<const float> {
        return {memory.emplace_back(made(rows * columns, 0.05f)).data(), rows, columns};
    };
    const auto vector = [&](std::size_t size) -> std::span<const float> { return memory.emplace_back(made(size, 1)); };
    std::vector<dfd::BlockWeights> blocks;
    for (std::size_t i = 0; i < block_count; ++i)
        blocks.push_back({matrix(3 * width, width), matrix(width, width), matrix(hidden, width), matrix(width, hidden),
                          vector(3 * width), vector(width), vector(hidden), vector(width), vector(width), vector(width),
                          vector(width), vector(width)});
    const dfd::Transformer network(blocks, vector(width), vector(width), heads, 1e-6f, kernels);
    const auto entering = made(tokens * width, 1);
    const auto count = static_cast<std::size_t>(bench::thread_count);
    std::vector<float> leaving(count * tokens * width);
    const bench::Timing timing = bench::measure([&] {
        dfd::parallel_tasks(count, bench::thread_count, [&](std::size_t task) {
            network.run({entering.data(), tokens, width}, {leaving.data() + task * tokens * width, tokens, width});
        });
    });
    const double operations = 2.0 * double(tokens) * double(4 * width * width + 2 * width * hidden) +
                              4.0 * double(tokens) * double(tokens) * width;
    report(kernels.name, "3 blocks of DINOv2-small", timing, double(count) * block_count * operations, most);
}

}  // namespace

int main(int argc, char** argv)
{
    const std::size_t tokens = argc > 1 ? std::strtoul(argv[1], nullptr, 10) : 737;
    if (argc > 2) bench::thread_count = std::atoi(argv[2]);
    const double most = ceiling();
    std::printf("%zu tokens, %d threads; at most %.0f GFLOP/s\n%38s %9s %9s %9s\n", tokens, bench::thread_count, most, "",
                "best ms", "median ms", "GFLOP/s");
    for (const std::string& name : dfd::instruction_sets()) {
        if (argc > 3 && name != argv[3]) continue;
        const dfd::Kernels& kernels = dfd::kernels(name);
        transformer(tokens, kernels, most);
    }
}
