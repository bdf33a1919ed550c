// See hardware_json.hpp.
#include "docking/hardware_json.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace dockloop {
namespace {

constexpr int kMaxPoints = 360;  ///< of one entry

/// Members of every core.
constexpr const char* kCommonMembers[] = {"name", "kind", "rounding", "group",
                                          "law",  "body", "comment"};

/// Refuses members that do not belong to the kind of a core.
void check_members(const JsonReader& item, std::initializer_list<const char*> of_kind) {
  for (const auto& member : item.node().items()) {
    const auto is_member = [&](const char* known) { return member.key() == known; };
    if (std::any_of(std::begin(kCommonMembers), std::end(kCommonMembers), is_member)) continue;
    if (std::any_of(of_kind.begin(), of_kind.end(), is_member)) continue;
    item.fail("has the member '" + member.key() + "', which a core of kind '" +
              item.at("kind").text() + "' does not have");
  }
}

std::vector<Profile::Node> read_profile(const JsonReader& item) {
  std::vector<Profile::Node> nodes;
  for (const JsonReader& entry : item.list("profile", kMaxItems)) {
    const Eigen::Vector2d node = entry.vector<2>();
    if (node[1] < 0.0) entry.fail("has a radius below 0; a node is (x, r) with r of 0 or more");
    if (!nodes.empty() && nodes.back().x == node[0] && nodes.back().r == node[1]) {
      entry.fail("repeats the node before it");
    }
    nodes.push_back({node[0], node[1]});
  }
  if (nodes.empty()) item.at("profile").fail("is empty; a single node makes a circle");
  return nodes;
}

Core read_revolution(const JsonReader& item, const std::string& name, double rounding) {
  Core core = make_revolution(name, read_profile(item), rounding);
  if (!item.has("axis")) return core;
  const JsonReader axis = item.at("axis");
  core.axis.p = axis.vector<3>("position", core.axis.p);
  if (axis.has("rotation")) core.axis.R = axis.at("rotation").rotation();
  return core;
}

Core read_plate(const JsonReader& item, const std::string& name, double rounding) {
  std::array<Vec3<double>, 4> corner;
  const std::vector<JsonReader> corners = item.list("corners");
  if (corners.size() != 4) item.fail("needs 4 'corners' in turn");
  for (size_t i = 0; i < 4; ++i) corner[i] = corners[i].vector<3>();
  const Plate<double> plate = make_plate<double>(corner);
  constexpr double kFlat = 1e-6;  // [m]
  for (size_t i = 0; i < 4; ++i) {
    if (!(std::abs(plate.normal.dot(corner[i] - plate.centre)) < kFlat)) {
      item.at("corners").fail("do not lie in a plane (to 1e-6 m)");
    }
    if (!(plate.inward[i].dot(corner[(i + 2) % 4] - corner[i]) > 0.0)) {
      item.at("corners").fail("are not the corners of a convex plate in turn");
    }
  }
  Core core = make_plate_core(name, plate, rounding);
  for (const JsonReader& edge : item.list("edges", 4)) {
    core.edges.push_back(edge.whole(1, 4) - 1);
    if (std::count(core.edges.begin(), core.edges.end(), core.edges.back()) > 1) {
      edge.fail("repeats an edge");
    }
  }
  return core;
}

/// `count` points on a circle across x; azimuth from y to z.
std::vector<Core> read_nodes(const JsonReader& item, const std::string& name, double rounding) {
  const int count = item.at("count").whole(1, kMaxPoints);
  const double radius = item.positive("radius"), x = item.number("x", 0.0);
  const bool turned = item.has("azimuth_offset") || item.has("azimuth_offset_deg");
  const double offset = turned ? item.angle("azimuth_offset") : 0.0;
  std::vector<Core> cores;
  for (int i = 0; i < count; ++i) {
    const double azimuth = 2.0 * static_cast<double>(EIGEN_PI) * i / count + offset;
    cores.push_back(make_point("node " + std::to_string(i + 1) + " of " + name,
                               {x, radius * std::cos(azimuth), radius * std::sin(azimuth)},
                               rounding));
  }
  return cores;
}

/// The cores of one entry of a side.
std::vector<Core> read_cores(const JsonReader& item, const std::string& name) {
  const std::string kind = item.at("kind").text();
  const double rounding = item.positive("rounding");
  if (kind == "point") {
    check_members(item, {"position"});
    return {make_point(name, item.vector<3>("position", Vec3<double>::Zero()), rounding)};
  }
  if (kind == "nodes") {
    check_members(item, {"count", "radius", "x", "azimuth_offset", "azimuth_offset_deg"});
    return read_nodes(item, name, rounding);
  }
  if (kind == "segment") {
    check_members(item, {"points"});
    const std::vector<JsonReader> points = item.list("points");
    if (points.size() != 2) item.fail("needs 2 'points', its ends");
    const Vec3<double> from = points[0].vector<3>(), to = points[1].vector<3>();
    if (from == to) item.at("points").fail("are the same; use kind 'point'");
    return {make_segment(name, from, to, rounding)};
  }
  if (kind == "plate") {
    check_members(item, {"corners", "edges"});
    return {read_plate(item, name, rounding)};
  }
  if (kind == "revolution") {
    check_members(item, {"profile", "axis", "piece_groups"});
    return {read_revolution(item, name, rounding)};
  }
  item.at("kind").fail("is '" + kind +
                       "'; known kinds are point, segment, plate, revolution, nodes");
}

/// Index in ContactModel::bodies; a body that is new becomes a contact body of the mechanism.
int read_body(const JsonReader& item, const std::string& side, MechanismModel& mechanism) {
  if (!item.has("body")) return 0;
  const JsonReader name = item.at("body");
  if (side == "passive") name.fail("belongs to active cores only; passive cores move with P");
  const int body = find_body(mechanism, name.text(), name.path());
  if (body == kBase) {
    name.fail("is 'base'; cores move with a body of the mechanism, or with G without this member");
  }
  std::vector<int>& bodies = mechanism.contact_bodies;
  const auto known = std::find(bodies.begin(), bodies.end(), body);
  const int index = static_cast<int>(known - bodies.begin());
  if (known == bodies.end()) bodies.push_back(body);
  return 1 + index;
}

std::vector<NamedCore> read_side(const JsonReader& contact, const char* side,
                                 MechanismModel& mechanism) {
  std::vector<NamedCore> cores;
  std::vector<std::string> names;
  for (const JsonReader& item : contact.list(side, kMaxItems)) {
    const std::string name = item.at("name").text();
    if (std::count(names.begin(), names.end(), name)) {
      item.at("name").fail("'" + name + "' is used twice");
    }
    names.push_back(name);
    NamedCore named;
    named.group = item.text("group", name);
    named.law = item.text("law", "");
    const int body = read_body(item, side, mechanism);
    for (const JsonReader& group : item.list("piece_groups", kMaxItems)) {
      named.piece_groups.push_back(group.text());
    }
    for (const Core& core : read_cores(item, "'" + name + "' of the " + side + " side")) {
      named.core = core;
      named.core.body = body;
      const int pieces = core.profile.piece_count();
      const int groups = static_cast<int>(named.piece_groups.size());
      if (groups > 0 && groups != pieces) {
        item.at("piece_groups")
            .fail("names " + std::to_string(groups) + " groups; the profile has " +
                  std::to_string(pieces) + " pieces");
      }
      cores.push_back(named);
    }
  }
  if (cores.empty()) contact.fail("needs at least one core in '" + std::string(side) + "'");
  return cores;
}

std::vector<GroupPair> read_pairs(const JsonReader& contact) {
  std::vector<GroupPair> pairs;
  for (const JsonReader& item : contact.list("pairs", kMaxItems)) {
    const std::vector<JsonReader> entries = item.items();
    if (entries.size() != 2 && entries.size() != 3) {
      item.fail("must name two groups, and a law as a third entry if it has its own");
    }
    std::string names[3];
    for (size_t i = 0; i < entries.size(); ++i) names[i] = entries[i].text();
    pairs.push_back({names[0], names[1], names[2]});
  }
  return pairs;
}

/// Laws by name: each states what it has of its own.
std::vector<LawVariant> read_laws(const JsonReader& contact) {
  std::vector<LawVariant> laws;
  if (!contact.has("laws")) return laws;
  const JsonReader all = contact.at("laws");
  if (!all.node().is_object()) all.fail("must be a group of laws by name");
  for (const auto& entry : all.node().items()) {
    const JsonReader item = all.at(entry.key());
    LawVariant law{entry.key(), {}};
    for (const LawNumber<ContactLaw>& each : kContactNumbers) {
      if (item.has(each.name)) law.stated.emplace_back(each.member, item.at(each.name).number());
    }
    if (item.has("friction_model")) {
      item.at("friction_model").fail("is one for all pairs; state it in contact.law");
    }
    if (!item.has("damping") && item.has("restitution")) {
      const double speed = item.at("restitution_speed").number();
      law.stated.emplace_back(&ContactLaw::damping,
                              find_damping_for_restitution(item.at("restitution").number(), speed));
    }
    laws.push_back(law);
  }
  return laws;
}

void read_latch_law(const JsonReader& item, LatchLaw& law) {
  for (const LawNumber<LatchLaw>& each : kLatchNumbers) {
    law.*each.member = item.number(each.name, law.*each.member);
  }
  law.releases_on_overload = item.flag("releases_on_overload", law.releases_on_overload);
}

LatchMeasure read_measure(const JsonReader& item, LatchMeasure fallback) {
  if (!item.has("measure")) return fallback;
  const std::string measure = item.at("measure").text();
  if (measure == "active_axis") return LatchMeasure::kActiveAxis;
  if (measure == "passive_plane") return LatchMeasure::kPassivePlane;
  item.at("measure").fail("is '" + measure + "'; known measures are active_axis, passive_plane");
}

/// Single latches; what an entry does not state, the whole group must. @param group  nullptr if
/// there are no members that hold for all
void read_single_latches(const std::vector<JsonReader>& items, const JsonReader* group,
                         const Latch& common, LatchSet& set) {
  for (const JsonReader& item : items) {
    for (const LawNumber<LatchLaw>& each : kLatchNumbers) {
      const std::string name = each.name;
      if (!each.is_required || item.has(name) || (group && group->has(name))) continue;
      item.fail("lacks the member '" + name + "', and no 'latches." + name +
                "' states it for all latches");
    }
    Latch latch = common;
    latch.hook = item.at("hook").vector<3>();
    latch.striker = item.at("striker").vector<3>();
    latch.measure = read_measure(item, common.measure);
    read_latch_law(item, latch.law);
    set.latch.push_back(latch);
  }
}

}  // namespace

ContactModel read_surfaces(const JsonReader& contact, const ContactLaw& law,
                           MechanismModel& mechanism) {
  const std::vector<NamedCore> active = read_side(contact, "active", mechanism);
  return make_surface_contact(active, read_side(contact, "passive", mechanism), read_pairs(contact),
                              law, read_laws(contact));
}

LatchSet read_latches(const JsonReader& item) {
  LatchSet set;
  Latch common;
  if (item.node().is_array()) {
    read_single_latches(item.items(kMaxLatches), nullptr, common, set);
  } else {
    read_latch_law(item, common.law);
    common.measure = read_measure(item, common.measure);
    if (item.has("list")) {
      read_single_latches(item.list("list", kMaxLatches), &item, common, set);
    } else {
      const double radius = item.positive("radius");
      for (const double angle : item.angles("azimuth", kMaxItems)) {
        // Hook and striker face each other when A and P coincide.
        common.hook = Vec3<double>(0.0, radius * std::cos(angle), radius * std::sin(angle));
        common.striker = common.hook;
        set.latch.push_back(common);
      }
      const int listed = set.count();
      if (item.has("count") && item.at("count").number() != listed) {
        item.at("count").fail("is " + item.at("count").shown() + ", but there are " +
                              std::to_string(listed) + " angles; give one for each latch");
      }
      if (set.count() > kMaxLatches) {
        item.at("azimuth").fail("lists " + std::to_string(set.count()) + " latches; the limit is " +
                                std::to_string(kMaxLatches));
      }
    }
    if (item.has("required")) set.required = item.at("required").whole(1, std::max(set.count(), 1));
  }
  check_latches(set);
  return set;
}

}  // namespace dockloop
