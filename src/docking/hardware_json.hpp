// Reads surfaces and latches of a mechanism document.
#pragma once

#include <utility>

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"
#include "model/json_reader.hpp"

namespace dockloop {

/// Numbers of a contact law that a file may state, by name; `damping` may follow from restitution.
inline constexpr std::pair<const char*, double ContactLaw::*> kLawMembers[] = {
    {"stiffness", &ContactLaw::stiffness},
    {"toe", &ContactLaw::toe},
    {"regularisation", &ContactLaw::regularisation},
    {"friction_coefficient", &ContactLaw::friction_coefficient},
    {"friction_speed", &ContactLaw::friction_speed},
    {"bristle_stiffness", &ContactLaw::bristle_stiffness},
    {"bristle_damping", &ContactLaw::bristle_damping},
    {"bristle_relaxation", &ContactLaw::bristle_relaxation},
    {"bristle_force_floor", &ContactLaw::bristle_force_floor},
};

/// Contact of type `surfaces`. @throws ModelError
ContactModel read_surfaces(const JsonReader& contact, const ContactLaw& law);

/// Latches on a circle, or single latches. @throws ModelError
LatchSet read_latches(const JsonReader& latches);

}  // namespace dockloop
