#pragma once

#include "dfd/common/poll.hpp"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

#ifdef DFD_OPENMP
#include <omp.h>
#endif

namespace dfd {

/// Starts `count` threads, or fewer if the system cannot start so many. Each thread calls a copy of `run` with the
/// index of the thread, 1 … `count`. `run` must not throw.
template <class Run>
std::vector<std::thread> start_threads(std::size_t count, const Run& run)
{
    std::vector<std::thread> threads;
    threads.reserve(count);
    try {
        while (threads.size() < count) threads.emplace_back(run, threads.size() + 1);
    } catch (const std::exception&) {  // std::system_error or std::bad_alloc
    }
    return threads;
}

#ifdef DFD_OPENMP
/// Returns the number of threads that can run, at most `workers`, including the calling thread.
///
/// If OpenMP cannot start a thread of a team, it ends the process. So if the team is larger than all earlier teams of
/// the calling thread, this function first tries to start the additional threads itself, and ends them again.
inline std::size_t available_workers(std::size_t workers)
{
    static thread_local std::size_t largest = 1;
    if (workers <= largest) return workers;
    std::atomic<bool> started = false;  // the threads wait until it is true, so that they exist at the same time
    std::vector<std::thread> others = start_threads(workers - largest, [&](std::size_t) { started.wait(false); });
    started = true;
    started.notify_all();
    for (std::thread& other : others) other.join();
    return largest += others.size();
}
#endif

/// Calls `work(worker, task)` for each task in [0, `count`) on at most `workers` threads: an OpenMP team, or new
/// threads in a build without OpenMP. The calling thread is worker 0. `work` must not throw.
template <class Work>
void parallel_for(std::size_t count, std::size_t workers, const Work& work)
{
#ifdef DFD_OPENMP
#pragma omp parallel num_threads(static_cast<int>(available_workers(workers)))
    {
        const auto worker = static_cast<std::size_t>(omp_get_thread_num());
#pragma omp for schedule(dynamic) nowait
        for (std::size_t task = 0; task < count; ++task) work(worker, task);
    }
#else
    std::atomic<std::size_t> next = 0;
    const auto take_tasks = [&](std::size_t worker) {
        for (std::size_t task; (task = next.fetch_add(1, std::memory_order_relaxed)) < count;) work(worker, task);
    };
    std::vector<std::thread> others = start_threads(workers - 1, take_tasks);
    take_tasks(0);
    for (std::thread& other : others) other.join();
#endif
}

/// Calls `work(worker, task)` for each task in [0, `count`), as `parallel_for` does, and `poll` after each task of
/// worker 0. A single worker runs without OpenMP, and so also in a forked process. `work` must not throw.
/// @throws Stopped if `poll` returned true
template <class Work>
void parallel_tasks(std::size_t count, std::size_t workers, const Work& work, const Poll& poll = {})
{
    std::atomic<bool> stopped = false;
    const auto take_task = [&](std::size_t worker, std::size_t task) {
        if (stopped.load(std::memory_order_relaxed)) return;
        work(worker, task);
        if (worker == 0 && poll && poll()) stopped.store(true, std::memory_order_relaxed);
    };
    if (workers <= 1) {
        for (std::size_t task = 0; task < count; ++task) take_task(0, task);
    } else {
        parallel_for(count, workers, take_task);
    }
    if (stopped) throw Stopped();
}

/// Calls `work(worker, begin, end)` for ranges that cover [0, `count`). The number of workers is at most `threads`, and
/// at most `count` / `grain`. The length of each range except the last is a multiple of 16. Each worker gets several
/// ranges, so that a slow worker hardly delays the result. A range has at most about 512 · `grain` indices, so that
/// `poll` is called often. `work` must not throw.
/// @throws Stopped if `poll` returned true
template <class Work>
void parallel_ranges(std::size_t count, std::size_t grain, int threads, const Work& work, const Poll& poll = {})
{
    constexpr std::size_t ranges_per_worker = 8, longest = 512, alignment = 16;
    const std::size_t workers =
        std::max(std::min(count / grain, static_cast<std::size_t>(std::max(threads, 1))), std::size_t{1});
    const std::size_t share =
        workers == 1 ? count : (count + workers * ranges_per_worker - 1) / (workers * ranges_per_worker);
    const std::size_t range = (std::min(share, longest * grain) + alignment - 1) / alignment * alignment;
    const std::size_t ranges = count == 0 ? 0 : (count - 1) / range + 1;
    const auto take_range = [&](std::size_t worker, std::size_t index) {
        const std::size_t begin = index * range;
        work(worker, begin, std::min(begin + range, count));
    };
    parallel_tasks(ranges, workers, take_range, poll);
}

/// Returns the number of threads in the OpenMP team for a loop on `threads` threads, or 0 if there is no team.
inline int team_size(int threads)
{
    std::atomic<int> size = 0;
    parallel_ranges(4096, 16, threads, [&](std::size_t, std::size_t, std::size_t) {
#ifdef DFD_OPENMP
        if (omp_in_parallel()) size = omp_get_num_threads();
#endif
    });
    return size;
}

}  // namespace dfd
