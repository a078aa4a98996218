#pragma once

#include "dfd/common/matrix.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <new>
#include <stdexcept>

#ifdef _WIN32
#include <malloc.h>
#endif
#ifdef __linux__
#include <sys/mman.h>
#endif

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
dfd::Matrix<T> matrix(OutputMatrix<T>& array)
{
    return {array.data(), array.shape(0), array.shape(1)};
}

template <class T>
using StridedInput = nb::ndarray<const T, nb::ndim<2>, nb::device::cpu>;
template <class T>
using StridedOutput = nb::ndarray<nb::numpy, T, nb::ndim<2>, nb::device::cpu>;

/// Weights (V, H) whose rows or columns are contiguous.
template <class T, class Array>
dfd::StridedMatrix<T> strided_matrix(const Array& array, const char* message)
{
    const auto rows = static_cast<std::int64_t>(array.shape(0)), columns = static_cast<std::int64_t>(array.shape(1));
    std::int64_t down = array.stride(0), beside = array.stride(1);
    // The stride of a single row or column says nothing.
    if (rows <= 1) down = std::max<std::int64_t>(columns, 1);
    if (columns <= 1) beside = down == 1 ? std::max<std::int64_t>(rows, 1) : 1;
    const bool by_rows = beside == 1 && down >= columns, by_columns = down == 1 && beside >= rows;
    if (rows * columns != 0 && !by_rows && !by_columns) throw std::invalid_argument(message);
    return {array.data(), array.shape(0), array.shape(1), static_cast<std::size_t>(down),
            static_cast<std::size_t>(beside)};
}

// Microsoft's library has the like of std::aligned_alloc under a name of its own.
inline void* allocate_aligned(std::size_t alignment, std::size_t bytes)
{
#ifdef _WIN32
    return _aligned_malloc(bytes, alignment);
#else
    return std::aligned_alloc(alignment, bytes);
#endif
}

inline void free_aligned(void* pointer)
{
#ifdef _WIN32
    _aligned_free(pointer);
#else
    std::free(pointer);
#endif
}

/// A new array of (rows, columns) that Python owns, its contents not yet set. Large ones ask for huge pages, since the
/// first touch of small ones costs more than a kernel.
template <class T>
OutputMatrix<T> make_matrix(std::size_t rows, std::size_t columns)
{
    constexpr std::size_t huge_page = std::size_t{1} << 21;
    if (columns != 0 && rows > PTRDIFF_MAX / sizeof(T) / columns) throw std::bad_alloc();
    const std::size_t bytes = rows * columns * sizeof(T);
    const std::size_t alignment = bytes >= 2 * huge_page ? huge_page : 64;
    const std::size_t padded = (bytes + alignment) / alignment * alignment;
    void* data = allocate_aligned(alignment, padded);
    if (data == nullptr) throw std::bad_alloc();
#ifdef __linux__
    if (alignment == huge_page) madvise(data, padded, MADV_HUGEPAGE);
#endif
    nb::capsule owner(data, [](void* pointer) noexcept { free_aligned(pointer); });
    return OutputMatrix<T>(data, {rows, columns}, owner);
}
