// loop_reduction_body.hpp, compiled for the scalars of the core.
#include "loops/loop_reduction_body.hpp"
