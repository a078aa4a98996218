#pragma once

#include "dfd/matrix.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <cstdlib>
#include <new>

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
    void* data = std::aligned_alloc(alignment, padded);
    if (data == nullptr) throw std::bad_alloc();
#ifdef __linux__
    if (alignment == huge_page) madvise(data, padded, MADV_HUGEPAGE);
#endif
    nb::capsule owner(data, [](void* pointer) noexcept { std::free(pointer); });
    return OutputMatrix<T>(data, {rows, columns}, owner);
}
