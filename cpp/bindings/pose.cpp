#include "dfd/pose.hpp"

#include "arrays.hpp"
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
using Sides = InputVector<bool>;
using Plane = std::tuple<std::array<double, 3>, double, double>;  // normal, offset, band

template <class T>
OutputMatrix<T> pose(InputMatrix<T> vertices, InputMatrix<float> weights, Transforms transforms, Transform rest,
                     std::optional<Plane> plane, std::optional<Sides> positive, std::optional<OutputMatrix<T>> out,
                     int threads)
{
    std::vector<dfd::Affine> affine(transforms.shape(0));
    if (!affine.empty()) std::memcpy(affine.data(), transforms.data(), affine.size() * sizeof(dfd::Affine));
    dfd::Affine affine_rest;
    std::memcpy(affine_rest.data(), rest.data(), sizeof affine_rest);
    std::optional<dfd::Mirror> mirror;
    if (plane && positive) {
        const auto& [normal, offset, band] = *plane;
        mirror = dfd::Mirror{normal, offset, band, {positive->data(), positive->size()}};
    }
    OutputMatrix<T> posed = out ? *out : make_matrix<T>(vertices.shape(0), 3);
    {
        nb::gil_scoped_release release;
        dfd::pose<T>(matrix(vertices), matrix(weights), affine, affine_rest, mirror, matrix(posed), threads);
    }
    return posed;
}

template <class T>
void define_pose(nb::module_& m)
{
    m.def("pose", &pose<T>, "vertices"_a.noconvert(), "weights"_a.noconvert(), "transforms"_a.noconvert(),
          "default"_a.noconvert(), "plane"_a.none() = nb::none(), "positive"_a.noconvert().none() = nb::none(),
          "out"_a.noconvert().none() = nb::none(), "threads"_a = 1,
          "Vertices (V, 3) moved by weights (V, H) and transforms (H, 3, 4), Eq. 1 and 8.");
}

}  // namespace

void init_pose(nb::module_& m)
{
    define_pose<float>(m);
    define_pose<double>(m);
}
