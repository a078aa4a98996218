#include "dfd/kernels/dispatch.hpp"

#include <cstdlib>
#include <stdexcept>

#define DFD_DECLARE_VARIANT(variant)                                                                     \
    namespace dfd::variant {                                                                             \
    unsigned bind_rows(const BindJob&, std::size_t, std::size_t, float*);                                \
    unsigned bind_halves(const BindJob&, std::size_t, std::size_t, float*);                              \
    unsigned bind_bytes(const BindJob&, std::size_t, std::size_t, float*);                               \
    bool pose_float(const PoseJob<float>&, std::size_t, std::size_t, float*);                            \
    bool pose_double(const PoseJob<double>&, std::size_t, std::size_t, float*);                          \
    void pose_gradients_float(const PoseGradientJob<float>&, std::size_t, std::size_t, float*, double*); \
    void pose_gradients_double(const PoseGradientJob<double>&, std::size_t, std::size_t, float*, double*); \
    void field(const FieldJob&, std::size_t, std::size_t, float*);                                       \
    }
DFD_DECLARE_VARIANT(baseline)
DFD_DECLARE_VARIANT(avx2)
DFD_DECLARE_VARIANT(avx512)

namespace dfd {
namespace {

#define DFD_KERNELS(variant)                                                                              \
    Kernels{#variant, variant::bind_rows, variant::bind_halves, variant::bind_bytes, variant::pose_float, \
            variant::pose_double, variant::pose_gradients_float, variant::pose_gradients_double, variant::field}

std::vector<Kernels> available()
{
    std::vector<Kernels> found{DFD_KERNELS(baseline)};
#ifdef DFD_X86_VARIANTS
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {  // such processors have F16C too
        found.push_back(DFD_KERNELS(avx2));
        if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
            __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq") &&
            __builtin_cpu_supports("avx512vnni"))
            found.push_back(DFD_KERNELS(avx512));
    }
#endif
    return found;
}

const std::vector<Kernels>& all()
{
    static const std::vector<Kernels> variants = available();
    return variants;
}

}  // namespace

std::vector<std::string> instruction_sets()
{
    std::vector<std::string> names;
    for (const Kernels& variant : all()) names.emplace_back(variant.name);
    return names;
}

const Kernels& kernels(std::string_view instruction_set)
{
    std::string names;
    for (const Kernels& variant : all()) {
        if (instruction_set == variant.name) return variant;
        names += (names.empty() ? "" : ", ") + std::string(variant.name);
    }
    throw std::invalid_argument("DFD_ISA must be one of the instruction sets of this machine (" + names + "), got \"" +
                                std::string(instruction_set) + "\"");
}

const Kernels& kernels()
{
    static const Kernels& chosen = [&]() -> const Kernels& {
        const char* wanted = std::getenv("DFD_ISA");
        return wanted == nullptr || *wanted == '\0' ? all().back() : kernels(wanted);
    }();
    return chosen;
}

}  // namespace dfd
