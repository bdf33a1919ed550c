// Plates in eight lanes; compiled for AVX-512 and run only where the processor has it.
#include "contact/plate_lanes.hpp"

#define LANES 8
#define FUNCTIONS kAvx512Functions
#include "contact/plate_lanes_body.hpp"
