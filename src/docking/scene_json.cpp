// Reads the scene document that an FMU carries; see scene.hpp.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "docking/hard_dock_json.hpp"
#include "docking/hardware_json.hpp"
#include "docking/scene.hpp"
#include "docking/sequence_json.hpp"
#include "docking/vehicle_force_json.hpp"
#include "docking/vehicle_part_json.hpp"
#include "math/rotation.hpp"
#include "model/element_json.hpp"
#include "model/json_reader.hpp"
#include "model/text_hash.hpp"

namespace dockloop {
namespace {

/// Number of the name in a document.
int read_choice(const JsonReader& item, const ChoiceList& list) {
  const int number = find_choice(list, item.text());
  if (number == 0) item.fail("is '" + item.text() + "'; it must be " + list_names(list));
  return number;
}

constexpr int kMaxNodes = 360;  ///< of a guide ring
constexpr int kMaxMethod = 99;  ///< sim/solver_methods.hpp has the list

Motion read_motion(const JsonReader& vehicle) {
  const std::string motion = vehicle.text("motion", "free");
  if (motion == "free") return Motion::kFree;
  if (motion == "driven") return Motion::kDriven;
  if (motion == "fixed") return Motion::kFixed;
  if (motion == "recorded") return Motion::kRecorded;
  vehicle.at("motion").fail("is '" + motion + "'; it must be free, driven or fixed");
}

VehicleParameters read_vehicle(const JsonReader& item) {
  VehicleParameters p;
  p.mass = item.positive("mass");
  p.inertia = item.at("inertia").vector<6>();
  p.interface_position = item.vector<3>("interface_position", p.interface_position);
  p.interface_attitude = item.quaternion("interface_attitude");
  p.mass_includes_mechanism = item.whole("mass_includes_mechanism", 1, 1, 2);
  p.position = item.vector<3>("position", p.position);
  p.velocity = item.vector<3>("velocity", p.velocity);
  p.attitude = item.quaternion("attitude");
  p.angular_velocity = item.vector<3>("angular_velocity", p.angular_velocity);
  return p;
}

std::optional<Hull> read_hull(const JsonReader& vehicle) {
  if (!vehicle.has("hull")) return std::nullopt;
  const JsonReader item = vehicle.at("hull");
  const Hull hull{item.at("from").vector<3>(), item.at("to").vector<3>(), item.positive("radius")};
  if (hull.from == hull.to) item.at("to").fail("is the same point as 'from'; they must differ");
  return hull;
}

/// @param own  members that one side does not share with the other
GuideRing read_guide_ring(const JsonReader& common, const JsonReader& own) {
  const auto find_owner = [&](const std::string& name) -> const JsonReader& {
    return own.has(name) || own.has(name + "_deg") ? own : common;
  };
  const auto number = [&](const char* name) { return find_owner(name).at(name).number(); };
  const auto angle = [&](const char* name) { return find_owner(name).angle(name); };
  const auto count = [&](const char* name, int most) {
    return find_owner(name).at(name).whole(0, most);
  };
  GuideRing ring;
  ring.core_x = number("core_x");
  ring.core_inner_radius = number("core_inner_radius");
  ring.core_outer_radius = number("core_outer_radius");
  ring.ring_rounding = number("ring_rounding");
  ring.node_count = count("node_count", kMaxNodes);
  ring.node_radius = number("node_radius");
  ring.node_azimuth_offset = angle("node_azimuth_offset");
  ring.petal_count = count("petal_count", kMaxPetals);
  ring.petal_rounding = number("petal_rounding");
  ring.petal_base_x = number("petal_base_x");
  ring.petal_base_radius = number("petal_base_radius");
  ring.petal_base_half_angle = angle("petal_base_half_angle");
  ring.petal_tip_x = number("petal_tip_x");
  ring.petal_tip_distance = number("petal_tip_distance");
  ring.petal_tip_half_width = number("petal_tip_half_width");
  return ring;
}

/// Members of a contact law; a missing `damping` follows from restitution.
void read_contact_law(const JsonReader& item, ContactLaw& law, double& restitution,
                      double& restitution_speed) {
  for (const LawNumber<ContactLaw>& each : kContactNumbers) {
    if (each.member == &ContactLaw::damping) continue;  // may follow from the restitution
    law.*each.member = item.number(each.name, law.*each.member);
  }
  law.friction_model =
      item.whole("friction_model", law.friction_model, 1, static_cast<int>(kFrictionModels.size()));
  restitution = item.number("restitution", restitution);
  restitution_speed = item.number("restitution_speed", restitution_speed);
  if (item.has("damping")) {
    law.damping = item.non_negative("damping", law.damping);
    restitution = find_restitution(law.damping * restitution_speed);
  } else {
    law.damping = find_damping_for_restitution(restitution, restitution_speed);
  }
}

void read_contact(const JsonReader& mechanism, const JsonReader* overrides, Scene& scene) {
  const JsonReader item = mechanism.at("contact");
  const std::string type = item.at("type").text();
  if (type == "absorber") {
    AbsorberLaw law;
    read_numbers(item, kAbsorberNumbers, law);
    law.pulls = item.flag("pulls", false);
    scene.contact = make_absorber_contact(law);
    return;
  }
  if (type != "guide_ring" && type != "surfaces") {
    item.at("type").fail("is '" + type + "'; known types are guide_ring, surfaces, absorber");
  }
  ContactLaw law;
  if (item.has("law")) {
    read_contact_law(item.at("law"), law, scene.restitution, scene.restitution_speed);
  } else if (type == "surfaces") {
    scene.restitution = find_restitution(law.damping * scene.restitution_speed);
  }
  if (overrides) read_contact_law(*overrides, law, scene.restitution, scene.restitution_speed);
  if (type == "surfaces") {
    scene.contact = read_surfaces(item, law, scene.mechanism);
    return;
  }
  const JsonReader passive = item.has("passive") ? item.at("passive") : item;
  scene.contact =
      make_ring_contact(read_guide_ring(item, item), read_guide_ring(item, passive), law);
}

void read_initial(const JsonReader& item, Scene& scene) {
  ContactConditions& c = scene.conditions;
  const std::string at = item.text("at", "start");
  if (at != "start" && at != "first_contact") {
    item.at("at").fail("is '" + at + "'; it must be start or first_contact");
  }
  c.given = at == "first_contact";
  const auto pair = [&](const char* key, Vec3<double>& v) {
    const Eigen::Vector2d yz = item.vector<2>(key, Eigen::Vector2d::Zero());
    v = Vec3<double>(0.0, yz[0], yz[1]);
  };
  c.approach_time = item.non_negative("approach_time", 0.0);
  c.closing_speed = item.number("closing_speed", 0.0);
  pair("lateral", c.lateral);
  pair("tilt", c.tilt);
  c.roll = item.number("roll", 0.0);
  pair("lateral_velocity", c.lateral_velocity);
  c.angular_velocity = item.vector<3>("angular_velocity", c.angular_velocity);
  if (item.has("capture_body")) {
    const JsonReader body = item.at("capture_body");
    CaptureBodyStart& s = scene.capture_body_start;
    s.displacement = body.vector<3>("displacement", s.displacement);
    s.rotation_vector = body.vector<3>("rotation_vector", s.rotation_vector);
    s.velocity = body.vector<3>("velocity", s.velocity);
    s.angular_velocity = body.vector<3>("angular_velocity", s.angular_velocity);
  }
  if (item.has("joints")) {
    const JsonReader joints = item.at("joints");
    for (const auto& member : joints.node().items()) {
      const JsonReader joint = joints.at(member.key());
      JointStart start{member.key(), std::nullopt, joint.number("rate", 0.0)};
      if (joint.has("position")) start.position = joint.at("position").number();
      scene.joint_starts.push_back(start);
    }
  }
}

/// Hard dock, sequence, which names parts of it, and the steps that failures name.
/// @pre mechanism, contact and latches of the scene
void read_sequence_and_hard_dock(const JsonReader& mechanism, Scene& scene) {
  if (scene.has_target && mechanism.has("interface")) {
    scene.hard_dock = read_hard_dock(mechanism.at("interface"));
  }
  scene.sequence =
      read_sequence(mechanism, scene.mechanism, scene.has_target ? &scene.latches : nullptr,
                    scene.contact, scene.hard_dock);
  size_t k = 0;
  for (const JsonReader& item : mechanism.list("failures", kMaxItems)) {
    find_step(item, scene.sequence, scene.mechanism.failures[k++].onset);
  }
}

Disturbance read_disturbance(const JsonReader& item, const Scene& scene) {
  Disturbance disturbance;
  const std::string vehicle = item.at("vehicle").text();
  if (vehicle != "chaser" && vehicle != "target") {
    item.at("vehicle").fail("is '" + vehicle + "'; a disturbance acts on chaser or target");
  }
  disturbance.vehicle = vehicle == "chaser" ? kChaser : kTarget;
  if (disturbance.vehicle == kTarget && !scene.has_target) {
    item.at("vehicle").fail("is 'target', but the scene has none");
  }
  disturbance.onset = read_onset(item);
  find_step(item, scene.sequence, disturbance.onset);
  disturbance.duration = item.positive("duration");
  disturbance.force = item.vector<3>("force", Vec3<double>::Zero());
  disturbance.torque = item.vector<3>("torque", Vec3<double>::Zero());
  return disturbance;
}

/// Which input of this scene has this name? @return the rest of a sentence; empty: it is there
std::string find_input(const std::string& name, const Scene& scene, InputHistory& found) {
  const auto is = [&](InputKind kind, int of, int component, const std::string& known) {
    if (name != known) return false;
    found.kind = kind;
    found.of = of;
    found.component = component;
    return true;
  };
  const auto index = [](int k) { return "[" + std::to_string(k + 1) + "]"; };
  const bool is_driven = scene.motion[kChaser] == Motion::kDriven ||
                         (scene.has_target && scene.motion[kTarget] == Motion::kDriven);
  for (int k = 0; k < 3; ++k) {
    if (is(InputKind::kGravity, 0, k, "gravity" + index(k))) {
      return is_driven ? "is an input of a scene with a driven vehicle, which its host moves" : "";
    }
    for (const auto& [vehicle, i] : {std::pair{"chaser", kChaser}, std::pair{"target", kTarget}}) {
      if (i == kTarget && !scene.has_target) continue;
      const std::string v = vehicle;
      if (!is(InputKind::kForce, i, k, v + ".force_ext" + index(k)) &&
          !is(InputKind::kTorque, i, k, v + ".torque_ext" + index(k))) {
        continue;
      }
      return scene.motion[i] == Motion::kFree ? "" : "acts on a vehicle that is not free";
    }
  }
  if (!scene.sequence.empty() && is(InputKind::kCommand, 0, 0, "command")) return "";
  const MechanismModel& mechanism = scene.mechanism;
  for (int k = 0; k < static_cast<int>(mechanism.legs.size()); ++k) {
    if (is(InputKind::kLegCommand, k, 0, "leg" + index(k) + ".force_command")) return "";
  }
  for (int k = 0; k < static_cast<int>(mechanism.elements.size()); ++k) {
    const std::vector<ForceLaw>& laws = mechanism.elements[static_cast<size_t>(k)].laws;
    if (std::any_of(laws.begin(), laws.end(), is_commanded) &&
        is(InputKind::kElementCommand, k, 0, "element" + index(k) + ".command")) {
      return "";
    }
  }
  return "is no input of this scene";
}

/// Rows that change nothing are left out: each row that is kept ends an inner step.
void add_row(double time, double value, InputHistory& history) {
  const size_t n = history.value.size();
  const auto is_value = [&](size_t back) { return n >= back && history.value[n - back] == value; };
  if (!history.is_linear && is_value(1)) return;
  if (history.is_linear && is_value(1) && is_value(2)) {
    history.time.back() = time;
    return;
  }
  history.time.push_back(time);
  history.value.push_back(value);
}

constexpr size_t kMaxRows = 1000000;

InputHistory read_input(const JsonReader& item, const Scene& scene) {
  InputHistory history;
  history.variable = item.at("variable").text();
  const std::string fault = find_input(history.variable, scene, history);
  if (!fault.empty()) item.at("variable").fail("is '" + history.variable + "'; it " + fault);
  for (const InputHistory& other : scene.inputs) {
    if (other.variable != history.variable) continue;
    item.at("variable").fail("is '" + history.variable + "' again; an input has one table");
  }
  const bool is_command = history.kind == InputKind::kCommand;
  const std::string between = item.text("interpolation", is_command ? "hold" : "linear");
  if (between != "hold" && (between != "linear" || is_command)) {
    item.at("interpolation")
        .fail("is '" + between + "'; it must be hold" +
              (is_command ? ", of a command" : " or linear"));
  }
  history.is_linear = between == "linear";
  const std::vector<JsonReader> times = item.at("time").items(kMaxRows);
  const std::vector<JsonReader> values = item.at("value").items(kMaxRows);
  if (times.empty() || times.size() != values.size()) {
    item.fail("has " + std::to_string(times.size()) + " times and " +
              std::to_string(values.size()) + " values; it must have as many, and at least one");
  }
  double last = times.empty() ? 0.0 : times[0].number();
  for (size_t k = 0; k < times.size(); ++k) {
    const double time = times[k].number();
    if (time < last) times[k].fail("is " + times[k].shown() + "; times must not decrease");
    last = time;
    add_row(time,
            is_command ? values[k].whole(kNoCommand, kCommands.back().number) : values[k].number(),
            history);
  }
  return history;
}

/// The motion of a vehicle.
InputHistory read_record(const JsonReader& item, int vehicle) {
  InputHistory record;
  record.variable = item.at("variable").text();
  record.kind = InputKind::kMotion;
  record.of = vehicle;
  const std::vector<JsonReader> times = item.at("time").items(kMaxRows);
  const std::vector<JsonReader> poses = item.at("pose").items(kMaxRows);
  const std::vector<JsonReader> velocities = item.at("velocity").items(kMaxRows);
  if (times.size() < 2 || poses.size() != times.size() || velocities.size() != times.size()) {
    item.fail("must have as many poses and velocities as times, and two or more");
  }
  for (size_t k = 0; k < times.size(); ++k) {
    const double time = times[k].number();
    if (k > 0 && !(time > record.time.back())) {
      times[k].fail("is " + times[k].shown() + "; times must increase");
    }
    Vec7<double> pose = poses[k].vector<7>(), rate;
    if (std::abs(pose.tail<4>().norm() - 1.0) > 1e-6)
      poses[k].fail("must have a quaternion of length 1");
    if (k > 0 && pose.tail<4>().dot(record.pose.back().tail<4>()) < 0.0) pose.tail<4>() *= -1.0;
    const Vec6<double> velocity = velocities[k].vector<6>();
    rate << velocity.head<3>(), quat_rate<double>(pose.tail<4>(), velocity.tail<3>());
    record.time.push_back(time);
    record.pose.push_back(pose);
    record.pose_rate.push_back(rate);
  }
  return record;
}

/// Records of the motion of vehicles, and what they exclude.
void read_records(const JsonReader& root, Scene& scene) {
  for (const auto& [name, i] : {std::pair{"chaser", kChaser}, std::pair{"target", kTarget}}) {
    if (scene.motion[i] != Motion::kRecorded || !root.has(name)) continue;
    const JsonReader motion = root.at(name).at("motion");
    const std::string why = "is driven by a record: ";
    for (const JsonReader& item : root.list("input", kMaxInputHistories)) {
      if (item.at("variable").text() != std::string(name) + ".motion") continue;
      scene.inputs.push_back(read_record(item, i));
    }
    if (find_records(scene)[i] < 0) motion.fail(why + "no entry of 'input' has the motion");
    const auto acts = [i = i](const Disturbance& d) { return d.vehicle == i; };
    if (std::any_of(scene.disturbances.begin(), scene.disturbances.end(), acts)) {
      motion.fail(why + "a disturbance of this vehicle would have no effect; leave it out");
    }
    if (i == kChaser && scene.contact_thrust != 0.0) {
      motion.fail(why + "contact_thrust would have no effect; leave it out");
    }
    if (scene.conditions.given) {
      motion.fail(why + "conditions at first contact would move it; set initial.at = \"start\"");
    }
    const int other = 1 - i;
    if (scene.motion[other] == Motion::kDriven && (other == kChaser || scene.has_target)) {
      motion.fail(why + "the other vehicle must be free, fixed or have a record, too");
    }
  }
}

Scene read_members(const JsonReader& root, const std::string& source_name) {
  Scene scene;
  scene.name = root.at("name").text();
  scene.title = root.text("title", scene.name);
  const JsonReader chaser = root.at("chaser");
  scene.motion[kChaser] = read_motion(chaser);
  scene.vehicle[kChaser] = read_vehicle(chaser);
  scene.contact_thrust = chaser.number("contact_thrust", 0.0);
  scene.contact_thrust_delay = chaser.non_negative("contact_thrust_delay", 0.0);
  scene.has_target = root.has("target");
  if (scene.has_target) {
    scene.motion[kTarget] = read_motion(root.at("target"));
    scene.vehicle[kTarget] = read_vehicle(root.at("target"));
  }
  for (const auto& [name, i] : {std::pair{"chaser", kChaser}, std::pair{"target", kTarget}}) {
    if (!root.has(name)) continue;
    const JsonReader vehicle = root.at(name);
    scene.parts[i] = read_vehicle_parts(vehicle, name);
    scene.hull[i] = read_hull(vehicle);
    if (scene.motion[i] != Motion::kFixed || scene.parts[i].count_coordinates() == 0) continue;
    vehicle.at("motion").fail(
        std::string("is '") + vehicle.at("motion").text() +
        "', but the vehicle has parts; parts need a free or a driven vehicle");
  }
  if (root.has("base")) {
    const JsonReader base = root.at("base");
    scene.base_in_interface = {quat_to_matrix<double>(base.quaternion("attitude")),
                               base.vector<3>("position", Vec3<double>::Zero())};
  }
  const JsonReader mechanism = root.at("mechanism");
  scene.mechanism = read_mechanism(mechanism.node().dump(), source_name + ": mechanism");
  scene.mechanism_name = scene.mechanism.name;
  if (mechanism.has("limits")) {
    const JsonReader limits = mechanism.at("limits");
    scene.rated = {limits.non_negative("tension", 0.0), limits.non_negative("compression", 0.0),
                   limits.non_negative("shear", 0.0), limits.non_negative("bending", 0.0),
                   limits.non_negative("torsion", 0.0)};
  }
  if (scene.has_target && mechanism.has("contact")) {
    if (root.has("contact")) {
      const JsonReader overrides = root.at("contact");
      read_contact(mechanism, &overrides, scene);
    } else {
      read_contact(mechanism, nullptr, scene);
    }
  }
  if (scene.has_target && mechanism.has("latches"))
    scene.latches = read_latches(mechanism.at("latches"));
  scene.phase_limits = find_phase_limits(scene.contact.bounding_radius);
  if (root.has("phases")) {
    const JsonReader phases = root.at("phases");
    PhaseLimits& limits = scene.phase_limits;
    for (const auto& [key, value] :
         {std::pair<const char*, double*>{"rebound_gap", &limits.rebound_gap},
          {"seated_gap", &limits.seated_gap},
          {"passed_depth", &limits.passed_depth},
          {"aligned_speed", &limits.aligned_speed}}) {
      if (phases.has(key)) *value = phases.positive(key);
    }
  }
  read_sequence_and_hard_dock(mechanism, scene);
  for (const JsonReader& item : root.list("disturbance", kMaxDisturbances)) {
    scene.disturbances.push_back(read_disturbance(item, scene));
  }
  if (root.has("initial")) read_initial(root.at("initial"), scene);
  read_records(root, scene);
  for (const JsonReader& item : root.list("input", kMaxInputHistories)) {
    if (item.has("pose")) {
      const JsonReader variable = item.at("variable");
      const bool is_chaser = variable.text() == "chaser.motion";
      if (scene.motion[is_chaser ? kChaser : kTarget] == Motion::kRecorded) continue;
      variable.fail("is the motion of a vehicle whose 'motion' is not 'recorded'");
    }
    scene.inputs.push_back(read_input(item, scene));
  }
  scene.forces = read_vehicle_forces(root);
  if (root.has("solver")) {
    const JsonReader solver = root.at("solver");
    SolverSettings& s = scene.solver;
    for (const auto& [key, value] : {std::pair<const char*, double*>{"rtol", &s.rtol},
                                     {"atol_position", &s.atol_position},
                                     {"atol_velocity", &s.atol_velocity},
                                     {"atol_energy", &s.atol_energy},
                                     {"step", &s.step}}) {
      if (solver.has(key)) *value = solver.positive(key);
    }
    s.method = solver.whole("method", s.method, 1, kMaxMethod);
    scene.accuracy = solver.number("accuracy", scene.accuracy);
    if (scene.accuracy != kRealTime && !(scene.accuracy >= 0.0 && scene.accuracy <= 1.0)) {
      solver.at("accuracy").fail("must be 0 to 1, or -1 (real time)");
    }
  }
  if (root.has("experiment")) {
    const JsonReader experiment = root.at("experiment");
    Experiment& e = scene.experiment;
    e.start = experiment.number("start", e.start);
    e.stop = experiment.number("stop", e.stop);
    e.step = experiment.has("step") ? experiment.positive("step") : e.step;
    e.tolerance = experiment.has("tolerance") ? experiment.positive("tolerance") : e.tolerance;
    if (!(e.stop > e.start)) experiment.fail("must have stop above start");
  }
  if (root.has("coupling")) {
    const JsonReader mode = root.at("coupling").at("mode");
    scene.coupling_mode = read_choice(mode, kCouplingModes);
  }
  if (root.has("model")) {
    scene.level = read_choice(root.at("model").at("level"), kLevels);
  }
  if (root.has("outputs")) {
    for (const JsonReader& group : root.at("outputs").list("groups", kMaxItems)) {
      scene.groups.push_back(group.text());
    }
  }
  return scene;
}

/// Result of `read`; its errors name the source.
template <class Read>
auto read_named(const std::string& source_name, const Read& read) {
  try {
    return read();
  } catch (const ModelError& error) {
    const std::string text = error.what();
    if (text.rfind(source_name, 0) == 0) throw;
    throw ModelError(source_name + ": " + text);
  }
}

}  // namespace

std::array<int, 2> find_records(const Scene& scene) {
  std::array<int, 2> records{-1, -1};
  for (size_t k = 0; k < scene.inputs.size(); ++k) {
    const InputHistory& history = scene.inputs[k];
    if (history.kind == InputKind::kMotion) records[history.of] = static_cast<int>(k);
  }
  return records;
}

bool Scene::has_group(const std::string& group) const {
  return std::find(groups.begin(), groups.end(), group) != groups.end();
}

Scene read_scene(const std::string& json_text, const std::string& source_name) {
  const nlohmann::json document = parse_json(json_text, source_name);
  const JsonReader root(document, source_name);
  const std::string format = root.text("format", "");
  if (format != "dockloop-scene/1") {
    root.fail("has format '" + format + "'; this build reads dockloop-scene/1");
  }
  return read_named(source_name, [&] {
    Scene scene = read_members(root, source_name);
    scene.fingerprint = hash_text(json_text);
    return scene;
  });
}

Capture read_capture(const std::string& json_text, const std::string& source_name) {
  const nlohmann::json document = parse_json(json_text, source_name);
  const JsonReader file(document, source_name);
  const JsonReader mechanism = file.has("mechanism") ? file.at("mechanism") : file;
  return read_named(source_name, [&] {
    Scene scene;
    scene.mechanism = read_mechanism(mechanism.node().dump(), source_name);
    if (mechanism.has("contact")) read_contact(mechanism, nullptr, scene);
    if (mechanism.has("latches")) scene.latches = read_latches(mechanism.at("latches"));
    if (mechanism.has("sequence")) read_sequence_and_hard_dock(mechanism, scene);
    return Capture{scene.contact, scene.latches, scene.sequence};
  });
}

}  // namespace dockloop
