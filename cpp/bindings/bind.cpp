#include "dfd/bind.hpp"

#include "arrays.hpp"
#include "module.hpp"

#include <nanobind/stl/optional.h>

#include <optional>

using namespace nb::literals;

namespace {

OutputMatrix<float> bind(InputMatrix<float> features, InputMatrix<float> handles,
                         std::optional<InputMatrix<float>> fixed, std::optional<InputMatrix<float>> geodesic,
                         std::optional<InputVector<float>> locality, std::optional<OutputMatrix<float>> out,
                         int threads)
{
    dfd::Constraints constraints;
    if (fixed) constraints.fixed = matrix(*fixed);
    if (geodesic) constraints.geodesic = matrix(*geodesic);
    if (locality) constraints.locality = {locality->data(), locality->size()};
    OutputMatrix<float> weights = out ? *out : make_matrix<float>(features.shape(0), handles.shape(0));
    {
        nb::gil_scoped_release release;
        dfd::bind(matrix(features), matrix(handles), constraints, matrix(weights), threads);
    }
    return weights;
}

}  // namespace

void init_bind(nb::module_& m)
{
    m.def("bind", &bind, "features"_a.noconvert(), "handles"_a.noconvert(), "fixed"_a.noconvert().none() = nb::none(),
          "geodesic"_a.noconvert().none() = nb::none(), "locality"_a.noconvert().none() = nb::none(),
          "out"_a.noconvert().none() = nb::none(), "threads"_a = 1,
          "Weights (V, H) of features (V, D) for handles (H, D), Eq. 4-7.");
}
