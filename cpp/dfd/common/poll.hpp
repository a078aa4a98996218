#pragma once

#include <exception>
#include <functional>

namespace dfd {

/// A function that the calling thread calls repeatedly during its work; the result true stops the work.
using Poll = std::function<bool()>;

/// Thrown by a call that its `Poll` stops; the call's result is unfinished.
struct Stopped : std::exception {
    const char* what() const noexcept override { return "stopped"; }
};

}  // namespace dfd
