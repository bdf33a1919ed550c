// Plates in four lanes; compiled for AVX2 and run only where the processor has it.
#include "contact/plate_lanes.hpp"

#define LANES 4
#define FUNCTIONS kAvx2Functions
#include "contact/plate_lanes_body.hpp"
