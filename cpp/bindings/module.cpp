#include "module.hpp"

NB_MODULE(_core, m)
{
    m.doc() = "Kernels of dfd. Arguments have exact types and contiguous rows; `dfd.bind` and `dfd.pose` coerce.";
    m.attr("openmp") =
#ifdef _OPENMP
        true;
#else
        false;
#endif
    init_bind(m);
    init_pose(m);
}
