#include "dfd/camera.hpp"

#include "arrays.hpp"
#include "module.hpp"

using namespace nb::literals;

void init_camera(nb::module_& m)
{
    m.def(
        "ray_directions",
        [](InputMatrix<double> frame, double half_width, std::size_t resolution, InputVector<std::int64_t> pixels,
           OutputMatrix<float> out) {
            const dfd::Camera camera{matrix(frame), half_width, resolution};
            const std::span<const std::int64_t> at{pixels.data(), pixels.size()};
            const auto to = matrix(out);
            const nb::gil_scoped_release release;
            dfd::ray_directions(camera, at, to);
        },
        "frame"_a.noconvert(), "half_width"_a, "resolution"_a, "pixels"_a.noconvert(), "out"_a.noconvert(),
        nb::sig("def ray_directions(frame: numpy.typing.NDArray[numpy.float64], half_width: float, resolution: int, "
                "pixels: numpy.typing.NDArray[numpy.int64], out: numpy.typing.NDArray[numpy.float32]) -> None"),
        "Unit directions through the centers of `pixels` (N,), to `out` (N, 3).");
    m.def(
        "may_show",
        [](InputMatrix<double> frame, double half_width, std::size_t resolution, InputMatrix<float> vertices,
           InputMatrix<std::int32_t> faces, OutputMatrix<std::uint8_t> out) {
            const dfd::Camera camera{matrix(frame), half_width, resolution};
            const auto points = matrix(vertices);
            const auto triangles = matrix(faces);
            const auto to = matrix(out);
            const nb::gil_scoped_release release;
            dfd::may_show(camera, points, triangles, to);
        },
        "frame"_a.noconvert(), "half_width"_a, "resolution"_a, "vertices"_a.noconvert(), "faces"_a.noconvert(),
        "out"_a.noconvert(),
        nb::sig("def may_show(frame: numpy.typing.NDArray[numpy.float64], half_width: float, resolution: int, "
                "vertices: numpy.typing.NDArray[numpy.float32], faces: numpy.typing.NDArray[numpy.int32], "
                "out: numpy.typing.NDArray[numpy.uint8]) -> None"),
        "1 in `out` (resolution, resolution) where a pixel may show a triangle, 0 where surely none.");
}
