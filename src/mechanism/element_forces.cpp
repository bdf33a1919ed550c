// element_forces_body.hpp, compiled for the scalars of the core.
#include "mechanism/element_forces_body.hpp"
