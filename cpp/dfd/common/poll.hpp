#pragma once

#include <exception>
#include <functional>

namespace dfd {

/// Asked now and then by the thread that called, while it works; true stops the work.
using Poll = std::function<bool()>;

/// Thrown by a call that its `Poll` has stopped; its result is unfinished.
struct Stopped : std::exception {
    const char* what() const noexcept override { return "stopped"; }
};

}  // namespace dfd
