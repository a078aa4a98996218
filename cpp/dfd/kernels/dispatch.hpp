#pragma once

#include "dfd/kernels/kernels.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace dfd {

/// Returns the names of this machine's instruction sets for which kernels exist, the slowest first.
std::vector<std::string> instruction_sets();

/// Returns the kernels of one of `instruction_sets()`.
/// @throws std::invalid_argument if the machine or the build does not have this instruction set
const Kernels& kernels(std::string_view instruction_set);

/// Returns the kernels in use: those that the environment variable DFD_ISA names, or else the fastest.
/// @throws std::invalid_argument if DFD_ISA names an instruction set that the machine does not have
const Kernels& kernels();

}  // namespace dfd
