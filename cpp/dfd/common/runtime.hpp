#pragma once

#include <cstddef>
#include <functional>

namespace dfd {

/// Work for one thread of several, by its number. It must not throw.
using WorkerTask = std::function<void(std::size_t worker)>;

/// Calls `task` on several threads at once, numbered below `workers`, this one as 0. It may be called for fewer than
/// there were asked for.
///
/// The threads are those of GNU's OpenMP, found when they are first needed: where torch has loaded it, or will, both
/// share one pool. Nothing is linked against it; where there is none, threads are started for the call.
void run_workers(std::size_t workers, const WorkerTask& task);

/// The same on threads that are started for the call, whatever there is.
void run_own_threads(std::size_t workers, const WorkerTask& task);

}  // namespace dfd
