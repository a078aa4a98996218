#pragma once

// Checks of arguments. All of them throw std::invalid_argument.

#include "dfd/common/matrix.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <stdexcept>
#include <string>

namespace dfd {

inline void require(bool condition, const char* message)
{
    if (!condition) throw std::invalid_argument(message);
}

/// Throws "<rule>, got <value> at [<place>]".
[[noreturn]] inline void refuse(const std::string& rule, double value, std::initializer_list<std::size_t> place)
{
    std::string at;
    for (const std::size_t index : place) at += (at.empty() ? "" : ", ") + std::to_string(index);
    throw std::invalid_argument(rule + ", got " + std::to_string(value) + " at [" + at + "]");
}

/// Throws "<operation>: `<name>` must be finite, got <value> at [<row>, <column>]" for the first NaN or infinite value.
template <class T>
void require_finite(Matrix<const T> values, const char* operation, const char* name)
{
    const std::span<const T> all{values.data, values.rows * values.columns};
    const auto found = std::find_if(all.begin(), all.end(), [](T value) { return !std::isfinite(value); });
    if (found == all.end()) return;
    const auto index = static_cast<std::size_t>(found - all.begin());
    refuse(std::string(operation) + ": `" + name + "` must be finite", *found,
           {index / values.columns, index % values.columns});
}

/// Throws unless `rows` is empty, or is a matrix with `columns` columns whose entries are from 0 to `count` - 1.
inline void require_indices(Matrix<const std::int32_t> rows, std::size_t columns, std::size_t count,
                            const char* message)
{
    const auto inside = [count](std::int32_t index) { return index >= 0 && static_cast<std::size_t>(index) < count; };
    require(rows.rows == 0 || rows.columns == columns, message);
    require(std::all_of(rows.data, rows.data + rows.rows * rows.columns, inside), message);
}

}  // namespace dfd
