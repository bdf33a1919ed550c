// Reads force elements of a mechanism document (entries of `forces` with a list of laws), and
// failures of their laws.
#pragma once

#include "model/json_reader.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

/// @throws ModelError naming file, member, value and limit
ForceElement read_element(const JsonReader& item, const MechanismModel& model);

/// Members `time` and `at` of something that begins during a run; the step is not found yet.
Onset read_onset(const JsonReader& item);

/// An entry of `failures`. @pre all elements are read. @throws ModelError
LawFailure read_failure(const JsonReader& item, const MechanismModel& model);

}  // namespace dockloop
