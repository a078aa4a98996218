// Times the kernels alone, beside what the memory allows: bench_kernels [vertices] [threads] [dimensions].
//
// One thread is timed by its own processor time, which other programs disturb least; more by the clock on the wall.
// Every line: instruction set, work, best and median milliseconds, bytes that must move, and the share of the ceiling.

#include "dfd/bind.hpp"
#include "dfd/kernels/dispatch.hpp"
#include "dfd/common/parallel.hpp"
#include "dfd/pose.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace {

struct Free {
    void operator()(void* memory) const { std::free(memory); }
};

template <class T>
struct Buffer {
    std::size_t size;
    std::unique_ptr<T, Free> memory;

    explicit Buffer(std::size_t count)
        : size(count), memory(static_cast<T*>(std::aligned_alloc(page, (count * sizeof(T) + page) / page * page)))
    {
#ifdef __linux__
        madvise(memory.get(), (count * sizeof(T) + page) / page * page, MADV_HUGEPAGE);  // as NumPy's arrays are
#endif
        std::memset(static_cast<void*>(memory.get()), 0, count * sizeof(T));
    }
    T* data() const { return memory.get(); }

    static constexpr std::size_t page = std::size_t{1} << 21;
};

struct Timing {
    double best, median;  // seconds
};

int thread_count = 1;

double now()
{
    timespec time;
    clock_gettime(thread_count == 1 ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

Timing measure(const std::function<void()>& work)
{
    std::vector<double> seconds;
    work();
    const double start = now();
    while (seconds.size() < 9 || (seconds.size() < 300 && now() - start < 0.4)) {
        const double before = now();
        work();
        seconds.push_back(now() - before);
    }
    std::sort(seconds.begin(), seconds.end());
    return {seconds.front(), seconds[seconds.size() / 2]};
}

void report(const char* variant, const std::string& work, Timing timing, double bytes, const Timing* ceiling)
{
    std::printf("%-9s %-40s %9.3f %9.3f %9.1f %9.1f", variant, work.c_str(), 1e3 * timing.best, 1e3 * timing.median,
                bytes / 1e6, bytes / timing.best / 1e9);
    if (ceiling != nullptr) std::printf(" %6.0f %%", 100 * ceiling->best / timing.best);
    std::printf("\n");
    std::fflush(stdout);
}

std::uint64_t random_state = 1;
std::uint32_t random_bits()
{
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<std::uint32_t>(random_state >> 33);
}
float uniform() { return static_cast<float>(random_bits()) / 2147483648.0f; }

// The time to read, or to copy, so many bytes, on the same threads.
Timing read_ceiling(std::size_t bytes)
{
    const Buffer<std::uint64_t> memory(bytes / 8);
    static volatile std::uint64_t sink;
    return measure([&] {
        dfd::parallel_ranges(memory.size, 1024, thread_count, [&](std::size_t, std::size_t begin, std::size_t end) {
            std::uint64_t sums[16] = {};
            for (std::size_t i = begin; i + 16 <= end; i += 16)
                for (std::size_t k = 0; k < 16; ++k) sums[k] += memory.data()[i + k];
            std::uint64_t total = 0;
            for (const std::uint64_t sum : sums) total += sum;
            sink = total;
        });
    });
}

Timing copy_ceiling(std::size_t bytes)
{
    const Buffer<char> from(bytes / 2), to(bytes / 2);
    return measure([&] {
        dfd::parallel_ranges(from.size, 4096, thread_count, [&](std::size_t, std::size_t begin, std::size_t end) {
            std::memcpy(to.data() + begin, from.data() + begin, end - begin);
        });
    });
}

}  // namespace

int main(int argc, char** argv)
{
    const std::size_t vertices = argc > 1 ? std::strtoul(argv[1], nullptr, 10) / 16 * 16 : 500000;
    thread_count = argc > 2 ? std::atoi(argv[2]) : 1;
    const std::size_t dimensions = argc > 3 ? std::strtoul(argv[3], nullptr, 10) / 4 * 4 : 64;
    const std::size_t blocks = vertices / 16;
    std::printf("%zu vertices, %zu dimensions, %d threads\n", vertices, dimensions, thread_count);
    std::printf("%-9s %-40s %9s %9s %9s %9s\n", "", "", "best ms", "median ms", "MB", "GB/s");

    const std::size_t byte_size = blocks * (dimensions + 4) * 16, half_size = blocks * dimensions * 32;
    const std::size_t pose_size = vertices * 28;
    const Timing read_bytes = read_ceiling(byte_size), read_halves = read_ceiling(half_size);
    const Timing copy = copy_ceiling(pose_size);
    report("", "read as many bytes as int8", read_bytes, double(byte_size), nullptr);
    report("", "read as many bytes as float16", read_halves, double(half_size), nullptr);
    report("", "copy 28 bytes a vertex", copy, double(pose_size), nullptr);

    Buffer<std::uint8_t> bytes(byte_size);
    for (std::size_t b = 0; b < blocks; ++b) {
        std::uint8_t* block = bytes.data() + b * (dimensions + 4) * 16;
        std::array<std::int32_t, 16> squares{};
        for (std::size_t k = 0; k < dimensions * 16; ++k) {
            const auto entry = static_cast<std::int32_t>(random_bits() % 61) - 30;
            block[k] = static_cast<std::uint8_t>(entry + 128);
            squares[k / 4 % 16] += entry * entry;
        }
        std::memcpy(block + dimensions * 16, squares.data(), sizeof squares);
    }
    Buffer<std::uint16_t> halves(half_size / 2);
    for (std::size_t k = 0; k < halves.size; ++k)
        halves.data()[k] = static_cast<std::uint16_t>(0x2800 + random_bits() % 0x400);
    constexpr std::size_t most_handles = 100;
    Buffer<float> handles(most_handles * dimensions), weights(vertices * most_handles), geodesic(vertices * 10);
    Buffer<std::uint16_t> geodesic_halves(vertices * 10);
    for (std::size_t k = 0; k < handles.size; ++k) handles.data()[k] = static_cast<float>(int(random_bits() % 61) - 30);
    for (std::size_t k = 0; k < geodesic.size; ++k) {
        geodesic.data()[k] = uniform();
        geodesic_halves.data()[k] = static_cast<std::uint16_t>(0x2c00 + random_bits() % 0x1000);  // 1/16 to 1
    }
    const std::vector<float> locality(10, 2.0f);

    Buffer<float> points(3 * vertices), posed(3 * vertices), single(vertices);
    for (std::size_t k = 0; k < points.size; ++k) points.data()[k] = uniform();
    for (std::size_t k = 0; k < single.size; ++k) single.data()[k] = uniform();
    Buffer<float> many(vertices * most_handles);
    for (std::size_t k = 0; k < many.size; ++k) many.data()[k] = uniform() / most_handles;
    std::vector<dfd::Affine> transforms(most_handles);
    for (dfd::Affine& transform : transforms)
        for (double& entry : transform) entry = double(uniform());
    constexpr dfd::Affine identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const std::unique_ptr<bool[]> sides(new bool[most_handles]());

    for (const std::string& name : dfd::instruction_sets()) {
        const dfd::Kernels& kernels = dfd::kernels(name);
        enum class Distances { none, floats, halves };
        const auto bind = [&](dfd::Features::Layout layout, std::size_t count, Distances distances) {
            const bool is_bytes = layout == dfd::Features::Layout::bytes;
            const void* data = is_bytes ? static_cast<const void*>(bytes.data()) : halves.data();
            const dfd::Features features{layout, data, vertices, dimensions, 0.003f};
            dfd::Constraints constraints;
            if (distances != Distances::none) {
                constraints.fixed.rows = {handles.data() + 20 * dimensions, 3, dimensions};
                constraints.locality = {locality.data(), count};
                if (distances == Distances::floats)
                    constraints.geodesic = dfd::Matrix<const float>{geodesic.data(), count, vertices};
                else
                    constraints.geodesic = dfd::Matrix<const std::uint16_t>{geodesic_halves.data(), count, vertices};
            }
            const Timing timing = measure([&] {
                dfd::bind(features, {.rows = {handles.data(), count, dimensions}}, constraints,
                          {weights.data(), vertices, count}, thread_count, kernels);
            });
            const std::size_t width = distances == Distances::none ? 0 : distances == Distances::floats ? 4 : 2;
            const std::size_t moved = (is_bytes ? byte_size : half_size) + vertices * count * (4 + width);
            const char* const narrowed[] = {"", " + 3 fixed + locality", " + 3 fixed + locality, half"};
            const std::string work = std::string("bind ") + std::to_string(count) + (is_bytes ? " int8" : " float16") +
                                     narrowed[static_cast<std::size_t>(distances)];
            report(kernels.name, work, timing, double(moved), count == 1 ? (is_bytes ? &read_bytes : &read_halves) : nullptr);
        };
        for (const auto layout : {dfd::Features::Layout::bytes, dfd::Features::Layout::halves}) {
            for (const std::size_t count : {1u, 10u, 100u}) bind(layout, count, Distances::none);
            bind(layout, 10, Distances::floats);
            bind(layout, 10, Distances::halves);
        }

        const auto pose = [&](const char* work, std::size_t count, bool mirrored, bool based) {
            dfd::PoseArrays<float> arrays;
            arrays.vertices = {points.data(), vertices, 3};
            arrays.weights = {count == 1 ? single.data() : many.data(), vertices, count};
            arrays.posed = {posed.data(), vertices, 3};
            if (based) arrays.base = arrays.vertices;
            dfd::Motion motion{{transforms.data(), count}, identity, {}};
            if (mirrored) motion.mirror = dfd::Mirror{{1, 0, 0}, 0.5, 0.01, {sides.get(), count}};
            const Timing timing = measure([&] { dfd::pose<float>(arrays, motion, thread_count, kernels); });
            report(kernels.name, work, timing, double(vertices * (24 + 4 * count)), count == 1 ? &copy : nullptr);
        };
        pose("pose 1", 1, false, false);
        pose("pose 1 across a mirror", 1, true, false);
        pose("drag 1", 1, false, true);
        pose("pose 100", most_handles, false, false);
    }
}
