#pragma once

#include <cstddef>
#include <span>

namespace dfd {

/// A view of a dense row-major matrix; it does not own the memory.
template <class T>
struct Matrix {
    T* data = nullptr;
    std::size_t rows = 0;
    std::size_t columns = 0;

    std::span<T> row(std::size_t index) const { return {data + index * columns, columns}; }
    bool empty() const { return rows == 0 || columns == 0; }
};

/// A view of a matrix with contiguous rows or contiguous columns. Weights (V, H) have this type.
template <class T>
struct StridedMatrix {
    T* data = nullptr;
    std::size_t rows = 0;
    std::size_t columns = 0;
    std::size_t row_stride = 0;     // number of entries in memory from one row to the next
    std::size_t column_stride = 0;  // number of entries from one column to the next; one of the two strides is 1

    StridedMatrix() = default;
    StridedMatrix(T* first, std::size_t r, std::size_t c) : StridedMatrix(first, r, c, c, 1) {}
    StridedMatrix(T* first, std::size_t r, std::size_t c, std::size_t row_step, std::size_t column_step)
        : data(first), rows(r), columns(c), row_stride(row_step), column_stride(column_step)
    {
    }

    bool contiguous() const { return rows == 0 || columns == 0 || row_stride == 1 || column_stride == 1; }
    T& operator()(std::size_t row, std::size_t column) const { return data[row * row_stride + column * column_stride]; }
};

}  // namespace dfd
