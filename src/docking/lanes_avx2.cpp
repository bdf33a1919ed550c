// Legs, nodes, plates and columns in four lanes; compiled for AVX2, run only where the processor
// has it.
#define LANES 4
#define FUNCTIONS kAvx2Functions
#define NAME "4 lanes, AVX2"
#include "contact/node_lanes_body.hpp"
#include "contact/plate_lanes_body.hpp"
#include "loops/leg_lanes_body.hpp"
#include "math/column_lanes_body.hpp"
