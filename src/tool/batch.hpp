// Many runs of one scene in one process, for sweeps in which no host is in the loop.
//
// A case is one line of JSON:
//
//   {"scene": {"initial": {"closing_speed": 0.05}}, "set": {"friction.coefficient": 0.2}}
//
// `scene`: what differs from the scene document, as a JSON merge patch (RFC 7386): any member, the
// mechanism too. `set`: start values of FMU variables. Its result is one line too:
//
//   {"status": "done", "end_time": 25.0, "outputs": [2, 0.5], "touches": true, "warnings": []}
//
// `status` is done, refused (the start) or failed (a step), the latter two with a `reason`;
// `outputs` are values of the ordered variables at `end_time` [s]; `touches` is that of Placement.
// A case is run as the FMU of its scene would be, to the same bits if one compiler made both,
// whatever runs beside it.
#pragma once

#include <iosfwd>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace dockloop {

struct BatchOrder {
  std::optional<double> stop, step;  ///< [s]; not given: of the scene's experiment
  /// A case ends when its outcome has been decided for this long [s].
  double end_after_outcome = std::numeric_limits<double>::infinity();
  int threads = 1;
  std::vector<std::string> outputs;  ///< names of FMU variables
};

/// Run the cases that `cases` lists. Results appear in the same order, each as soon as it and all
/// before it are there.
/// @param document  the scene; @param source  its file, for messages
/// @throws ModelError if the scene or the order is bad; a bad case has its reason in its line
void run_batch(const std::string& document, const std::string& source, const BatchOrder& order,
               std::istream& cases, std::ostream& results);

}  // namespace dockloop
