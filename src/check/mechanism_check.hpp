// Is a mechanism sound, and what does the method make of given states?
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace dockloop {

/// Degrees of freedom, loop order, closures, gaps and margins at home, range of motion, vibration,
/// seated play.
/// @throws ModelError if the mechanism is not sound.
nlohmann::json check_mechanism_file(const std::string& text, const std::string& source_name);

/// A mechanism with its legs of the short form written out, as a file states them: `bodies`,
/// `loops`, `couplings`, and as `forces` the elements of these legs.
/// @throws ModelError if it cannot be read.
nlohmann::json expand_mechanism(const std::string& text, const std::string& source_name);

/// Evaluate every entry of `states` of a document (its own mechanism if it has one, else `text`):
/// one object per state with v, a, loop_force, base_force, base_moment, reduced_inertia,
/// reduced_rhs, max_condition and the closed coordinates q.
/// @param newton_only use no closed form
nlohmann::json evaluate_states(const std::string& text, const std::string& source_name,
                               const std::string& states_text, const std::string& states_name,
                               bool newton_only);

}  // namespace dockloop
