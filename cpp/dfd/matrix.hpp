#pragma once

#include <cstddef>
#include <span>

namespace dfd {

/// A dense row-major matrix that someone else owns.
template <class T>
struct Matrix {
    T* data = nullptr;
    std::size_t rows = 0;
    std::size_t columns = 0;

    std::span<T> row(std::size_t index) const { return {data + index * columns, columns}; }
    bool empty() const { return rows == 0 || columns == 0; }
};

}  // namespace dfd
