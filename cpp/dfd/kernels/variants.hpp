#pragma once

#include "dfd/kernels/kernels.hpp"

#define DFD_DECLARE_VARIANT(variant)                                                                     \
    namespace dfd::variant {                                                                             \
    unsigned bind_rows(const BindJob&, std::size_t, std::size_t, float*);                                \
    unsigned bind_halves(const BindJob&, std::size_t, std::size_t, float*);                              \
    unsigned bind_bytes(const BindJob&, std::size_t, std::size_t, float*);                               \
    bool pose_float(const PoseJob<float>&, std::size_t, std::size_t, float*);                            \
    bool pose_double(const PoseJob<double>&, std::size_t, std::size_t, float*);                          \
    void field(const FieldJob&, std::size_t, std::size_t, float*);                                       \
    }

DFD_DECLARE_VARIANT(baseline)
DFD_DECLARE_VARIANT(avx2)
DFD_DECLARE_VARIANT(avx512)
