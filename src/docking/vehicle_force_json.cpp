// See vehicle_force_json.hpp.
#include "docking/vehicle_force_json.hpp"

#include <algorithm>
#include <string>

namespace dockloop {
namespace {

constexpr size_t kMaxGaps = 1000, kMaxOffsets = 100;
constexpr double kLeastRise = 1e-9;  ///< of gaps and offsets: slopes by less overflow [m]

VehicleForce::Kind read_kind(const JsonReader& item) {
  const std::string type = item.text();
  using Kind = VehicleForce::Kind;
  for (const Kind kind : {Kind::kSpring, Kind::kTether, Kind::kDipoles, Kind::kTable}) {
    if (type == name_of(kind)) return kind;
  }
  item.fail("is '" + type + "'; it must be spring, tether, dipoles or table");
}

/// Numbers of a list. @param rises  each is above the one before
std::vector<double> read_list(const JsonReader& list, size_t most, bool rises) {
  std::vector<double> values;
  for (const JsonReader& item : list.items(most)) {
    values.push_back(item.number());
    const size_t n = values.size();
    if (rises && n > 1 && !(values[n - 1] >= values[n - 2] + kLeastRise)) {
      item.fail("is " + item.shown() + "; it must be above the number before, " +
                describe_number(values[n - 2]) + ", by at least 1e-9 m");
    }
  }
  return values;
}

ForceTable read_force_table(const JsonReader& item) {
  const std::vector<double> gap = read_list(item.at("gap"), kMaxGaps, true);
  if (gap.size() < 2) item.at("gap").fail("must have at least two numbers");
  std::vector<double> offset = {0.0};
  if (item.has("offset")) offset = read_list(item.at("offset"), kMaxOffsets, true);
  if (offset.empty() || offset[0] != 0.0) item.at("offset").fail("must begin with 0");
  std::vector<std::vector<double>> force;
  for (const JsonReader& row : item.at("force").items(kMaxOffsets)) {
    force.push_back(read_list(row, kMaxGaps, false));
    if (force.back().size() != gap.size()) {
      row.fail("has " + std::to_string(force.back().size()) +
               " numbers; it must have one per gap, " + std::to_string(gap.size()));
    }
    if (force.back().back() == 0.0) continue;
    row.fail("ends with " + describe_number(force.back().back()) +
             " N; it must end with 0 N at the largest gap, beyond which there is no force");
  }
  if (force.size() != offset.size()) {
    item.at("force").fail("has " + std::to_string(force.size()) +
                          " rows; it must have one per offset, " + std::to_string(offset.size()));
  }
  return make_force_table(gap, offset, force);
}

/// Reads the members of one kind, and refuses those of others.
class MemberReader {
 public:
  explicit MemberReader(const JsonReader& item) : item_(item) {}
  template <size_t n>
  void numbers(const LawNumber<VehicleForce> (&list)[n], VehicleForce& force) {
    for (const auto& each : list) known_.push_back(each.name);
    read_numbers(item_, list, force);
  }
  void vector(const char* name, Vec3<double>& value, bool is_required = false) {
    known_.push_back(name);
    value = is_required ? item_.at(name).vector<3>() : item_.vector<3>(name, value);
  }
  void know(const char* name) { known_.push_back(name); }
  void refuse_others(const char* type) const {
    for (const auto& member : item_.node().items()) {
      if (std::find(known_.begin(), known_.end(), member.key()) != known_.end()) continue;
      if (!item_.has(member.key())) continue;
      item_.at(member.key()).fail(std::string("is no member of a force of type '") + type + "'");
    }
  }

 private:
  const JsonReader& item_;
  std::vector<std::string> known_{"type"};
};

VehicleForce read_force(const JsonReader& item) {
  VehicleForce force;
  force.kind = read_kind(item.at("type"));
  MemberReader read(item);
  read.vector("chaser_point", force.chaser_point);
  read.vector("target_point", force.target_point);
  switch (force.kind) {
    case VehicleForce::Kind::kTether:
      read.numbers(kTetherNumbers, force);
      read.numbers(kLineNumbers, force);
      break;
    case VehicleForce::Kind::kSpring:
      read.numbers(kLineNumbers, force);
      break;
    case VehicleForce::Kind::kDipoles:
      read.numbers(kDipoleNumbers, force);
      read.vector("chaser_moment", force.chaser_moment, true);
      read.vector("target_moment", force.target_moment, true);
      break;
    case VehicleForce::Kind::kTable:
      read.numbers(kTableNumbers, force);
      for (const char* name : {"gap", "offset", "force"}) read.know(name);
      force.table = read_force_table(item);
      break;
  }
  read.refuse_others(name_of(force.kind));
  return force;
}

}  // namespace

std::vector<VehicleForce> read_vehicle_forces(const JsonReader& scene) {
  std::vector<VehicleForce> forces;
  for (const JsonReader& item : scene.list("force", kMaxVehicleForces)) {
    if (!scene.has("target")) item.fail("acts between two vehicles, but the scene has no target");
    forces.push_back(read_force(item));
  }
  check_vehicle_forces(forces);
  return forces;
}

}  // namespace dockloop
