#include "dfd/shading.hpp"

#include "arrays.hpp"
#include "module.hpp"

using namespace nb::literals;

void init_shading(nb::module_& m)
{
    m.def(
        "blend",
        [](InputMatrix<float> values, InputMatrix<std::int32_t> rows, InputMatrix<float> weights,
           OutputMatrix<float> out) {
            const auto of = matrix(values);
            const auto corners = matrix(rows);
            const auto shares = matrix(weights);
            const auto to = matrix(out);
            const nb::gil_scoped_release release;
            dfd::blend(of, corners, shares, to);
        },
        "values"_a.noconvert(), "rows"_a.noconvert(), "weights"_a.noconvert(), "out"_a.noconvert(),
        nb::sig("def blend(values: numpy.typing.NDArray[numpy.float32], rows: numpy.typing.NDArray[numpy.int32], "
                "weights: numpy.typing.NDArray[numpy.float32], out: numpy.typing.NDArray[numpy.float32]) -> None"),
        "Three `rows` (N, 3) of `values` (R, K) by their `weights` (N, 3), to `out` (N, K).");
    m.def(
        "facing",
        [](InputMatrix<float> vertices, InputMatrix<float> normals, InputMatrix<std::int32_t> corners,
           InputMatrix<float> barycentric, InputVector<std::int64_t> rays, InputMatrix<float> directions,
           OutputMatrix<float> out) {
            const dfd::RayHits hits{
                matrix(corners), matrix(barycentric), {rays.data(), rays.size()}, matrix(directions)};
            const auto points = matrix(vertices), of = matrix(normals);
            const auto to = matrix(out);
            const nb::gil_scoped_release release;
            dfd::facing(points, of, hits, to);
        },
        "vertices"_a.noconvert(), "normals"_a.noconvert(), "corners"_a.noconvert(), "barycentric"_a.noconvert(),
        "rays"_a.noconvert(), "directions"_a.noconvert(), "out"_a.noconvert(),
        nb::sig("def facing(vertices: numpy.typing.NDArray[numpy.float32], "
                "normals: numpy.typing.NDArray[numpy.float32], corners: numpy.typing.NDArray[numpy.int32], "
                "barycentric: numpy.typing.NDArray[numpy.float32], rays: numpy.typing.NDArray[numpy.int64], "
                "directions: numpy.typing.NDArray[numpy.float32], out: numpy.typing.NDArray[numpy.float32]) -> None"),
        "|n · d| of each hit, to `out` (N, 1): with n the unit blend of its corners' normals.");
    m.def(
        "paint",
        [](InputMatrix<float> colors, InputVector<std::int64_t> pixels, OutputMatrix<std::uint8_t> image) {
            const auto of = matrix(colors);
            const std::span<const std::int64_t> at{pixels.data(), pixels.size()};
            const auto to = matrix(image);
            const nb::gil_scoped_release release;
            dfd::paint(of, at, to);
        },
        "colors"_a.noconvert(), "pixels"_a.noconvert(), "image"_a.noconvert(),
        nb::sig("def paint(colors: numpy.typing.NDArray[numpy.float32], pixels: numpy.typing.NDArray[numpy.int64], "
                "image: numpy.typing.NDArray[numpy.uint8]) -> None"),
        "Colors (N, 4) in [0, 1] as bytes to the `pixels` (N,) of `image` (pixels, 3).");
}
