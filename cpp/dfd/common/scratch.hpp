#pragma once

#include <cstddef>
#include <memory>
#include <new>

namespace dfd {

/// One piece of memory for each worker, aligned for the widest vectors, taken before they start.
class Scratch {
public:
    Scratch(int workers, std::size_t floats)
        : size_((floats + line - 1) / line * line),
          memory_(static_cast<float*>(::operator new(static_cast<std::size_t>(workers < 1 ? 1 : workers) * size_ *
                                                         sizeof(float),
                                                     std::align_val_t{alignment})))
    {
    }

    float* of(std::size_t worker) const { return memory_.get() + worker * size_; }

private:
    static constexpr std::size_t alignment = 64, line = alignment / sizeof(float);

    struct Free {
        void operator()(float* memory) const { ::operator delete(memory, std::align_val_t{alignment}); }
    };

    std::size_t size_;
    std::unique_ptr<float, Free> memory_;
};

}  // namespace dfd
