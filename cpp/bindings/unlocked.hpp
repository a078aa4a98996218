#pragma once

#include "dfd/common/poll.hpp"

#include <nanobind/nanobind.h>

#include <chrono>
#include <thread>

/// Acquires Python's global interpreter lock (GIL) again. During its shutdown, Python unwinds the stack of each thread
/// that waits for the GIL. The frames of dfd cannot be unwound, so the thread then sleeps until the process ends.
inline void acquire_gil(PyThreadState* state)
{
    try {
        PyEval_RestoreThread(state);
    } catch (...) {
        for (;;) std::this_thread::sleep_for(std::chrono::hours(24));
    }
}

/// Calls `work(poll)` without the GIL. `work` calls `poll` repeatedly. At most once per 100 ms, `poll` runs Python's
/// signal handlers, such as that of Ctrl-C. If a handler raises an exception, `work` stops and `unlocked` throws it.
template <class Work>
void unlocked(const Work& work)
{
    using Clock = std::chrono::steady_clock;
    constexpr std::chrono::milliseconds interval(100);
    PyThreadState* state = PyEval_SaveThread();
    Clock::time_point last_check = Clock::now();
    const dfd::Poll poll = [&] {
        if (Clock::now() - last_check < interval) return false;
        acquire_gil(state);
        const bool raised = PyErr_CheckSignals() != 0;
        state = PyEval_SaveThread();
        last_check = Clock::now();
        return raised;
    };
    try {
        work(poll);
    } catch (const dfd::Stopped&) {
        acquire_gil(state);
        throw nanobind::python_error();
    } catch (const std::exception&) {
        acquire_gil(state);
        throw;
    }
    acquire_gil(state);
}
