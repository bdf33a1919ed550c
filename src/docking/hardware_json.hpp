// Reads surfaces and latches of a mechanism document.
#pragma once

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"
#include "model/json_reader.hpp"

namespace dockloop {

/// Contact of type `surfaces`. @throws ModelError
ContactModel read_surfaces(const JsonReader& contact, const ContactLaw& law);

/// Latches on a circle, or single latches. @throws ModelError
LatchSet read_latches(const JsonReader& latches);

}  // namespace dockloop
