#pragma once

#include "dfd/common/runtime.hpp"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <functional>
#include <vector>

namespace dfd {

/// Asked now and then by the thread that called, while it works; true stops the work.
using Poll = std::function<bool()>;

/// What a call throws that its `Poll` has stopped: its result is unfinished.
struct Stopped : std::exception {
    const char* what() const noexcept override { return "stopped"; }
};

/// Calls `work(worker, begin, end)` until ranges have covered 0 … `count`, on workers numbered below `threads`. Ranges
/// are multiples of `grain` but the last, and several for each worker, so that one that is held up delays little, nor
/// is any so long that `poll` would not be asked for a while.
/// `work` must not throw. One thread touches no runtime at all, so that it is safe in a forked child.
/// @throws Stopped if `poll` said so
template <class Work>
void parallel_ranges(std::size_t count, std::size_t grain, int threads, const Work& work, const Poll& poll = {})
{
    constexpr std::size_t ranges_per_worker = 8, longest = 512, alignment = 16;
    const std::size_t workers =
        std::max(std::min(count / grain, static_cast<std::size_t>(std::max(threads, 1))), std::size_t{1});
    const std::size_t share =
        workers == 1 ? count : (count + workers * ranges_per_worker - 1) / (workers * ranges_per_worker);
    const std::size_t range = (std::min(share, longest * grain) + alignment - 1) / alignment * alignment;
    std::atomic<std::size_t> next = 0;
    std::atomic<bool> stopped = false;
    const auto take_ranges = [&](std::size_t worker) {
        for (std::size_t begin; (begin = next.fetch_add(range, std::memory_order_relaxed)) < count;) {
            work(worker, begin, std::min(begin + range, count));
            if (worker == 0 && poll && poll()) {
                stopped = true;
                next = count;
            }
        }
    };
    if (workers == 1) {
        take_ranges(0);
    } else {
        run_workers(workers, take_ranges);
    }
    if (stopped) throw Stopped();
}

/// Calls `work(task)` for each of 0 … `count`, on at most `threads` threads; it must not throw. Each begins with the same
/// tasks whenever this is called again, for what they work on still lies in its core's cache, and then takes what is left
/// of the others'.
template <class Work>
void parallel_tasks(std::size_t count, int threads, const Work& work)
{
    const std::size_t workers = std::min(count, static_cast<std::size_t>(std::max(threads, 1)));
    if (workers <= 1) {
        for (std::size_t task = 0; task < count; ++task) work(task);
        return;
    }
    struct alignas(64) Share {
        std::atomic<std::size_t> next;
        std::size_t end;
    };
    std::vector<Share> shares(workers);
    for (std::size_t i = 0; i < workers; ++i) {
        shares[i].next = i * count / workers;
        shares[i].end = (i + 1) * count / workers;
    }
    run_workers(workers, [&](std::size_t worker) {
        for (std::size_t i = 0; i < workers; ++i) {
            Share& share = shares[(worker + i) % workers];
            for (std::size_t task; (task = share.next.fetch_add(1, std::memory_order_relaxed)) < share.end;) work(task);
        }
    });
}

}  // namespace dfd
