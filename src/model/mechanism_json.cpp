// Reads a mechanism document and expands its legs into bodies, loops and joint forces.
//
// The members `bodies` and `loops` are the tree and the loop table. The member `legs` is shorter: a
// leg type with points, axes and masses. A file may have both. A leg whose bodies are written out
// is only named: the body that slides in it.
#include <algorithm>
#include <cmath>
#include <map>

#include "math/inertia.hpp"
#include "model/element_json.hpp"
#include "model/json_reader.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {
namespace {

constexpr int kMaxVelocities = 600;  ///< degrees of freedom of a tree; its matrices are dense

Pose<double> read_placement(const JsonReader& joint) {
  Pose<double> pose;
  pose.p = joint.vector<3>("position", Vec3<double>::Zero());
  if (joint.has("rotation")) pose.R = joint.at("rotation").rotation();
  return pose;
}

Body read_body(const JsonReader& item, const MechanismModel& model) {
  Body body;
  body.name = item.at("name").text();
  if (body.name == "base") item.at("name").fail("'base' is reserved for the mechanism base");
  for (const Body& other : model.bodies) {
    if (other.name == body.name) item.at("name").fail("'" + body.name + "' is used twice");
  }
  body.parent = find_body(model, item.at("parent").text(),
                          "body '" + body.name + "' (" + item.path() + ".parent)");
  const JsonReader joint = item.at("joint");
  const std::string type = joint.at("type").text();
  if (type == "revolute" || type == "prismatic") {
    body.joint = type == "revolute" ? JointType::kRevolute : JointType::kPrismatic;
    body.axis = joint.at("axis").unit_vector();
  } else if (type != "free") {
    joint.at("type").fail("is '" + type + "'; known types are revolute, prismatic, free");
  }
  body.placement = read_placement(joint);
  if (item.has("mass")) {
    body.mass = item.at("mass").number();
    if (body.mass < 0.0) {
      item.at("mass").fail("of body '" + body.name + "' is " + item.at("mass").shown() +
                           " kg; a mass must be 0 or more");
    }
  }
  body.com = item.vector<3>("com", Vec3<double>::Zero());
  if (item.has("inertia")) body.inertia = item.at("inertia").matrix<3>();
  return body;
}

const std::map<std::string, ClosureKind> kClosures = {
    {"newton", ClosureKind::kNewton}, {"R2P1R3", ClosureKind::kR2P1R3},
    {"R2C2R2", ClosureKind::kR2C2R2}, {"R1R2R3", ClosureKind::kR1R2R3},
    {"P1R2R3", ClosureKind::kP1R2R3}, {"R2R1R3", ClosureKind::kR2R1R3},
    {"R1P1R1", ClosureKind::kR1P1R1}, {"R1R1R1", ClosureKind::kR1R1R1},
    {"P1R1R1", ClosureKind::kP1R1R1}, {"R1R2R3_perp", ClosureKind::kR1R2R3}};

/// An unknown name means automatic choice.
ClosureKind read_closure(const std::string& name) {
  const auto found = kClosures.find(name);
  return found == kClosures.end() ? ClosureKind::kAutomatic : found->second;
}

void check_loop_name(const JsonReader& item, const std::string& name, const MechanismModel& model) {
  for (const Loop& other : model.loops) {
    if (other.name == name) item.at("name").fail("'" + name + "' is used twice");
  }
}

Loop read_loop(const JsonReader& item, const MechanismModel& model) {
  Loop loop;
  loop.name = item.at("name").text();
  check_loop_name(item, loop.name, model);
  const std::string place = "loop '" + loop.name + "' (" + item.path() + ".";
  const auto body = [&](const char* key) {
    return find_body(model, item.at(key).text(), place + key + ")");
  };
  loop.root = body("root");
  loop.first = body("first");
  loop.terminal = body("terminal");
  loop.closing = body("closing");
  if (loop.first == kBase || loop.terminal == kBase) {
    item.fail("(loop '" + loop.name + "'): first and terminal must be moving bodies, not 'base'");
  }
  const JsonReader cut = item.at("cut");
  const std::string type = cut.at("type").text();
  if (type == "R3") {
    loop.cut = CutType::kSpherical;
  } else if (type == "R2") {
    loop.cut = CutType::kUniversal;
    loop.axis_on_terminal = cut.at("axis_on_terminal").unit_vector();
    loop.axis_on_closing = cut.at("axis_on_closing").unit_vector();
  } else if (type == "R1") {
    loop.cut = CutType::kRevolute;
    loop.axis_on_terminal = cut.at("axis_on_terminal").unit_vector();
    loop.axis_on_closing = cut.at("axis_on_closing").unit_vector();
  } else if (type == "R1_planar") {
    loop.cut = CutType::kPlanarRevolute;
    loop.plane_axes_in_root = cut.at("plane_axes_in_root").matrix<2>();
    if (!(loop.plane_axes_in_root * loop.plane_axes_in_root.transpose()).isIdentity(1e-9)) {
      cut.at("plane_axes_in_root").fail("must be two orthonormal rows (to 1e-9)");
    }
  } else {
    cut.at("type").fail("is '" + type + "'; known cuts are R3, R2, R1, R1_planar");
  }
  loop.point_on_terminal = cut.at("point_on_terminal").vector<3>();
  loop.point_on_closing = cut.at("point_on_closing").vector<3>();
  if (item.has("dependent")) {
    for (const JsonReader& name : item.list("dependent", kMaxItems)) {
      const int index = find_body(model, name.text(), place + "dependent)");
      if (index == kBase) name.fail("is 'base', which has no joint");
      loop.dependent.push_back(index);
    }
  } else {
    // All joints from terminal up to first.
    for (int i = loop.terminal;; i = model.bodies[i].parent) {
      loop.dependent.insert(loop.dependent.begin(), i);
      if (i == loop.first) break;
      if (model.bodies[i].parent == kBase) {
        item.fail("(loop '" + loop.name + "'): first is not on the path to terminal");
      }
    }
  }
  loop.closure = read_closure(item.text("closure", "automatic"));
  if (item.has("branch")) loop.branch = item.at("branch").number() < 0.0 ? -1 : 1;
  return loop;
}

/// A coupling without its terms.
Loop make_coupling(const std::string& name, int dependent, const MechanismModel& model) {
  Loop loop;
  loop.cut = CutType::kCoupling;
  loop.name = name;
  loop.dependent = {dependent};
  loop.first = loop.terminal = dependent;
  loop.root = model.bodies[dependent].parent;
  return loop;
}

/// A gear, differential or screw: one joint coordinate is a linear function of others.
Loop read_coupling(const JsonReader& item, const MechanismModel& model) {
  const std::string name = item.at("name").text();
  check_loop_name(item, name, model);
  const auto read_joint = [&](const JsonReader& joint) {
    const int body =
        find_body(model, joint.text(), "coupling '" + name + "' (" + joint.path() + ")");
    if (body == kBase || model.bodies[body].joint == JointType::kFree) {
      joint.fail("(coupling '" + name + "') must name a revolute or prismatic joint");
    }
    return body;
  };
  Loop loop = make_coupling(name, read_joint(item.at("dependent")), model);
  for (const JsonReader& term : item.list("terms", kMaxItems)) {
    const int body = read_joint(term.at("joint"));
    for (const CouplingTerm& other : loop.terms) {
      if (other.body == body) term.at("joint").fail("(coupling '" + loop.name + "') is used twice");
    }
    loop.terms.push_back({body, term.at("ratio").number()});
    if (loop.terms.back().body == loop.first) {
      term.at("joint").fail("(coupling '" + loop.name + "') is the dependent joint itself");
    }
  }
  loop.offset = item.number("offset", 0.0);
  loop.rate = item.number("rate", 0.0);
  if (loop.terms.empty() && !item.has("offset") && !item.has("rate")) {
    item.fail("(coupling '" + loop.name + "') has no effect; give terms, rate or offset");
  }
  return loop;
}

/// A leg member, taken from the leg or from the defaults of all legs.
struct LegReader {
  JsonReader leg;
  const JsonReader* defaults;
  bool has(const std::string& key) const {
    return leg.has(key) || (defaults && defaults->has(key));
  }
  /// The object with this member: leg or defaults; the leg (for its error message) if neither has
  /// it.
  const JsonReader& owner(const std::string& key) const {
    return !leg.has(key) && defaults && defaults->has(key) ? *defaults : leg;
  }
};

Pose<double> find_home_pose(const MechanismModel& model, int body) {
  Pose<double> pose;
  for (; body != kBase; body = model.bodies[body].parent)
    pose = model.bodies[body].placement * pose;
  return pose;
}

Mat3<double> make_axial_inertia(double axial, double transverse) {
  return Vec3<double>(axial, transverse, transverse).asDiagonal();
}

/// The screw of a leg while legs are read: its coupling comes after all loops.
struct LegScrew {
  JsonReader item;
  std::string name;
  int rotor, rod;
  double ratio;  ///< turn of the rotor per travel of the rod [rad/m]
};

/// Universal joint on the root, cylinder, rod sliding in it, spherical joint on the closing body.
/// Leg axes at home: x along the leg, y the first universal axis, z the second.
void add_slide_leg(const LegReader& in, MechanismModel& model, std::vector<LegScrew>& screws) {
  const std::string name = in.leg.at("name").text();
  const std::string place = "leg '" + name + "' (" + in.leg.path() + ")";
  const std::string root_name = in.owner("root").text("root", "base");
  const int root = find_body(model, root_name, place);
  const int closing = find_body(model, in.owner("closing").at("closing").text(), place);
  const Vec3<double> root_point = in.owner("root_point").at("root_point").vector<3>();
  const Vec3<double> closing_point = in.owner("closing_point").at("closing_point").vector<3>();
  const Pose<double> closing_in_root =
      inverse(find_home_pose(model, root)) * find_home_pose(model, closing);
  const Vec3<double> along = closing_in_root.R * closing_point + closing_in_root.p - root_point;
  const double length = along.norm();
  if (length < 1e-6) in.leg.fail("(leg '" + name + "') has no length at home");
  const Vec3<double> x = along / length;
  Vec3<double> y;
  if (in.has("first_axis")) {
    const JsonReader axis = in.owner("first_axis").at("first_axis");
    y = axis.unit_vector();
    if (std::abs(y.dot(x)) > 1e-6) {
      axis.fail("(leg '" + name + "') must be perpendicular to the leg at home; the cosine is " +
                describe_number(y.dot(x)));
    }
    y = (y - y.dot(x) * x).normalized();
  } else {
    const JsonReader& owner = in.owner("reference_axis");
    const Vec3<double> reference = owner.has("reference_axis")
                                       ? owner.at("reference_axis").unit_vector()
                                       : Vec3<double>::UnitX();
    const Vec3<double> across = reference.cross(x);
    if (across.norm() < 1e-6) {
      in.leg.fail("(leg '" + name + "') is parallel to its reference axis; give 'first_axis'");
    }
    y = across.normalized();
  }
  const auto add_body = [&](const char* part, int parent, JointType joint,
                            const Vec3<double>& axis) {
    Body body;
    body.name = name + "_" + part;
    body.parent = parent;
    body.joint = joint;
    body.axis = axis;
    for (const Body& other : model.bodies) {
      if (other.name == body.name) in.leg.fail("needs the body name '" + body.name + "', in use");
    }
    model.bodies.push_back(body);
    return static_cast<int>(model.bodies.size()) - 1;
  };
  const int cross = add_body("cross", root, JointType::kRevolute, Vec3<double>::UnitY());
  Body& cross_body = model.bodies[cross];
  cross_body.placement.R << x, y, x.cross(y);
  cross_body.placement.p = root_point;
  if (in.has("cross")) {
    const JsonReader part = in.owner("cross").at("cross");
    cross_body.mass = part.non_negative("mass", 0.0);
    cross_body.inertia = part.non_negative("inertia", 0.0) * Mat3<double>::Identity();
  }
  const int cylinder = add_body("cyl", cross, JointType::kRevolute, Vec3<double>::UnitZ());
  const int rod = add_body("rod", cylinder, JointType::kPrismatic, Vec3<double>::UnitX());
  const auto read_part = [&](const char* key, Body& body, bool from_tip) {
    if (!in.has(key)) return;
    const JsonReader part = in.owner(key).at(key);
    body.mass = part.non_negative("mass", 0.0);
    const double com = part.number("com", 0.0);
    body.com = Vec3<double>(from_tip ? length - com : com, 0.0, 0.0);
    body.inertia = make_axial_inertia(part.non_negative("inertia_axial", 0.0),
                                      part.non_negative("inertia_transverse", 0.0));
  };
  read_part("cylinder", model.bodies[cylinder], false);
  read_part("rod", model.bodies[rod], true);
  if (in.has("screw")) {
    const JsonReader screw = in.owner("screw").at("screw");
    const std::string carrier = screw.text("carried_by", "cylinder");
    const bool on_rod = carrier == "rod";
    if (!on_rod && carrier != "cylinder") {
      screw.at("carried_by").fail("is '" + carrier + "'; a rotor is carried by cylinder or rod");
    }
    constexpr double kTurn = 2.0 * static_cast<double>(EIGEN_PI);
    const double lead = screw.at("lead").number(), gear = screw.number("gear", 1.0);
    if (lead == 0.0) screw.at("lead").fail("must not be 0");
    if (gear == 0.0) screw.at("gear").fail("must not be 0");
    const int rotor =
        add_body("rotor", on_rod ? rod : cylinder, JointType::kRevolute, Vec3<double>::UnitX());
    Body& body = model.bodies[rotor];
    body.mass = screw.non_negative("mass", 0.0);
    const double com = screw.number("com", 0.0), axial = screw.non_negative("inertia", 0.0);
    body.com = Vec3<double>(on_rod ? length - com : com, 0.0, 0.0);
    body.inertia = make_axial_inertia(axial, screw.non_negative("inertia_transverse", 0.5 * axial));
    screws.push_back({in.leg, name + "_screw", rotor, rod, gear * kTurn / lead});
  }

  Loop loop;
  loop.name = name;
  loop.root = root;
  loop.first = cross;
  loop.terminal = rod;
  loop.closing = closing;
  loop.point_on_terminal = Vec3<double>(length, 0.0, 0.0);
  loop.point_on_closing = closing_point;
  loop.dependent = {cross, cylinder, rod};
  loop.closure = ClosureKind::kR2P1R3;
  model.loops.push_back(loop);

  JointForce force;
  force.body = rod;
  force.stiffness = in.owner("stiffness").non_negative("stiffness", 0.0);
  force.damping = in.owner("damping").non_negative("damping", 0.0);
  force.rest = in.owner("free_length").number("free_length", length) - length;
  force.preload = in.owner("preload").number("preload", 0.0);
  if (in.has("stops")) {
    const JsonReader stops = in.owner("stops").at("stops");
    force.stops.present = true;
    force.stops.lower = stops.positive("min_length") - length;
    force.stops.upper = stops.positive("max_length") - length;
    force.stops.stiffness = stops.positive("stiffness");
    force.stops.damping = stops.non_negative("damping", 0.0);
    force.stops.toe = stops.positive("toe");
    if (!(force.stops.lower < 0.0 && force.stops.upper > 0.0)) {
      stops.fail("(leg '" + name + "'): the home length " + describe_number(length) +
                 " m must lie between min_length and max_length");
    }
  }
  model.legs.push_back({name, rod, length, static_cast<int>(model.forces.size())});
  model.forces.push_back(force);
}

void add_screw(const LegScrew& screw, MechanismModel& model) {
  check_loop_name(screw.item, screw.name, model);
  Loop loop = make_coupling(screw.name, screw.rotor, model);
  loop.terms = {{screw.rod, screw.ratio}};
  model.loops.push_back(loop);
}

/// A leg whose bodies are in the list of bodies.
void add_written_leg(const JsonReader& item, MechanismModel& model) {
  const std::string name = item.at("name").text();
  const JsonReader slide = item.at("slide");
  const int body = find_body(model, slide.text(), slide.path());
  if (body == kBase || model.bodies[body].joint != JointType::kPrismatic) {
    slide.fail("(leg '" + name + "') must name a body with a prismatic joint");
  }
  for (const Leg& other : model.legs) {
    if (other.name == name) item.at("name").fail("'" + name + "' is used twice");
    if (other.slide_body == body) {
      slide.fail("(leg '" + name + "') is the slide of leg '" + other.name + "' already");
    }
  }
  JointForce force;  // of its command alone: laws of such legs are elements
  force.body = body;
  model.legs.push_back(
      {name, body, item.positive("home_length"), static_cast<int>(model.forces.size())});
  model.forces.push_back(force);
}

void read_legs(const JsonReader& root, MechanismModel& model) {
  const bool shared = root.has("leg_defaults");
  const JsonReader defaults = shared ? root.at("leg_defaults") : root;
  std::vector<LegScrew> screws;
  for (const JsonReader& item : root.list("legs", kMaxItems)) {
    if (item.has("slide")) {
      add_written_leg(item, model);
      continue;
    }
    const LegReader leg{item, shared ? &defaults : nullptr};
    const std::string type = leg.owner("type").at("type").text();
    if (type != "R2P1R3") item.fail("has type '" + type + "'; the known leg type is R2P1R3");
    add_slide_leg(leg, model, screws);
  }
  for (const LegScrew& screw : screws) add_screw(screw, model);
}

void read_joint_force(const JsonReader& item, MechanismModel& model) {
  const std::string type = item.at("type").text();
  if (type != "joint_spring_damper") {
    item.at("type").fail(
        "is '" + type +
        "'; the known type is joint_spring_damper (an element with laws has no type)");
  }
  JointForce force;
  force.body = find_body(model, item.at("joint").text(), item.path() + ".joint");
  if (force.body == kBase || model.bodies[force.body].joint == JointType::kFree) {
    item.at("joint").fail("must name a revolute or prismatic joint");
  }
  force.stiffness = item.non_negative("stiffness", 0.0);
  force.damping = item.non_negative("damping", 0.0);
  force.rest = item.number("rest", 0.0);
  force.preload = item.number("preload", 0.0);
  model.forces.push_back(force);
}

}  // namespace

int find_body(const MechanismModel& model, const std::string& body, const std::string& place) {
  if (body == "base") return kBase;
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    if (model.bodies[i].name == body) return static_cast<int>(i);
  }
  throw ModelError("mechanism '" + model.name + "': " + place + " names body '" + body +
                   "', which does not exist before it in the list of bodies");
}

std::string describe_closure(ClosureKind kind) {
  for (const auto& [name, value] : kClosures) {
    if (value == kind) return name;
  }
  return "automatic";
}

double find_coupling_factor(const Loop& loop, int body) {
  if (body == loop.terminal) return 1.0;
  for (const CouplingTerm& term : loop.terms) {
    if (term.body == body) return -term.ratio;
  }
  return 0.0;
}

std::vector<int> find_active_equations(const Loop& loop) {
  std::vector<int> active;
  for (int i = 0; i < equation_count(loop.cut); ++i) {
    if (std::find(loop.redundant.begin(), loop.redundant.end(), i) == loop.redundant.end()) {
      active.push_back(i);
    }
  }
  return active;
}

void number_coordinates(MechanismModel& model) {
  model.nq = model.nv = 0;
  for (Body& body : model.bodies) {
    body.q_index = model.nq;
    body.v_index = model.nv;
    model.nq += body.nq();
    model.nv += body.nv();
  }
  if (model.home_q.empty()) {
    model.home_q.assign(static_cast<size_t>(model.nq), 0.0);
    for (const Body& body : model.bodies) {
      if (body.joint == JointType::kFree) model.home_q[body.q_index + 3] = 1.0;
    }
  }
}

void check_mechanism(const MechanismModel& model) {
  const std::string place = "mechanism '" + model.name + "': ";
  if (model.nv > kMaxVelocities) {
    throw ModelError(place + "its bodies have " + std::to_string(model.nv) +
                     " degrees of freedom; the limit is " + std::to_string(kMaxVelocities));
  }
  for (const Body& body : model.bodies) {
    const double scale = body.inertia.norm();
    if (!(body.inertia - body.inertia.transpose()).isZero(1e-9 * scale)) {
      throw ModelError(place + "inertia of body '" + body.name + "' is not symmetric");
    }
    const Vec3<double> principal = find_principal_moments(body.inertia);
    if (principal[0] < -1e-12 * scale) {
      throw ModelError(place + "inertia of body '" + body.name +
                       "' has the negative principal value " + describe_number(principal[0]) +
                       " kg m2");
    }
  }
  if (static_cast<int>(model.home_q.size()) != model.nq) {
    throw ModelError(place + "home_q has " + std::to_string(model.home_q.size()) +
                     " numbers, but the bodies have " + std::to_string(model.nq) + " coordinates");
  }
  for (const Body& body : model.bodies) {
    if (body.joint != JointType::kFree) continue;
    const double* q = &model.home_q[body.q_index + 3];
    const double norm = Vec4<double>(q[0], q[1], q[2], q[3]).norm();
    if (!(std::abs(norm - 1.0) < 1e-3)) {
      throw ModelError(place + "home_q of the free joint of body '" + body.name +
                       "' must end in a unit quaternion (w, x, y, z); its norm is " +
                       describe_number(norm));
    }
  }
}

MechanismModel read_mechanism(const std::string& json_text, const std::string& source_name) {
  const nlohmann::json document = parse_json(json_text, source_name);
  const JsonReader file(document, source_name);
  const JsonReader root = file.has("mechanism") ? file.at("mechanism") : file;
  MechanismModel model;
  model.name = root.text("name", "unnamed");
  model.gravity = root.vector<3>("gravity", Vec3<double>::Zero());
  try {
    for (const JsonReader& item : root.list("bodies", kMaxItems))
      model.bodies.push_back(read_body(item, model));
    for (const JsonReader& item : root.list("loops", kMaxItems))
      model.loops.push_back(read_loop(item, model));
    read_legs(root, model);
    for (const JsonReader& item : root.list("couplings", kMaxItems)) {
      model.loops.push_back(read_coupling(item, model));
    }
    if (root.has("singularity")) {
      const JsonReader limits = root.at("singularity");
      if (limits.has("error")) model.singularity.error = limits.positive("error");
      if (limits.has("warning")) model.singularity.warning = limits.positive("warning");
      if (!(model.singularity.error < 0.1) ||
          !(model.singularity.warning >= model.singularity.error)) {
        limits.fail("needs error below 0.1 and warning not below error");
      }
    }
    for (const JsonReader& item : root.list("forces", kMaxItems)) {
      if (item.has("type")) {
        read_joint_force(item, model);
      } else {
        model.elements.push_back(read_element(item, model));
      }
    }
    for (const JsonReader& item : root.list("failures", kMaxItems)) {
      model.failures.push_back(read_failure(item, model));
    }
    if (root.has("capture")) {
      const JsonReader capture = root.at("capture");
      model.capture_body = find_body(model, capture.at("body").text(), "capture.body");
      model.capture_in_body = read_placement(capture);
    }
    const JsonReader& home_owner = root.has("home_q") ? root : file;
    if (home_owner.has("home_q")) {
      for (const JsonReader& number : home_owner.list("home_q", kMaxItems))
        model.home_q.push_back(number.number());
      model.home_given = true;
    }
    number_coordinates(model);
    check_mechanism(model);
  } catch (const ModelError& error) {
    const std::string text = error.what();
    if (text.rfind(source_name, 0) == 0) throw;
    throw ModelError(source_name + ": " + text);
  }
  return model;
}

}  // namespace dockloop
