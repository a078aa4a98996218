#include "dfd/bind.hpp"

#include <cstdlib>
#include <exception>
#include <typeinfo>
#include <vector>

// What a page in a browser calls, on arrays in the module's memory, to which it gets places by `dfd_take`.

namespace dfd::baseline {
unsigned bind_bytes(const BindJob&, std::size_t, std::size_t, float*);
}

extern "C" {

// The page's part: throws an error of JavaScript with this text, in UTF-8.
[[clang::import_module("page"), clang::import_name("refuse"), noreturn]] void page_refuse(const char* text);

/// A place for `bytes` bytes; it stays the page's until `dfd_give`.
[[clang::export_name("dfd_take")]] void* dfd_take(std::size_t bytes) { return std::malloc(bytes); }

[[clang::export_name("dfd_give")]] void dfd_give(void* place) { std::free(place); }

/// `dfd::bind` on compact features of bytes, with one reach and one falloff for all handles; handles and fixed points
/// are vertices.
///
/// @param features   (B, D / 4 + 1, 16, 4) bytes, of `step` each
/// @param handles    (H) vertices
/// @param fixed      (P) vertices
/// @param strengths  (P) how much each of them holds, in [0, 1]
/// @param falloff    its number in `dfd::Falloff`
/// @param weights    (H, V) result: a handle's weights follow one another
[[clang::export_name("dfd_bind")]] void dfd_bind(const std::uint8_t* features, std::size_t vertex_count,
                                                 std::size_t dimension, float step, const std::int32_t* handles,
                                                 std::size_t handle_count, const std::int32_t* fixed,
                                                 const float* strengths, std::size_t fixed_count, float reach,
                                                 std::int32_t falloff, float* weights)
{
    const std::vector<std::int64_t> held(handles, handles + handle_count), still(fixed, fixed + fixed_count);
    const std::vector<dfd::Extent> extents(handle_count, {reach, static_cast<dfd::Falloff>(falloff)});
    dfd::Points points, fixed_points;
    points.vertices = held;
    fixed_points.vertices = still;
    dfd::Constraints constraints;
    constraints.fixed = fixed_points;
    constraints.strengths = {strengths, fixed_count};
    constraints.extents = extents;
    const dfd::StridedMatrix<float> result{weights, vertex_count, handle_count, 1, vertex_count};
    dfd::Kernels kernels{};  // the only one that is needed: all of them are four times the download
    kernels.bind_bytes = dfd::baseline::bind_bytes;
    dfd::bind({dfd::Features::Layout::bytes, features, vertex_count, dimension, step}, points, constraints, result, 1,
              kernels);
}

// Debian's C++ library for WebAssembly is built without exceptions: what the core throws ends the page's call.

void* __cxa_allocate_exception(std::size_t size) noexcept { return std::malloc(size); }

[[noreturn]] void __cxa_throw(void* thrown, std::type_info*, void (*)(void*))
{
    page_refuse(static_cast<std::exception*>(thrown)->what());  // all that the core throws is one, its only base
}
}
