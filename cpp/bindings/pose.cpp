#include "dfd/pose.hpp"

#include "arrays.hpp"
#include "dfd/isa.hpp"
#include "module.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <cstring>
#include <optional>
#include <tuple>
#include <vector>

using namespace nb::literals;

namespace {

using Transforms = nb::ndarray<const double, nb::shape<-1, 3, 4>, nb::c_contig, nb::device::cpu>;
using Transform = nb::ndarray<const double, nb::shape<3, 4>, nb::c_contig, nb::device::cpu>;
using Plane = std::tuple<std::array<double, 3>, double, double>;  // normal, offset, band

template <class T>
void pose(InputMatrix<T> vertices, StridedInput<float> weights, Transforms transforms, Transform rest,
          std::optional<Plane> plane, std::optional<InputVector<bool>> positive, std::optional<InputMatrix<T>> base,
          std::optional<InputMatrix<T>> normals, OutputMatrix<T> out, std::optional<OutputMatrix<T>> out_normals,
          int threads)
{
    std::vector<dfd::Affine> affine(transforms.shape(0));
    if (!affine.empty()) std::memcpy(affine.data(), transforms.data(), affine.size() * sizeof(dfd::Affine));
    dfd::Motion motion{affine, {}, {}};
    std::memcpy(motion.rest.data(), rest.data(), sizeof motion.rest);
    if (plane && positive) {
        const auto& [normal, offset, band] = *plane;
        motion.mirror = dfd::Mirror{normal, offset, band, {positive->data(), positive->size()}};
    }
    dfd::PoseArrays<T> arrays;
    arrays.vertices = matrix(vertices);
    arrays.weights = strided_matrix<const float>(weights, "pose: `weights` must have contiguous rows or columns");
    arrays.posed = matrix(out);
    if (base) arrays.base = matrix(*base);
    if (normals) arrays.normals = matrix(*normals);
    if (out_normals) arrays.posed_normals = matrix(*out_normals);
    nb::gil_scoped_release release;
    dfd::pose<T>(arrays, motion, threads, dfd::kernels());
}

template <class T>
void define_pose(nb::module_& m, const char* signature)
{
    m.def("pose", &pose<T>, "vertices"_a.noconvert(), "weights"_a.noconvert(), "transforms"_a.noconvert(),
          "default"_a.noconvert(), "plane"_a.none(), "positive"_a.noconvert().none(), "base"_a.noconvert().none(),
          "normals"_a.noconvert().none(), "out"_a.noconvert(), "out_normals"_a.noconvert().none(), "threads"_a,
          nb::sig(signature),
          "Vertices (V, 3), moved by weights (V, H) and transforms (H, 3, 4), to `out`; Eq. 1 and 8.");
}

#define DFD_POSE_SIGNATURE(type)                                                                                  \
    "def pose(vertices: numpy.typing.NDArray[numpy." type "], weights: numpy.typing.NDArray[numpy.float32], "                               \
    "transforms: numpy.typing.NDArray[numpy.float64], default: numpy.typing.NDArray[numpy.float64], "                                       \
    "plane: tuple[tuple[float, float, float], float, float] | None, positive: numpy.typing.NDArray[numpy.bool_] | None, "      \
    "base: numpy.typing.NDArray[numpy." type "] | None, normals: numpy.typing.NDArray[numpy." type "] | None, out: numpy.typing.NDArray[numpy." type "], " \
    "out_normals: numpy.typing.NDArray[numpy." type "] | None, threads: int) -> None"

}  // namespace

void init_pose(nb::module_& m)
{
    define_pose<float>(m, DFD_POSE_SIGNATURE("float32"));
    define_pose<double>(m, DFD_POSE_SIGNATURE("float64"));
}
