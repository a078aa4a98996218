#include "dfd/bind.hpp"

#include "arrays.hpp"
#include "dfd/isa.hpp"
#include "module.hpp"

#include <nanobind/stl/optional.h>

#include <optional>
#include <stdexcept>

using namespace nb::literals;

namespace {

using Halves = nb::ndarray<const std::uint16_t, nb::shape<-1, -1, 16>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<const std::uint8_t, nb::shape<-1, -1, 16, 4>, nb::c_contig, nb::device::cpu>;

dfd::Features features_of(const InputMatrix<float>& rows)
{
    return {dfd::Features::Layout::rows, rows.data(), rows.shape(0), rows.shape(1)};
}

void require_blocks(std::size_t blocks, std::size_t vertex_count)
{
    if (blocks != (vertex_count + dfd::block_size - 1) / dfd::block_size)
        throw std::invalid_argument("bind: `features` must hold a block for every 16 vertices");
}

dfd::Features features_of(const Halves& blocks, std::size_t vertex_count)
{
    require_blocks(blocks.shape(0), vertex_count);
    return {dfd::Features::Layout::halves, blocks.data(), vertex_count, blocks.shape(1)};
}

dfd::Features features_of(const Bytes& blocks, std::size_t vertex_count, float scale)
{
    require_blocks(blocks.shape(0), vertex_count);
    if (blocks.shape(1) < 1) throw std::invalid_argument("bind: `features` must hold the squared lengths");
    return {dfd::Features::Layout::bytes, blocks.data(), vertex_count, 4 * (blocks.shape(1) - 1), scale};
}

using Array = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;
using OptionalArray = std::optional<Array>;
using Offsets = std::optional<InputVector<float>>;

bool holds(const Array& array, std::size_t dimensions, nb::dlpack::dtype type)
{
    return array.ndim() == dimensions && array.dtype() == type;
}

template <class T>
dfd::Matrix<const T> matrix_of(const Array& array)
{
    return {static_cast<const T*>(array.data()), array.shape(0), array.shape(1)};
}

// Handles or fixed points: int64 vertices (N), or float32 rows (N, D) with what they miss.
dfd::Points points_of(const OptionalArray& points, const Offsets& offsets)
{
    dfd::Points result;
    if (!points) return result;
    if (holds(*points, 1, nb::dtype<std::int64_t>()))
        result.vertices = {static_cast<const std::int64_t*>(points->data()), points->shape(0)};
    else if (holds(*points, 2, nb::dtype<float>())) result.rows = matrix_of<float>(*points);
    else throw nb::type_error("bind: points must be int64 vertices (N) or float32 rows (N, D)");
    if (offsets) result.offsets = {offsets->data(), offsets->size()};
    return result;
}

dfd::Geodesic geodesic_of(const OptionalArray& geodesic)
{
    constexpr nb::dlpack::dtype half{static_cast<std::uint8_t>(nb::dlpack::dtype_code::Float), 16, 1};
    if (!geodesic) return {};
    if (holds(*geodesic, 2, nb::dtype<float>())) return matrix_of<float>(*geodesic);
    if (holds(*geodesic, 2, half)) return matrix_of<std::uint16_t>(*geodesic);
    throw nb::type_error("bind: `geodesic` must be float32 or float16 (H, V)");
}

void bind(const dfd::Features& features, const dfd::Points& handles, const dfd::Points& fixed,
          const OptionalArray& geodesic, const std::optional<InputVector<float>>& locality,
          const StridedOutput<float>& out, int threads)
{
    dfd::Constraints constraints{fixed, geodesic_of(geodesic), {}};
    if (locality) constraints.locality = {locality->data(), locality->size()};
    const auto weights = strided_matrix<float>(out, "bind: `out` must have contiguous rows or columns");
    nb::gil_scoped_release release;
    dfd::bind(features, handles, constraints, weights, threads, dfd::kernels());
}

#define DFD_POINTS_SIGNATURE                                                                                          \
    "handles: numpy.typing.NDArray[numpy.float32] | numpy.typing.NDArray[numpy.int64], "                              \
    "handle_offsets: numpy.typing.NDArray[numpy.float32] | None, "                                                    \
    "fixed: numpy.typing.NDArray[numpy.float32] | numpy.typing.NDArray[numpy.int64] | None, "                         \
    "fixed_offsets: numpy.typing.NDArray[numpy.float32] | None, "                                                     \
    "geodesic: numpy.typing.NDArray[numpy.float32] | numpy.typing.NDArray[numpy.float16] | None, "                    \
    "locality: numpy.typing.NDArray[numpy.float32] | None, out: numpy.typing.NDArray[numpy.float32], threads: int) "  \
    "-> None"

}  // namespace

void init_bind(nb::module_& m)
{
    m.def(
        "bind",
        [](InputMatrix<float> features, Array handles, Offsets handle_offsets, OptionalArray fixed,
           Offsets fixed_offsets, OptionalArray geodesic, std::optional<InputVector<float>> locality,
           StridedOutput<float> out, int threads) {
            bind(features_of(features), points_of(handles, handle_offsets), points_of(fixed, fixed_offsets), geodesic,
                 locality, out, threads);
        },
        "features"_a.noconvert(), "handles"_a.noconvert(), "handle_offsets"_a.noconvert().none(),
        "fixed"_a.noconvert().none(), "fixed_offsets"_a.noconvert().none(), "geodesic"_a.noconvert().none(),
        "locality"_a.noconvert().none(), "out"_a.noconvert(), "threads"_a,
        nb::sig("def bind(features: numpy.typing.NDArray[numpy.float32], " DFD_POINTS_SIGNATURE),
        "Weights (V, H) of features (V, D) for handles, (H) vertices or (H, D) rows, to `out`; Eq. 4-7.");
    m.def(
        "bind_halves",
        [](Halves features, std::size_t vertex_count, Array handles, Offsets handle_offsets, OptionalArray fixed,
           Offsets fixed_offsets, OptionalArray geodesic, std::optional<InputVector<float>> locality,
           StridedOutput<float> out, int threads) {
            bind(features_of(features, vertex_count), points_of(handles, handle_offsets),
                 points_of(fixed, fixed_offsets), geodesic, locality, out, threads);
        },
        "features"_a.noconvert(), "vertex_count"_a, "handles"_a.noconvert(), "handle_offsets"_a.noconvert().none(),
        "fixed"_a.noconvert().none(), "fixed_offsets"_a.noconvert().none(), "geodesic"_a.noconvert().none(),
        "locality"_a.noconvert().none(), "out"_a.noconvert(), "threads"_a,
        nb::sig("def bind_halves(features: numpy.typing.NDArray[numpy.uint16], vertex_count: int, "
                DFD_POINTS_SIGNATURE),
        "`bind` for float16 features in blocks (B, D, 16), given as their bits.");
    m.def(
        "bind_bytes",
        [](Bytes features, std::size_t vertex_count, float scale, Array handles, Offsets handle_offsets,
           OptionalArray fixed, Offsets fixed_offsets, OptionalArray geodesic,
           std::optional<InputVector<float>> locality, StridedOutput<float> out, int threads) {
            bind(features_of(features, vertex_count, scale), points_of(handles, handle_offsets),
                 points_of(fixed, fixed_offsets), geodesic, locality, out, threads);
        },
        "features"_a.noconvert(), "vertex_count"_a, "scale"_a, "handles"_a.noconvert(),
        "handle_offsets"_a.noconvert().none(), "fixed"_a.noconvert().none(), "fixed_offsets"_a.noconvert().none(),
        "geodesic"_a.noconvert().none(), "locality"_a.noconvert().none(), "out"_a.noconvert(), "threads"_a,
        nb::sig("def bind_bytes(features: numpy.typing.NDArray[numpy.uint8], vertex_count: int, scale: float, "
                DFD_POINTS_SIGNATURE),
        "`bind` for uint8 features in blocks (B, D / 4 + 1, 16, 4), the last quad of each being its squared length.");
}
