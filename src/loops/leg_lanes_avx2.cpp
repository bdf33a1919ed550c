// Legs in four lanes; compiled for AVX2 and run only where the processor has it.
#include "loops/leg_lanes.hpp"

#define LANES 4
#define FUNCTIONS kAvx2Functions
#define NAME "4 lanes, AVX2"
#include "loops/leg_lanes_body.hpp"
