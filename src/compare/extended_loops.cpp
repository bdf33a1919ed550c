// The recursions and the loops with 32 digits.
#define DOCK_INSTANTIATE_FOR_SCALARS(X) X(Extended)

#include "loops/closed_form_body.hpp"
#include "loops/leg_geometry_body.hpp"
#include "loops/leg_platforms_body.hpp"
#include "loops/loop_equations_body.hpp"
#include "loops/loop_position_body.hpp"
#include "loops/loop_reduction_body.hpp"
#include "tree/tree_body.hpp"
