// Legs, nodes, plates and columns in eight lanes; compiled for AVX-512, run only where the
// processor has it.
#define LANES 8
#define FUNCTIONS kAvx512Functions
#define NAME "8 lanes, AVX-512"
#include "contact/node_lanes_body.hpp"
#include "contact/plate_lanes_body.hpp"
#include "loops/leg_lanes_body.hpp"
#include "math/column_lanes_body.hpp"
