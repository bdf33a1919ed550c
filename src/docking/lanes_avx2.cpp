// Four lanes; compiled for AVX2, run only where the processor has it.
#define LANES 4
#include "docking/lanes_body.hpp"

const dockloop::LaneFunctions dockloop::kAvx2Functions = kFunctions;
