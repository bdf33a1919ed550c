// Warnings of bodies that are not rigid bodies; see mechanism_model.hpp.
#include <array>
#include <map>

#include "math/decompositions.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

std::vector<std::string> list_doubtful_inertias(const MechanismModel& model) {
  constexpr double kRounded = 1e-9;  // relative, of moments in a file
  std::map<std::array<double, 3>, std::string> names;
  for (const Body& body : model.bodies) {
    const Vec3<double> moment = find_principal_moments(body.inertia);
    if (can_have_moments(moment, kRounded)) continue;
    std::string& text = names[{moment[0], moment[1], moment[2]}];
    text += (text.empty() ? "" : ", ") + ("'" + body.name + "'");
  }
  std::vector<std::string> found;
  for (const auto& [moment, text] : names) {
    found.push_back("inertia of " + text + ": no rigid body has the principal moments " +
                    describe_number(moment[0], 4) + ", " + describe_number(moment[1], 4) + ", " +
                    describe_number(moment[2], 4) +
                    " kg m2; the largest is at most the sum of the others, unless this idealises "
                    "a rotor or a strut");
  }
  return found;
}

}  // namespace dockloop
