#pragma once

// How the kernels are timed, and what the memory allows.
//
// One thread is timed by its own processor time, which other programs disturb least; more by the clock on the wall.
// Every line: instruction set, work, best and median milliseconds, bytes that must move, and the share of the ceiling.

#include "dfd/common/parallel.hpp"

#include <algorithm>
#include <cmath>
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

namespace bench {

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

inline int thread_count = 1;

inline double now()
{
    timespec time;
    clock_gettime(thread_count == 1 ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

inline Timing measure(const std::function<void()>& work)
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

inline void report(const char* variant, const std::string& work, Timing timing, double bytes, const Timing* ceiling)
{
    std::printf("%-9s %-40s %9.3f %9.3f %9.1f %9.1f", variant, work.c_str(), 1e3 * timing.best, 1e3 * timing.median,
                bytes / 1e6, bytes / timing.best / 1e9);
    if (ceiling != nullptr) std::printf(" %6.0f %%", 100 * ceiling->best / timing.best);
    std::printf("\n");
    std::fflush(stdout);
}

inline std::uint64_t random_state = 1;
inline std::uint32_t random_bits()
{
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<std::uint32_t>(random_state >> 33);
}
inline float uniform() { return static_cast<float>(random_bits()) / 2147483648.0f; }

// The time to read, or to copy, so many bytes, on the same threads.
inline Timing read_ceiling(std::size_t bytes)
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

inline Timing copy_ceiling(std::size_t bytes)
{
    const Buffer<char> from(bytes / 2), to(bytes / 2);
    return measure([&] {
        dfd::parallel_ranges(from.size, 4096, thread_count, [&](std::size_t, std::size_t begin, std::size_t end) {
            std::memcpy(to.data() + begin, from.data() + begin, end - begin);
        });
    });
}

/// What the command line says: [vertices] [threads] [dimensions].
struct Size {
    std::size_t vertices = 500'000, dimensions = 64;

    Size(int argc, char** argv)
    {
        if (argc > 1) vertices = std::strtoul(argv[1], nullptr, 10) / 16 * 16;
        if (argc > 2) thread_count = std::atoi(argv[2]);
        if (argc > 3) dimensions = std::strtoul(argv[3], nullptr, 10);
        std::printf("%zu vertices, %zu dimensions, %d threads\n%50s %9s %9s %9s %9s\n", vertices, dimensions,
                    thread_count, "", "best ms", "median ms", "MB", "GB/s");
    }
};

}  // namespace bench
