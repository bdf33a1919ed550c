// loop_equations_body.hpp, compiled for the scalars of the core.
#include "loops/loop_equations_body.hpp"
