#pragma once

#include "dfd/common/poll.hpp"

#include <nanobind/nanobind.h>

#include <chrono>
#include <thread>

/// Acquires the interpreter's lock again. An interpreter that shuts down ends all threads that wait for its lock. The
/// frames on this thread's stack cannot be unwound, so the thread sleeps until the process ends.
inline void take_lock(PyThreadState* state)
{
    try {
        PyEval_RestoreThread(state);
    } catch (...) {
        for (;;) std::this_thread::sleep_for(std::chrono::hours(24));
    }
}

/// Calls `work(poll)` without the interpreter's lock. `poll` runs the handlers of signals, such as Ctrl-C; if a handler
/// raises an error, the work stops.
template <class Work>
void unlocked(const Work& work)
{
    using Clock = std::chrono::steady_clock;
    constexpr std::chrono::milliseconds between(100);
    PyThreadState* state = PyEval_SaveThread();
    Clock::time_point asked = Clock::now();
    const dfd::Poll poll = [&] {
        if (Clock::now() - asked < between) return false;
        take_lock(state);
        const bool raised = PyErr_CheckSignals() != 0;
        state = PyEval_SaveThread();
        asked = Clock::now();
        return raised;
    };
    try {
        work(poll);
    } catch (const dfd::Stopped&) {
        take_lock(state);
        throw nanobind::python_error();
    } catch (const std::exception&) {
        take_lock(state);
        throw;
    }
    take_lock(state);
}
