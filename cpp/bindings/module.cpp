#include "module.hpp"

#include "arrays.hpp"
#include "dfd/common/parallel.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;

NB_MODULE(_core, m)
{
    m.doc() = "Kernels of dfd, which require exact dtypes and array layouts; `dfd.bind` and `dfd.pose` convert arrays.";
    nb::set_leak_warnings(false);  // commands exit without garbage collection; the remaining objects are no leaks
    dfd::kernels();  // throws during the import if this machine lacks the instruction set that DFD_ISA names
    m.def("instruction_set", [] { return dfd::kernels().name; }, "Return the instruction set of the kernels in use.");
    m.def("instruction_sets", &dfd::instruction_sets,
          "Return the instruction sets of the kernels that run on this machine, the slowest first.");
    m.def("team_size", &dfd::team_size, "threads"_a, nb::call_guard<nb::gil_scoped_release>(),
          "Return the number of threads in the OpenMP team for a loop on `threads` threads, or 0 if there is no team.");
    m.def("empty_float32", &make_matrix<float>, "rows"_a, "columns"_a, "Return a new uninitialized array.");
    m.def("empty_float64", &make_matrix<double>, "rows"_a, "columns"_a, "Return a new uninitialized array.");
    init_bind(m);
    init_field(m);
    init_geodesics(m);
    init_pose(m);
    init_pose_gradients(m);
}
