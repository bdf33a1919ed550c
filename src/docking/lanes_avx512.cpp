// Eight lanes; compiled for AVX-512, run only where the processor has it.
#define LANES 8
#include "docking/lanes_body.hpp"

const dockloop::LaneFunctions dockloop::kAvx512Functions = kFunctions;
