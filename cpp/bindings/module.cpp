#include "module.hpp"

#include "arrays.hpp"
#include "dfd/common/parallel.hpp"
#include "dfd/kernels/dispatch.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;

NB_MODULE(_core, m)
{
    m.doc() = "Kernels of dfd. Arguments have exact types and contiguous rows; `dfd.bind` and `dfd.pose` coerce.";
    nb::set_leak_warnings(false);  // a command skips the GC at exit: objects are freed with the process
    dfd::kernels();  // fails here, at import, when DFD_ISA names no instruction set of this machine
    m.def("instruction_set", [] { return dfd::kernels().name; }, "The instruction set whose kernels run.");
    m.def("instruction_sets", &dfd::instruction_sets, "Those that this machine has kernels for, the slowest first.");
    m.def("team_size", &dfd::team_size, "threads"_a, nb::call_guard<nb::gil_scoped_release>(),
          "The size of the OpenMP team that runs a loop on `threads` threads; 0 where none does.");
    m.def("empty_float32", &make_matrix<float>, "rows"_a, "columns"_a,
          "A new array, its contents not yet set.");
    m.def("empty_float64", &make_matrix<double>, "rows"_a, "columns"_a,
          "A new array, its contents not yet set.");
    init_bind(m);
    init_field(m);
    init_geodesics(m);
    init_pose(m);
}
