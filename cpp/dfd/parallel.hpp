#pragma once

#include <algorithm>
#include <cstddef>

#ifndef _OPENMP
#include <thread>
#include <vector>
#endif

namespace dfd {

/// Calls `work(begin, end)` on at most `threads` contiguous shares of 0 … `count`, each a multiple of `grain` but the
/// last. `work` must not throw. One thread touches no runtime at all, so that it is safe in a forked child.
template <class Work>
void parallel_ranges(std::size_t count, std::size_t grain, int threads, const Work& work)
{
    const std::size_t grains = (count + grain - 1) / grain;
    const std::size_t shares = std::min(grains, static_cast<std::size_t>(std::max(threads, 1)));
    if (shares <= 1) {
        if (count > 0) work(std::size_t{0}, count);
        return;
    }
    const auto share = [&](std::size_t index) {
        const std::size_t begin = grains * index / shares * grain;
        const std::size_t end = std::min(grains * (index + 1) / shares * grain, count);
        work(begin, end);
    };
#ifdef _OPENMP
#pragma omp parallel for schedule(static, 1) num_threads(static_cast<int>(shares))
    for (std::size_t index = 0; index < shares; ++index) share(index);
#else
    std::vector<std::thread> others;
    others.reserve(shares - 1);
    for (std::size_t index = 1; index < shares; ++index) others.emplace_back(share, index);
    share(0);
    for (std::thread& other : others) other.join();
#endif
}

}  // namespace dfd
