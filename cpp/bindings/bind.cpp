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

// Points of handles or fixed points, and the arrays that keep them alive.
struct PointArrays {
    std::optional<InputMatrix<float>> rows;
    std::optional<InputVector<float>> offsets;

    dfd::Points points() const
    {
        dfd::Points result;
        if (rows) result.rows = matrix(*rows);
        if (offsets) result.offsets = {offsets->data(), offsets->size()};
        return result;
    }
};

void bind(const dfd::Features& features, const PointArrays& handles, const PointArrays& fixed,
                const std::optional<InputMatrix<float>>& geodesic, const std::optional<InputVector<float>>& locality,
                const StridedOutput<float>& out, int threads)
{
    dfd::Constraints constraints;
    constraints.fixed = fixed.points();
    if (geodesic) constraints.geodesic = matrix(*geodesic);
    if (locality) constraints.locality = {locality->data(), locality->size()};
    const auto weights = strided_matrix<float>(out, "bind: `out` must have contiguous rows or columns");
    nb::gil_scoped_release release;
    dfd::bind(features, handles.points(), constraints, weights, threads, dfd::kernels());
}

}  // namespace

void init_bind(nb::module_& m)
{
    m.def(
        "bind",
        [](InputMatrix<float> features, InputMatrix<float> handles, std::optional<InputMatrix<float>> fixed,
           std::optional<InputMatrix<float>> geodesic, std::optional<InputVector<float>> locality,
           StridedOutput<float> out, int threads) {
            bind(features_of(features), {handles, {}}, {fixed, {}}, geodesic, locality, out, threads);
        },
        "features"_a.noconvert(), "handles"_a.noconvert(), "fixed"_a.noconvert().none(),
        "geodesic"_a.noconvert().none(), "locality"_a.noconvert().none(), "out"_a.noconvert(), "threads"_a,
        nb::sig("def bind(features: numpy.typing.NDArray[numpy.float32], handles: numpy.typing.NDArray[numpy.float32], "
                "fixed: numpy.typing.NDArray[numpy.float32] | None, geodesic: numpy.typing.NDArray[numpy.float32] | None, "
                "locality: numpy.typing.NDArray[numpy.float32] | None, out: numpy.typing.NDArray[numpy.float32], "
                "threads: int) -> None"),
        "Weights (V, H) of features (V, D) for handles (H, D), to `out`; Eq. 4-7.");
    m.def(
        "bind_halves",
        [](Halves features, std::size_t vertex_count, InputMatrix<float> handles, InputVector<float> handle_offsets,
           std::optional<InputMatrix<float>> fixed, std::optional<InputVector<float>> fixed_offsets,
           std::optional<InputMatrix<float>> geodesic, std::optional<InputVector<float>> locality,
           StridedOutput<float> out, int threads) {
            bind(features_of(features, vertex_count), {handles, handle_offsets}, {fixed, fixed_offsets},
                        geodesic, locality, out, threads);
        },
        "features"_a.noconvert(), "vertex_count"_a, "handles"_a.noconvert(), "handle_offsets"_a.noconvert(),
        "fixed"_a.noconvert().none(), "fixed_offsets"_a.noconvert().none(), "geodesic"_a.noconvert().none(),
        "locality"_a.noconvert().none(), "out"_a.noconvert(), "threads"_a,
        nb::sig("def bind_halves(features: numpy.typing.NDArray[numpy.uint16], vertex_count: int, handles: numpy.typing.NDArray[numpy.float32], "
                "handle_offsets: numpy.typing.NDArray[numpy.float32], fixed: numpy.typing.NDArray[numpy.float32] | None, "
                "fixed_offsets: numpy.typing.NDArray[numpy.float32] | None, geodesic: numpy.typing.NDArray[numpy.float32] | None, "
                "locality: numpy.typing.NDArray[numpy.float32] | None, out: numpy.typing.NDArray[numpy.float32], "
                "threads: int) -> None"),
        "`bind` for float16 features in blocks (B, D, 16), given as their bits.");
    m.def(
        "bind_bytes",
        [](Bytes features, std::size_t vertex_count, float scale, InputMatrix<float> handles,
           InputVector<float> handle_offsets, std::optional<InputMatrix<float>> fixed,
           std::optional<InputVector<float>> fixed_offsets, std::optional<InputMatrix<float>> geodesic,
           std::optional<InputVector<float>> locality, StridedOutput<float> out, int threads) {
            bind(features_of(features, vertex_count, scale), {handles, handle_offsets}, {fixed, fixed_offsets},
                        geodesic, locality, out, threads);
        },
        "features"_a.noconvert(), "vertex_count"_a, "scale"_a, "handles"_a.noconvert(), "handle_offsets"_a.noconvert(),
        "fixed"_a.noconvert().none(), "fixed_offsets"_a.noconvert().none(), "geodesic"_a.noconvert().none(),
        "locality"_a.noconvert().none(), "out"_a.noconvert(), "threads"_a,
        nb::sig("def bind_bytes(features: numpy.typing.NDArray[numpy.uint8], vertex_count: int, scale: float, "
                "handles: numpy.typing.NDArray[numpy.float32], "
                "handle_offsets: numpy.typing.NDArray[numpy.float32], fixed: numpy.typing.NDArray[numpy.float32] | None, "
                "fixed_offsets: numpy.typing.NDArray[numpy.float32] | None, geodesic: numpy.typing.NDArray[numpy.float32] | None, "
                "locality: numpy.typing.NDArray[numpy.float32] | None, out: numpy.typing.NDArray[numpy.float32], "
                "threads: int) -> None"),
        "`bind` for uint8 features in blocks (B, D / 4 + 1, 16, 4), the last quad of each being its squared length.");
}
