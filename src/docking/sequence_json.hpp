// Reads the sequence of a mechanism document.
#pragma once

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"
#include "docking/hard_dock.hpp"
#include "docking/sequence.hpp"
#include "model/json_reader.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

/// The member `sequence` of a mechanism; an empty sequence if there is none.
/// @param latches  of a scene with a target; null: conditions on latches never hold
/// @param contact, hard_dock  of a scene with a target, else empty
/// @throws ModelError naming file, member, value and limit
Sequence read_sequence(const JsonReader& mechanism, const MechanismModel& model,
                       const LatchSet* latches, const ContactModel& contact,
                       const HardDock& hard_dock);

/// Find the step that an onset names, if it does. @param item  with the member `at`
/// @throws ModelError if there is no such step
void find_step(const JsonReader& item, const Sequence& sequence, Onset& onset);

}  // namespace dockloop
