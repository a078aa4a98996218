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

/// Returns a view of weights (V, H) whose rows or columns are contiguous.
/// @throws std::invalid_argument with `message` if neither are
template <class T, class Array>
dfd::StridedMatrix<T> strided_matrix(const Array& array, const char* message)
{
    const auto rows = static_cast<std::int64_t>(array.shape(0)), columns = static_cast<std::int64_t>(array.shape(1));
    std::int64_t down = array.stride(0), beside = array.stride(1);
    // The strides of a single row or column are arbitrary in NumPy.
    if (rows <= 1) down = std::max<std::int64_t>(columns, 1);
    if (columns <= 1) beside = down == 1 ? std::max<std::int64_t>(rows, 1) : 1;
    const bool by_rows = beside == 1 && down >= columns, by_columns = down == 1 && beside >= rows;
    if (rows * columns != 0 && !by_rows && !by_columns) throw std::invalid_argument(message);
    return {array.data(), array.shape(0), array.shape(1), static_cast<std::size_t>(down),
            static_cast<std::size_t>(beside)};
}

/// Returns a new uninitialized array (rows, columns) that Python owns.
template <class T>
OutputMatrix<T> make_matrix(std::size_t rows, std::size_t columns)
{
    if (columns != 0 && rows > PTRDIFF_MAX / sizeof(T) / columns) throw std::bad_alloc();
    auto memory = std::make_unique<dfd::AlignedMemory>(dfd::take_memory(rows * columns * sizeof(T)));
    nb::capsule owner(memory.get(), [](void* taken) noexcept { delete static_cast<dfd::AlignedMemory*>(taken); });
    return OutputMatrix<T>(memory.release()->get(), {rows, columns}, owner);
}
