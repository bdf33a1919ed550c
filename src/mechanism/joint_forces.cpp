// joint_forces_body.hpp, compiled for the scalars of the core.
#include "mechanism/joint_forces_body.hpp"
