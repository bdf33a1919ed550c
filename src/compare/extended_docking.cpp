// Mechanism, contact, docking and outputs with 32 digits.
#define DOCK_INSTANTIATE_FOR_SCALARS(X) X(Extended)

#include "contact/contact_model_body.hpp"
#include "contact/latches_body.hpp"
#include "docking/docking_model_body.hpp"
#include "docking/hard_dock_body.hpp"
#include "docking/vehicle_force_body.hpp"
#include "mechanism/element_forces_body.hpp"
#include "mechanism/joint_forces_body.hpp"
#include "mechanism/mechanism_dynamics_body.hpp"
#include "sim/outputs_body.hpp"
