#pragma once

#include <exception>
#include <functional>

namespace dfd {

/// A function that is called repeatedly, on the calling thread, during the work. If it returns true, the work stops.
using Poll = std::function<bool()>;

/// Thrown by a function whose `Poll` has stopped it; its result is incomplete.
struct Stopped : std::exception {
    const char* what() const noexcept override { return "stopped"; }
};

}  // namespace dfd
