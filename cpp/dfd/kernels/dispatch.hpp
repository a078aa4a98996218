#pragma once

#include "dfd/kernels/kernels.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace dfd {

/// Returns the names of the instruction sets of the kernels that run on this machine, the slowest first.
std::vector<std::string> instruction_sets();

/// Returns the kernels of one of `instruction_sets()`.
/// @throws std::invalid_argument if the machine or the build lacks it
const Kernels& kernels(std::string_view instruction_set);

/// Returns the kernels in use: those of the environment variable DFD_ISA, or the fastest without it.
/// @throws std::invalid_argument if DFD_ISA names an instruction set that the machine lacks
const Kernels& kernels();

}  // namespace dfd
