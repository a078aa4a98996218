#pragma once

#include <cstddef>
#include <memory>
#include <new>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace dfd {

struct FreeAligned {
    std::align_val_t alignment{64};
    void operator()(void* memory) const { ::operator delete(memory, alignment); }
};

/// Uninitialized memory, aligned to at least 64 bytes, the size of the widest SIMD vectors.
using AlignedMemory = std::unique_ptr<void, FreeAligned>;

/// Allocates memory, with large pages if `bytes` is large and the system has such pages. The system clears each page at
/// its first access. With small pages, clearing takes longer than the kernel that fills them.
inline AlignedMemory take_memory(std::size_t bytes)
{
    constexpr std::size_t line = 64, large_page = std::size_t{1} << 21;
    const bool large = bytes >= 2 * large_page;
    const std::size_t alignment = large ? large_page : line;
    // The size is a multiple of the page, so that the last page can be large.
    const std::size_t size = (bytes + alignment - 1) / alignment * alignment;
    const FreeAligned free{std::align_val_t{alignment}};
    AlignedMemory memory(::operator new(size, free.alignment), free);
#ifdef __linux__
    if (large) madvise(memory.get(), size, MADV_HUGEPAGE);
#endif
    return memory;
}

/// Scratch memory of `floats` floats for each worker, allocated before the workers start.
class Scratch {
public:
    Scratch(int workers, std::size_t floats)
        : size_((floats + line - 1) / line * line),
          memory_(take_memory(static_cast<std::size_t>(workers < 1 ? 1 : workers) * size_ * sizeof(float)))
    {
    }

    float* of(std::size_t worker) const { return static_cast<float*>(memory_.get()) + worker * size_; }

private:
    static constexpr std::size_t line = 64 / sizeof(float);

    std::size_t size_;
    AlignedMemory memory_;
};

}  // namespace dfd
