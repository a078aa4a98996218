#include "dfd/common/runtime.hpp"

#include <system_error>
#include <thread>
#include <vector>

#ifdef DFD_FIND_OPENMP
#include <dlfcn.h>
#endif

namespace dfd {

#ifdef DFD_FIND_OPENMP
namespace {

// What compilers call for `#pragma omp parallel`, the same since GCC 4.9 and in LLVM's runtime under that name as well.
struct OpenMP {
    using Parallel = void (*)(void (*body)(void*), void* data, unsigned threads, unsigned flags);
    using ThreadNumber = int (*)();

    Parallel parallel = nullptr;
    ThreadNumber thread_number = nullptr;
};

/// Never closed: threads of its pool run until the process ends.
OpenMP find_openmp()
{
    constexpr const char* name = "libgomp.so.1";
    void* library = dlopen(name, RTLD_NOW | RTLD_NOLOAD);  // torch's own copy lies where no search would find it
    if (library == nullptr) library = dlopen(name, RTLD_NOW);
    if (library == nullptr) return {};
    const OpenMP found = {reinterpret_cast<OpenMP::Parallel>(dlsym(library, "GOMP_parallel")),
                          reinterpret_cast<OpenMP::ThreadNumber>(dlsym(library, "omp_get_thread_num"))};
    return found.parallel != nullptr && found.thread_number != nullptr ? found : OpenMP{};
}

const OpenMP& openmp()
{
    static const OpenMP found = find_openmp();
    return found;
}

void run_task(void* task) noexcept
{
    (*static_cast<const WorkerTask*>(task))(static_cast<std::size_t>(openmp().thread_number()));
}

}  // namespace
#endif

void run_workers(std::size_t workers, const WorkerTask& task)
{
#ifdef DFD_FIND_OPENMP
    if (openmp().parallel != nullptr) {
        openmp().parallel(run_task, const_cast<WorkerTask*>(&task), static_cast<unsigned>(workers), 0);
        return;
    }
#endif
    run_own_threads(workers, task);
}

void run_own_threads(std::size_t workers, const WorkerTask& task)
{
    std::vector<std::thread> others;
    others.reserve(workers - 1);
    try {
        for (std::size_t worker = 1; worker < workers; ++worker) others.emplace_back(std::cref(task), worker);
    } catch (const std::system_error&) {  // those that have started, and this one, do the work
    }
    task(0);
    for (std::thread& other : others) other.join();
}

}  // namespace dfd
