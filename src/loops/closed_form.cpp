// closed_form_body.hpp, compiled for the scalars of the core.
#include "loops/closed_form_body.hpp"
