#include "dfd/field.hpp"

#include "arrays.hpp"
#include "dfd/kernels/dispatch.hpp"
#include "module.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <vector>

using namespace nb::literals;

namespace {

using Vectors = std::vector<InputVector<float>>;

void make_field(dfd::Field* self, const std::vector<InputMatrix<float>>& weights, const Vectors& biases,
                const Vectors& gains, const Vectors& shifts, std::size_t octaves, std::array<double, 3> center,
                double scale)
{
    const std::size_t count = weights.size();
    if (count == 0 || biases.size() != count || gains.size() + 1 != count || shifts.size() + 1 != count)
        throw std::invalid_argument(
            "Field: every layer must have a bias, and every layer except the last must have a LayerNorm");
    std::vector<dfd::Layer> layers(count);
    for (std::size_t i = 0; i < count; ++i) {
        layers[i].weight = matrix(weights[i]);
        layers[i].bias = span(biases[i]);
        if (i + 1 == count) continue;
        layers[i].gain = span(gains[i]);
        layers[i].shift = span(shifts[i]);
    }
    new (self) dfd::Field(layers, octaves, center, scale);
}

}  // namespace

void init_field(nb::module_& m)
{
    nb::class_<dfd::Field>(m, "Field", "The network of a feature field, stored in the layout that the kernels read.")
        .def("__init__", &make_field, "weights"_a, "biases"_a, "gains"_a, "shifts"_a, "octaves"_a, "center"_a, "scale"_a)
        .def(
            "evaluate",
            [](const dfd::Field& self, InputMatrix<double> points, OutputMatrix<float> features, int threads) {
                const auto in = matrix(points);
                const auto out = matrix(features);
                nb::gil_scoped_release release;
                self.evaluate(in, out, threads, dfd::kernels());
            },
            "points"_a.noconvert(), "features"_a.noconvert(), "threads"_a,
            "Write the unit-length features of `points` (N, 3) to `features` (N, D).");
}
