// tree_body.hpp, compiled for the scalars of the core.
#include "tree/tree_body.hpp"
