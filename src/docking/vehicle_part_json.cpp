// See vehicle_part_json.hpp.
#include "docking/vehicle_part_json.hpp"

#include <algorithm>
#include <cmath>

#include "math/decompositions.hpp"
#include "math/rotation.hpp"

namespace dockloop {
namespace {

constexpr size_t kMaxVehicleParts = 16, kMaxModes = 64;  ///< of one vehicle
constexpr double kFullTurn = 2.0 * static_cast<double>(EIGEN_PI);

/// Slides along, or hinges about the three axes of the part.
void add_axes(JointType joint, VehiclePart& part) {
  for (int k = 0; k < 3; ++k) {
    PartCoordinate coordinate;
    coordinate.joint = joint;
    coordinate.axis = Vec3<double>::Unit(k);
    part.coordinates.push_back(coordinate);
  }
}

void read_joint(const JsonReader& item, VehiclePart& part) {
  const std::string joint = item.at("joint").text();
  if (joint == "hinge" || joint == "slide") {
    PartCoordinate coordinate;
    coordinate.joint = joint == "hinge" ? JointType::kRevolute : JointType::kPrismatic;
    coordinate.axis = item.at("axis").unit_vector();
    part.coordinates.push_back(coordinate);
    return;
  }
  if (item.has("axis"))
    item.at("axis").fail("belongs to hinge and slide; joint is '" + joint + "'");
  if (joint == "elastic") add_axes(JointType::kPrismatic, part);
  if (joint == "elastic" || joint == "ball") return add_axes(JointType::kRevolute, part);
  item.at("joint").fail("is '" + joint + "'; it must be hinge, slide, ball or elastic");
}

/// One number per coordinate; a single number of a member `for_all` holds for each.
std::vector<double> read_numbers_of(const JsonReader& item, const char* key, size_t count,
                                    bool for_all) {
  std::vector<double> values(count, 0.0);
  if (!item.has(key)) return values;
  const JsonReader member = item.at(key);
  if (member.node().is_array()) {
    const std::vector<JsonReader> items = member.items(count);
    if (items.size() != count) {
      member.fail("has " + std::to_string(items.size()) + " numbers; the joint has " +
                  std::to_string(count) + " coordinates");
    }
    for (size_t k = 0; k < count; ++k) values[k] = items[k].number();
  } else if (count == 1 || for_all) {
    values.assign(count, member.number());
  } else {
    member.fail("must be a list of " + std::to_string(count) +
                " numbers, one per coordinate of the joint");
  }
  return values;
}

/// The same, none below zero.
std::vector<double> read_sizes_of(const JsonReader& item, const char* key, size_t count,
                                  bool for_all) {
  const std::vector<double> values = read_numbers_of(item, key, count, for_all);
  for (const double value : values) {
    if (value < 0.0) item.at(key).fail("is " + item.at(key).shown() + "; it must be 0 or more");
  }
  return values;
}

/// About the origin of the part.
Mat3<double> find_inertia_at_joint(const VehiclePart& part) {
  return part.inertia + find_point_inertia(part.mass, part.com);
}

void check_inertia(const JsonReader& item, const VehiclePart& part) {
  const Vec3<double> moment = find_principal_moments(part.inertia);
  const double rounding = 1e-9 * part.inertia.norm();
  if (moment[0] < -rounding || moment[2] > moment[0] + moment[1] + rounding) {
    item.at("inertia").fail("has the principal moments " + describe_number(moment[0]) + ", " +
                            describe_number(moment[1]) + " and " + describe_number(moment[2]) +
                            " kg m2; no body has a negative one, or one larger than the sum of "
                            "the others");
  }
  const bool moves_everywhere = part.coordinates.size() == 6;
  const bool is_hinge =
      part.coordinates.size() == 1 && part.coordinates[0].joint == JointType::kRevolute;
  const Mat3<double> I = moves_everywhere ? part.inertia : find_inertia_at_joint(part);
  const Vec3<double>& axis = part.coordinates[0].axis;
  const bool turns =
      is_hinge ? axis.dot(I * axis) > 0.0 : part.coordinates.size() == 1 || is_positive_definite(I);
  if (turns) return;
  item.fail(std::string("has no inertia about ") +
            (is_hinge ? "the axis of its hinge" : "an axis about which it turns") +
            "; give 'inertia', or a 'com' away from that axis");
}

VehiclePart read_part(const JsonReader& item, const std::string& name) {
  VehiclePart part;
  part.name = name;
  part.mass = item.positive("mass");
  part.com = item.vector<3>("com", part.com);
  part.inertia = make_symmetric(item.vector<6>("inertia", Vec6<double>::Zero()));
  part.placement = {quat_to_matrix<double>(item.quaternion("attitude")),
                    item.vector<3>("position", Vec3<double>::Zero())};
  read_joint(item, part);
  check_inertia(item, part);
  for (const auto& [mine, other] :
       {std::pair{"stiffness", "frequency"}, std::pair{"stiffness", "damping_ratio"},
        std::pair{"damping", "frequency"}, std::pair{"damping", "damping_ratio"}}) {
    if (!item.has(mine) || !item.has(other)) continue;
    item.fail(std::string("has '") + mine + "' and '" + other +
              "'; give stiffness and damping, or frequency and damping_ratio");
  }
  const size_t count = part.coordinates.size();
  if (item.has("damping_ratio") && !item.has("frequency")) {
    item.fail("has 'damping_ratio' without 'frequency'; give both, or stiffness and damping");
  }
  const auto stiffness = read_sizes_of(item, "stiffness", count, false),
             damping = read_sizes_of(item, "damping", count, false),
             frequency = read_sizes_of(item, "frequency", count, true),
             ratio = read_sizes_of(item, "damping_ratio", count, true),
             start = read_numbers_of(item, "coordinate", count, false),
             rate = read_numbers_of(item, "rate", count, false);
  const Mat3<double> I = find_inertia_at_joint(part);
  for (size_t k = 0; k < count; ++k) {
    PartCoordinate& coordinate = part.coordinates[k];
    const bool turns = coordinate.joint == JointType::kRevolute;
    const double w = kFullTurn * frequency[k];
    coordinate.inertia = turns ? coordinate.axis.dot(I * coordinate.axis) : part.mass;
    coordinate.stiffness = stiffness[k] + w * w * coordinate.inertia;
    coordinate.damping = damping[k] + 2.0 * ratio[k] * w * coordinate.inertia;
    coordinate.start = start[k];
    coordinate.rate = rate[k];
    if (count == 6 && !(coordinate.stiffness > 0.0)) {
      item.fail("is elastic, but its coordinate " + std::to_string(k + 1) +
                " has no stiffness; give six stiffnesses or frequencies above 0");
    }
  }
  return part;
}

/// Participation of a mode from its effective masses: their square root, whose sign is free.
Vec6<double> read_effective_mass(const JsonReader& item) {
  constexpr double kTyped = 2e-3;  // rounding in a table
  const std::vector<JsonReader> rows = item.items(6);
  if (rows.size() != 6) item.fail("must be a list of 6 rows of 6 numbers");
  Mat6<double> mass;
  for (int i = 0; i < 6; ++i) mass.row(i) = rows[static_cast<size_t>(i)].vector<6>().transpose();
  int largest = 0;
  mass.diagonal().maxCoeff(&largest);
  if (!(mass(largest, largest) > 0.0)) item.fail("has no number above 0 on its diagonal");
  const Vec6<double> participation = mass.col(largest) / std::sqrt(mass(largest, largest));
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      const double expected = participation[i] * participation[j];
      const double scale = std::sqrt(std::max(0.0, mass(i, i)) * std::max(0.0, mass(j, j)));
      if (std::abs(mass(i, j) - expected) <= kTyped * scale) continue;
      rows[static_cast<size_t>(i)].fail(
          "has " + describe_number(mass(i, j)) + " as number " + std::to_string(j + 1) + "; " +
          describe_number(expected) +
          " follows from the others, because the effective masses of one mode are products of its "
          "participation. State two modes of one frequency as two modes");
    }
  }
  return participation;
}

/// Normal modes of a vehicle, found with the vehicle held.
void read_modes(const JsonReader& table, const std::string& name, VehicleParts& parts) {
  const std::vector<JsonReader> frequencies = table.at("frequency").items(kMaxModes);
  const size_t count = frequencies.size();
  const bool has_mass = table.has("effective_mass");
  if (has_mass == table.has("participation")) {
    table.fail(has_mass ? "has 'participation' and 'effective_mass'; give one of them"
                        : "lacks the member 'participation', or 'effective_mass'");
  }
  const std::vector<JsonReader> shares =
      table.at(has_mass ? "effective_mass" : "participation").items(kMaxModes);
  if (shares.size() != count) {
    table.fail("has " + std::to_string(count) + " frequencies, but " +
               std::to_string(shares.size()) + " rows of '" +
               (has_mass ? "effective_mass" : "participation") + "'; give one row per mode");
  }
  const Vec3<double> point = table.vector<3>("point", Vec3<double>::Zero());
  const auto ratio = read_sizes_of(table, "damping_ratio", count, true),
             start = read_numbers_of(table, "coordinate", count, false),
             rate = read_numbers_of(table, "rate", count, false);
  for (size_t k = 0; k < count; ++k) {
    const double frequency = frequencies[k].number();
    if (!(frequency > 0.0))
      frequencies[k].fail("is " + frequencies[k].shown() + "; it must be above 0");
    const Vec6<double> share = has_mass ? read_effective_mass(shares[k]) : shares[k].vector<6>();
    if (share.isZero(0.0)) shares[k].fail("has no number other than 0; leave this mode out");
    VehiclePart mode;
    mode.name = name + ".modes[" + std::to_string(k + 1) + "]";
    PartCoordinate coordinate;
    coordinate.joint = JointType::kMode;
    coordinate.axis = share.head<3>();
    coordinate.axis_of_rotation = share.tail<3>() + point.cross(coordinate.axis);
    const double w = kFullTurn * frequency;
    coordinate.stiffness = w * w;
    coordinate.damping = 2.0 * ratio[k] * w;
    coordinate.start = start[k];
    coordinate.rate = rate[k];
    mode.coordinates.push_back(coordinate);
    parts.hung.push_back(mode);
  }
}

}  // namespace

VehicleParts read_vehicle_parts(const JsonReader& vehicle, const std::string& name) {
  VehicleParts parts;
  for (const JsonReader& item : vehicle.list("part", kMaxVehicleParts)) {
    const std::string number = std::to_string(parts.hung.size() + 1);
    parts.hung.push_back(read_part(item, name + ".part[" + number + "]"));
  }
  if (vehicle.has("modes")) read_modes(vehicle.at("modes"), name, parts);
  if (vehicle.has("adapter")) {
    parts.adapter = read_part(vehicle.at("adapter"), name + ".adapter");
  }
  return parts;
}

}  // namespace dockloop
