// Legs in four lanes; compiled for AVX2 and run only where the processor has it.
#include "kernels/leg_lanes.hpp"

#define LANES 4
#define FUNCTIONS kAvx2Functions
#define NAME "4 lanes, AVX2"
#include "kernels/leg_lanes_body.hpp"
