#pragma once

#include "dfd/common/matrix.hpp"
#include "dfd/common/scratch.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>

namespace nb = nanobind;

template <class T>
using InputMatrix = nb::ndarray<const T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
template <class T>
using InputVector = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <class T>
using OutputMatrix = nb::ndarray<nb::numpy, T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T>
dfd::Matrix<const T> matrix(const InputMatrix<T>& array)
{
    return {array.data(), array.shape(0), array.shape(1)};
}

template <class T>
std::span<const T> span(const InputVector<T>& array)
{
    return {array.data(), array.size()};
}

template <class T>
dfd::Matrix<T> matrix(OutputMatrix<T>& array)
{
    return {array.data(), array.shape(0), array.shape(1)};
}

template <class T>
using StridedInput = nb::ndarray<const T, nb::ndim<2>, nb::device::cpu>;
template <class T>
using StridedOutput = nb::ndarray<nb::numpy, T, nb::ndim<2>, nb::device::cpu>;

/// Returns a view of weights (V, H). Throws std::invalid_argument(message) if neither rows nor columns are contiguous.
template <class T, class Array>
dfd::StridedMatrix<T> strided_matrix(const Array& array, const char* message)
{
    const auto rows = static_cast<std::int64_t>(array.shape(0)), columns = static_cast<std::int64_t>(array.shape(1));
    std::int64_t row_stride = array.stride(0), column_stride = array.stride(1);
    // In NumPy, the stride along a dimension of length 1 is arbitrary.
    if (rows <= 1) row_stride = std::max<std::int64_t>(columns, 1);
    if (columns <= 1) column_stride = row_stride == 1 ? std::max<std::int64_t>(rows, 1) : 1;
    const bool row_major = column_stride == 1 && row_stride >= columns;
    const bool column_major = row_stride == 1 && column_stride >= rows;
    if (rows * columns != 0 && !row_major && !column_major) throw std::invalid_argument(message);
    return {array.data(), array.shape(0), array.shape(1), static_cast<std::size_t>(row_stride),
            static_cast<std::size_t>(column_stride)};
}

/// Returns a new uninitialized array (rows, columns) that Python owns.
template <class T>
OutputMatrix<T> make_matrix(std::size_t rows, std::size_t columns)
{
    if (columns != 0 && rows > PTRDIFF_MAX / sizeof(T) / columns) throw std::bad_alloc();
    auto memory = std::make_unique<dfd::AlignedMemory>(dfd::take_memory(rows * columns * sizeof(T)));
    nb::capsule owner(memory.get(), [](void* released) noexcept { delete static_cast<dfd::AlignedMemory*>(released); });
    return OutputMatrix<T>(memory.release()->get(), {rows, columns}, owner);
}
