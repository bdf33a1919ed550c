// Reads surfaces and latches of a mechanism document.
#pragma once

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"
#include "model/json_reader.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

/// Contact of type `surfaces`. @param mechanism  of the same document; receives its contact bodies
/// @throws ModelError
ContactModel read_surfaces(const JsonReader& contact, const ContactLaw& law,
                           MechanismModel& mechanism);

/// Latches on a circle, or single latches. @throws ModelError
LatchSet read_latches(const JsonReader& latches);

}  // namespace dockloop
