#include "dfd/bind.hpp"

#include "arrays.hpp"
#include "dfd/kernels/dispatch.hpp"
#include "module.hpp"
#include "unlocked.hpp"

#include <nanobind/stl/optional.h>

#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

using namespace nb::literals;

namespace {

using Array = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;
using OptionalArray = std::optional<Array>;
template <class T>
using OptionalVector = std::optional<InputVector<T>>;

template <class T>
bool has_dtype(const Array& array, std::size_t rank)
{
    return array.ndim() == rank && array.dtype() == nb::dtype<T>();
}

template <class T>
std::span<const T> span_of(const OptionalVector<T>& vector)
{
    return vector ? span(*vector) : std::span<const T>{};
}

dfd::Features features_of(const Array& array, std::size_t vertex_count, float scale)
{
    using Layout = dfd::Features::Layout;
    if (has_dtype<float>(array, 2)) return {Layout::rows, array.data(), array.shape(0), array.shape(1)};
    const bool halves = has_dtype<std::uint16_t>(array, 3) && array.shape(2) == dfd::block_size;
    const bool bytes = has_dtype<std::uint8_t>(array, 4) && array.shape(2) == dfd::block_size && array.shape(3) == 4;
    if (!halves && !bytes)
        throw nb::type_error("bind: features must be float32 (V, D), uint16 (B, D, 16) or uint8 (B, D / 4 + 1, 16, 4)");
    if (array.shape(0) != (vertex_count + dfd::block_size - 1) / dfd::block_size)
        throw std::invalid_argument("bind: `features` must have one block for every 16 vertices");
    if (halves) return {Layout::halves, array.data(), vertex_count, array.shape(1)};
    if (array.shape(1) < 1) throw std::invalid_argument("bind: uint8 `features` must end with squared lengths");
    return {Layout::bytes, array.data(), vertex_count, 4 * (array.shape(1) - 1), scale};
}

// Handles or fixed points: feature rows (N, D), or vertex indices (N), copied in case another thread changes them.
struct OwnedPoints {
    std::vector<std::int64_t> vertices;
    dfd::Points points;

    OwnedPoints(const OptionalArray& given, const OptionalVector<float>& offsets)
    {
        if (!given) return;
        if (has_dtype<std::int64_t>(*given, 1)) {
            const auto* first = static_cast<const std::int64_t*>(given->data());
            vertices.assign(first, first + given->shape(0));
            points.vertices = vertices;
        } else if (has_dtype<float>(*given, 2)) {
            points.rows = {static_cast<const float*>(given->data()), given->shape(0), given->shape(1)};
        } else {
            throw nb::type_error("bind: points must be int64 vertices (N) or float32 rows (N, D)");
        }
        points.offsets = span_of(offsets);
    }
    OwnedPoints(const OwnedPoints&) = delete;
    OwnedPoints& operator=(const OwnedPoints&) = delete;
};

std::vector<dfd::Extent> extents_of(const OptionalVector<float>& reaches, const OptionalVector<std::int32_t>& falloffs)
{
    std::vector<dfd::Extent> extents;
    if (!reaches || !falloffs) return extents;
    if (reaches->size() != falloffs->size()) throw std::invalid_argument("bind: `reach` and `falloff` must be (H)");
    for (std::size_t k = 0; k < reaches->size(); ++k) {
        const std::int32_t falloff = falloffs->data()[k];
        if (falloff < 0 || falloff > static_cast<std::int32_t>(dfd::Falloff::constant))
            throw std::invalid_argument("bind: `falloff` must lie in 0 … 5, got " + std::to_string(falloff));
        extents.push_back({reaches->data()[k], static_cast<dfd::Falloff>(falloff)});
    }
    return extents;
}

void bind(const Array& features, std::size_t vertex_count, float scale, const Array& handles,
          const OptionalVector<float>& handle_offsets, const OptionalVector<std::uint32_t>& members,
          const OptionalVector<float>& reaches, const OptionalVector<std::int32_t>& falloffs, const OptionalArray& fixed,
          const OptionalVector<float>& fixed_offsets, const OptionalVector<float>& strengths,
          const std::optional<InputMatrix<float>>& geodesic, const OptionalVector<float>& locality,
          const StridedOutput<float>& out, int threads)
{
    const dfd::Features source = features_of(features, vertex_count, scale);
    OwnedPoints handle_points(handles, handle_offsets);
    handle_points.points.members = span_of(members);
    const OwnedPoints fixed_points(fixed, fixed_offsets);
    const std::vector<dfd::Extent> extents = extents_of(reaches, falloffs);
    dfd::Constraints constraints{fixed_points.points, {}, span_of(locality), span_of(strengths), extents};
    if (geodesic) constraints.geodesic = matrix(*geodesic);
    const auto weights = strided_matrix<float>(out, "bind: `out` must have contiguous rows or columns");
    unlocked([&](const dfd::Poll& poll) {
        dfd::bind(source, handle_points.points, constraints, weights, threads, dfd::kernels(), poll);
    });
}

}  // namespace

void init_bind(nb::module_& m)
{
    m.def("bind", &bind, "features"_a.noconvert(), "vertex_count"_a, "scale"_a, "handles"_a.noconvert(),
          "handle_offsets"_a.noconvert().none(), "members"_a.noconvert().none(), "reaches"_a.noconvert().none(),
          "falloffs"_a.noconvert().none(), "fixed"_a.noconvert().none(), "fixed_offsets"_a.noconvert().none(),
          "strengths"_a.noconvert().none(), "geodesic"_a.noconvert().none(), "locality"_a.noconvert().none(),
          "out"_a.noconvert(), "threads"_a,
          "Write the weights (V, H) of Eq. 4-7 to `out`. `handles` are N points, as vertex indices (N) or feature rows "
          "(N, D). Handle h consists of `members[h]` consecutive points. `features` are float32 rows (V, D), or "
          "blocks of 16 vertices: float16 bits (B, D, 16), or uint8 (B, D / 4 + 1, 16, 4). A byte b stands for the "
          "feature entry (b - 128) * scale. The last four bytes of a vertex are its squared length as int32.");
}
