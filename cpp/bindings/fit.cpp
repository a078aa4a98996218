#include "dfd/fit.hpp"

#include "arrays.hpp"
#include "dfd/kernels/dispatch.hpp"
#include "module.hpp"

#include <nanobind/stl/vector.h>

#include <vector>

using namespace nb::literals;

void init_fit(nb::module_& m)
{
    m.def("fit_size", [](const std::vector<std::size_t>& widths) { return dfd::fit_size(widths); }, "widths"_a,
          nb::sig("def fit_size(widths: collections.abc.Sequence[int]) -> int"),
          "Numbers that a network of these widths has: what enters it, and each layer's outputs.");
    m.def(
        "fit",
        [](OutputMatrix<float> state, const std::vector<std::size_t>& widths, InputMatrix<float> inputs,
           InputMatrix<float> targets, InputMatrix<std::int32_t> chosen, InputVector<double> rates,
           InputVector<double> momenta, std::size_t steps_before, OutputMatrix<float> losses, int threads) {
            const auto own = matrix(state);
            const auto in = matrix(inputs), wanted = matrix(targets);
            const auto points = matrix(chosen);
            const auto lost = matrix(losses);
            const dfd::FitSchedule schedule{
                {rates.data(), rates.size()}, {momenta.data(), momenta.size()}, steps_before};
            nb::gil_scoped_release release;
            dfd::fit(own, widths, in, wanted, points, schedule, {lost.data, lost.rows * lost.columns}, threads,
                     dfd::kernels());
        },
        "state"_a.noconvert(), "widths"_a, "inputs"_a.noconvert(), "targets"_a.noconvert(), "chosen"_a.noconvert(),
        "rates"_a.noconvert(), "momenta"_a.noconvert(), "steps_before"_a, "losses"_a.noconvert(), "threads"_a,
        nb::sig("def fit(state: numpy.typing.NDArray[numpy.float32], widths: collections.abc.Sequence[int], "
                "inputs: numpy.typing.NDArray[numpy.float32], targets: numpy.typing.NDArray[numpy.float32], "
                "chosen: numpy.typing.NDArray[numpy.int32], rates: numpy.typing.NDArray[numpy.float64], "
                "momenta: numpy.typing.NDArray[numpy.float64], steps_before: int, "
                "losses: numpy.typing.NDArray[numpy.float32], threads: int) -> None"),
        "Goes on with a fit, in `state` (3, size): values and both moments; the losses (1, steps) go to `losses`.");
}
