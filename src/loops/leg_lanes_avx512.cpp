// Legs in eight lanes; compiled for AVX-512 and run only where the processor has it.
#include "loops/leg_lanes.hpp"

#define LANES 8
#define FUNCTIONS kAvx512Functions
#define NAME "8 lanes, AVX-512"
#include "loops/leg_lanes_body.hpp"
