// loop_position_body.hpp, compiled for the scalars of the core.
#include "loops/loop_position_body.hpp"
