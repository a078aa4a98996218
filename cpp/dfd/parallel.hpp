#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>

#ifdef _OPENMP
#include <omp.h>
#else
#include <thread>
#include <vector>
#endif

namespace dfd {

/// Calls `work(worker, begin, end)` until ranges have covered 0 … `count`, on workers numbered below `threads`. Ranges
/// are multiples of `grain` but the last, and several for each worker, so that one that is held up delays little.
/// `work` must not throw. One thread touches no runtime at all, so that it is safe in a forked child.
template <class Work>
void parallel_ranges(std::size_t count, std::size_t grain, int threads, const Work& work)
{
    constexpr std::size_t ranges_per_worker = 8, alignment = 16;
    const std::size_t workers =
        std::min(count / grain, static_cast<std::size_t>(std::max(threads, 1)));
    if (workers <= 1) {
        if (count > 0) work(std::size_t{0}, std::size_t{0}, count);
        return;
    }
    const std::size_t share = (count + workers * ranges_per_worker - 1) / (workers * ranges_per_worker);
    const std::size_t range = (share + alignment - 1) / alignment * alignment;
    std::atomic<std::size_t> next = 0;
    const auto take_ranges = [&](std::size_t worker) {
        for (std::size_t begin; (begin = next.fetch_add(range, std::memory_order_relaxed)) < count;)
            work(worker, begin, std::min(begin + range, count));
    };
#ifdef _OPENMP
#pragma omp parallel num_threads(static_cast<int>(workers))
    take_ranges(static_cast<std::size_t>(omp_get_thread_num()));
#else
    std::vector<std::thread> others;
    others.reserve(workers - 1);
    for (std::size_t worker = 1; worker < workers; ++worker) others.emplace_back(take_ranges, worker);
    take_ranges(0);
    for (std::thread& other : others) other.join();
#endif
}

}  // namespace dfd
