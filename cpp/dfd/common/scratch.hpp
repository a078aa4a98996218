#pragma once

#include <cstddef>
#include <memory>
#include <new>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace dfd {

/// One piece of memory for each worker, aligned for the widest vectors, taken before they start.
class Scratch {
public:
    Scratch(int workers, std::size_t floats)
        : size_((floats + line - 1) / line * line),
          memory_(taken(static_cast<std::size_t>(workers < 1 ? 1 : workers) * size_ * sizeof(float)))
    {
    }

    float* of(std::size_t worker) const { return memory_.get() + worker * size_; }

private:
    static constexpr std::size_t line = 64 / sizeof(float), large_page = std::size_t{1} << 21;

    struct Free {
        std::align_val_t alignment{64};
        void operator()(float* memory) const { ::operator delete(memory, alignment); }
    };

    // What fills large pages lies in them where the system has them: small ones are cleared and looked up one by one.
    static std::unique_ptr<float, Free> taken(std::size_t bytes)
    {
        const Free free{std::align_val_t{bytes < large_page ? line * sizeof(float) : large_page}};
        void* memory = ::operator new(bytes, free.alignment);
#ifdef __linux__
        if (bytes >= large_page) madvise(memory, bytes / large_page * large_page, MADV_HUGEPAGE);
#endif
        return {static_cast<float*>(memory), free};
    }

    std::size_t size_;
    std::unique_ptr<float, Free> memory_;
};

}  // namespace dfd
