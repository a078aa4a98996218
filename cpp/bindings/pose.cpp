#include "dfd/pose.hpp"

#include "arrays.hpp"
#include "dfd/kernels/dispatch.hpp"
#include "module.hpp"
#include "unlocked.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <cstring>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <vector>

using namespace nb::literals;

namespace {

using Transforms = nb::ndarray<const double, nb::shape<-1, 3, 4>, nb::c_contig, nb::device::cpu>;
using Transform = nb::ndarray<const double, nb::shape<3, 4>, nb::c_contig, nb::device::cpu>;
using Polars = nb::ndarray<const double, nb::shape<-1, 19>, nb::c_contig, nb::device::cpu>;  // rows of `dfd::Polar`
using Plane = std::tuple<std::array<double, 3>, double, double>;  // unit normal, offset, half width of the blend band

/// Returns the rows of an array as a vector of `Row`, or an empty vector if there is no array.
template <class Row, class Array>
std::vector<Row> rows_of(const std::optional<Array>& array)
{
    std::vector<Row> result(array ? array->shape(0) : 0);
    if (!result.empty()) std::memcpy(result.data(), array->data(), result.size() * sizeof(Row));
    return result;
}

template <class T>
void pose(InputMatrix<T> vertices, StridedInput<float> weights, Transforms transforms, std::optional<Polars> polar,
          Transform rest, std::optional<Plane> plane, std::optional<InputVector<bool>> positive,
          std::optional<InputMatrix<double>> mixing, int overlap, int blend, std::optional<InputMatrix<T>> base,
          std::optional<InputMatrix<T>> normals, OutputMatrix<T> out, std::optional<OutputMatrix<T>> out_normals,
          int threads)
{
    const auto affine = rows_of<dfd::Affine>(std::optional(transforms));
    const auto decomposed = rows_of<dfd::Polar>(polar);
    dfd::Motion motion{
        affine, {}, {}, static_cast<dfd::Overlap>(overlap), static_cast<dfd::Blend>(blend), decomposed, {}};
    std::memcpy(motion.rest.data(), rest.data(), sizeof motion.rest);
    if (plane && positive) {
        const auto& [normal, offset, band] = *plane;
        motion.mirror = dfd::Mirror{normal, offset, band, {positive->data(), positive->size()}};
    }
    if (mixing) motion.mixing = {mixing->data(), mixing->size()};
    dfd::PoseArrays<T> arrays;
    arrays.vertices = matrix(vertices);
    arrays.weights = strided_matrix<const float>(weights, "pose: `weights` must have contiguous rows or columns");
    arrays.posed = matrix(out);
    if (base) arrays.base = matrix(*base);
    if (normals) arrays.normals = matrix(*normals);
    if (out_normals) arrays.posed_normals = matrix(*out_normals);
    unlocked([&](const dfd::Poll& poll) { dfd::pose<T>(arrays, motion, threads, dfd::kernels(), poll); });
}

template <class T>
void define_pose(nb::module_& m)
{
    m.def("pose", &pose<T>, "vertices"_a.noconvert(), "weights"_a.noconvert(), "transforms"_a.noconvert(),
          "polar"_a.noconvert().none(), "default"_a.noconvert(), "plane"_a.none(), "positive"_a.noconvert().none(),
          "mixing"_a.noconvert().none(), "overlap"_a, "blend"_a, "base"_a.noconvert().none(),
          "normals"_a.noconvert().none(), "out"_a.noconvert(), "out_normals"_a.noconvert().none(), "threads"_a,
          "Move `vertices` (V, 3) by `transforms` (H, 3, 4) as in Eq. 1 and 8, and write the result to `out` (V, 3). "
          "If `mixing` (H, H) is given, `weights` · `mixing` replaces `weights` (V, H).");
}

}  // namespace

void init_pose(nb::module_& m)
{
    define_pose<float>(m);
    define_pose<double>(m);
}
