#pragma once

#include <exception>
#include <functional>

namespace dfd {

/// A function that a long operation calls repeatedly on the thread that started it. If it returns true, the work stops.
using Poll = std::function<bool()>;

/// The exception of an operation whose `Poll` returned true; the operation's result is incomplete.
struct Stopped : std::exception {
    const char* what() const noexcept override { return "stopped"; }
};

}  // namespace dfd
