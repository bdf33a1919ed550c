// Reads a mechanism document and expands its legs into bodies, loops and joint forces.
//
// The members `bodies` and `loops` are the tree and the loop table. The member `legs` is shorter: a
// leg type with points, axes and masses. A file may have both. A leg whose bodies are written out
// is only named: the body that slides in it, or its crank.
#include <algorithm>
#include <cmath>
#include <map>

#include "math/decompositions.hpp"
#include "model/element_json.hpp"
#include "model/json_reader.hpp"
#include "model/mechanism_model.hpp"
#include "model/spring_numbers.hpp"

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

/// A screw or gear train of a leg while legs are read: its coupling comes after all loops.
struct LegTrain {
  JsonReader item;
  std::string name;
  int rotor, mover;
  double ratio;  ///< turn of the rotor per coordinate of the mover [rad/m] or [1]
};

/// Where the short form of a leg puts its ends, and how it adds bodies.
struct LegEnds {
  std::string name;
  int root, closing;
  Vec3<double> root_point, closing_point;
  Vec3<double> tip;  ///< the closing point at home, axes of the root

  LegEnds(const LegReader& in, const MechanismModel& model) : name(in.leg.at("name").text()) {
    const std::string place = "leg '" + name + "' (" + in.leg.path() + ")";
    root = find_body(model, in.owner("root").text("root", "base"), place);
    closing = find_body(model, in.owner("closing").at("closing").text(), place);
    root_point = in.owner("root_point").at("root_point").vector<3>();
    closing_point = in.owner("closing_point").at("closing_point").vector<3>();
    const Pose<double> closing_in_root =
        inverse(find_home_pose(model, root)) * find_home_pose(model, closing);
    tip = closing_in_root.R * closing_point + closing_in_root.p;
  }

  int add_body(const LegReader& in, const char* part, int parent, JointType joint,
               const Vec3<double>& axis, MechanismModel& model) const {
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
  }

  void add_loop(const std::vector<int>& bodies, double length, ClosureKind closure,
                MechanismModel& model) const {
    Loop loop;
    loop.name = name;
    loop.root = root;
    loop.first = bodies.front();
    loop.terminal = bodies.back();
    loop.closing = closing;
    loop.point_on_terminal = Vec3<double>(length, 0.0, 0.0);
    loop.point_on_closing = closing_point;
    loop.dependent = bodies;
    loop.closure = closure;
    model.loops.push_back(loop);
  }
};

Vec3<double> read_reference_axis(const LegReader& in) {
  const JsonReader& owner = in.owner("reference_axis");
  return owner.has("reference_axis") ? owner.at("reference_axis").unit_vector()
                                     : Vec3<double>::UnitX();
}

void read_cross(const LegReader& in, Body& body) {
  if (!in.has("cross")) return;
  const JsonReader part = in.owner("cross").at("cross");
  body.mass = part.non_negative("mass", 0.0);
  body.inertia = part.non_negative("inertia", 0.0) * Mat3<double>::Identity();
}

/// A part along x of its axes. @param tip  where the part ends if `com` counts back from there
void read_part(const JsonReader& part, Body& body, const double* tip = nullptr) {
  body.mass = part.non_negative("mass", 0.0);
  const double com = part.number("com", 0.0);
  body.com = Vec3<double>(tip ? *tip - com : com, 0.0, 0.0);
  body.inertia = make_axial_inertia(part.non_negative("inertia_axial", 0.0),
                                    part.non_negative("inertia_transverse", 0.0));
}

/// The leg for users, with its spring, damper and stops.
void add_leg(const LegReader& in, const Leg& leg, MechanismModel& model) {
  LegLaw law;
  law.free_length = leg.home_length;
  bool is_stated = in.has("stops");
  for (const LawNumber<LegLaw>& each : kLegNumbers) {
    if (!in.has(each.name)) continue;
    is_stated = true;
    read_number(in.owner(each.name), each, law);
  }
  if (in.has("stops")) {
    const JsonReader stops = in.owner("stops").at("stops");
    read_numbers(stops, kLegStopNumbers, law.stops.emplace());
    const std::string why = find_fault(leg, *law.stops);
    if (!why.empty()) stops.fail("(leg '" + leg.name + "'): " + why);
  }
  JointForce force;
  force.body = leg.body;
  force.is_stated = is_stated;
  put_leg_law(leg, law, force);
  model.legs.push_back(leg);
  if (is_stated) model.legs.back().law = law;
  model.legs.back().force = static_cast<int>(model.forces.size());
  model.forces.push_back(force);
}

/// Universal joint on the root, cylinder, rod sliding in it, spherical joint on the closing body.
/// Leg axes at home: x along the leg, y the first universal axis, z the second.
void add_slide_leg(const LegReader& in, MechanismModel& model, std::vector<LegTrain>& trains) {
  const LegEnds ends(in, model);
  const std::string& name = ends.name;
  const Vec3<double> along = ends.tip - ends.root_point;
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
    const Vec3<double> across = read_reference_axis(in).cross(x);
    if (across.norm() < 1e-6) {
      in.leg.fail("(leg '" + name + "') is parallel to its reference axis; give 'first_axis'");
    }
    y = across.normalized();
  }
  const auto add_body = [&](const char* part, int parent, JointType joint,
                            const Vec3<double>& axis) {
    return ends.add_body(in, part, parent, joint, axis, model);
  };
  const int cross = add_body("cross", ends.root, JointType::kRevolute, Vec3<double>::UnitY());
  model.bodies[cross].placement.R << x, y, x.cross(y);
  model.bodies[cross].placement.p = ends.root_point;
  read_cross(in, model.bodies[cross]);
  const int cylinder = add_body("cyl", cross, JointType::kRevolute, Vec3<double>::UnitZ());
  const int rod = add_body("rod", cylinder, JointType::kPrismatic, Vec3<double>::UnitX());
  if (in.has("cylinder")) read_part(in.owner("cylinder").at("cylinder"), model.bodies[cylinder]);
  if (in.has("rod")) read_part(in.owner("rod").at("rod"), model.bodies[rod], &length);
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
    // One thread: a rotor on the rod turns the other way relative to the rod.
    const double ratio = (on_rod ? -gear : gear) * kTurn / lead;
    trains.push_back({in.leg, name + "_screw", rotor, rod, ratio});
  }
  ends.add_loop({cross, cylinder, rod}, length, ClosureKind::kR2P1R3, model);
  add_leg(in, {name, rod, length}, model);
}

/// Crank on the root, universal joint at its pin, rod, spherical joint on the closing body. The
/// joints count from home. Crank axes: x along the crank, z its axis. The cross has the same z and
/// the rod in its plane x z; x of the rod points at the closing point.
void add_crank_leg(const LegReader& in, MechanismModel& model, std::vector<LegTrain>& trains) {
  const LegEnds ends(in, model);
  const std::string place = "(leg '" + ends.name + "') ";
  const JsonReader axis = in.owner("axis").at("axis");
  const JsonReader part = in.owner("crank").at("crank");
  const Vec3<double> z = axis.unit_vector();
  const Vec3<double> across = read_reference_axis(in).cross(z);
  if (across.norm() < 1e-6) {
    axis.fail(place +
              "is parallel to the reference axis, from which the crank leans; give another "
              "'reference_axis'");
  }
  const double length = part.positive("length");
  const double lean = part.has("lean") || part.has("lean_deg") ? part.angle("lean") : 0.0;
  const Vec3<double> level = across.normalized(), up = z.cross(level);
  const Vec3<double> x = std::cos(lean) * level + std::sin(lean) * up;
  const Vec3<double> rod_vector = ends.tip - ends.root_point - length * x;
  const double rod_length = rod_vector.norm();
  if (rod_length < 1e-6) {
    in.leg.fail(place + "has a rod without length: its closing point at home is the crank pin");
  }
  const Vec3<double> flat = rod_vector - rod_vector.dot(z) * z;
  if (flat.norm() < 1e-6 * rod_length) {
    in.leg.fail(place +
                "has a rod parallel to the crank axis at home, where the crank cannot move "
                "it; move 'closing_point' or change 'lean_deg'");
  }
  const Vec3<double> rod_x = flat.normalized();
  if (x.cross(rod_x).norm() < 1e-6) {
    in.leg.fail(place +
                "is stretched or folded at home: seen along the crank axis, crank and rod "
                "lie on one line; change 'lean_deg' or a length");
  }

  const auto add_body = [&](const char* name, int parent, const Vec3<double>& about) {
    return ends.add_body(in, name, parent, JointType::kRevolute, about, model);
  };
  const int crank = add_body("crank", ends.root, Vec3<double>::UnitZ());
  Pose<double>& foot = model.bodies[crank].placement;
  foot.R << x, z.cross(x), z;
  foot.p = ends.root_point;
  read_part(part, model.bodies[crank]);
  Mat3<double> cross_axes;
  cross_axes << rod_x, z.cross(rod_x), z;
  cross_axes = foot.R.transpose() * cross_axes;
  const int cross = add_body("cross", crank, Vec3<double>::UnitZ());
  model.bodies[cross].placement.R = cross_axes;
  model.bodies[cross].placement.p = Vec3<double>(length, 0.0, 0.0);
  read_cross(in, model.bodies[cross]);
  const int rod = add_body("rod", cross, Vec3<double>::UnitY());
  const double c = flat.norm() / rod_length, s = rod_vector.dot(z) / rod_length;
  model.bodies[rod].placement.R << c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c;
  if (in.has("rod")) read_part(in.owner("rod").at("rod"), model.bodies[rod], &rod_length);
  if (in.has("gear")) {
    const JsonReader gear = in.owner("gear").at("gear");
    const double ratio = gear.at("ratio").number();
    if (ratio == 0.0) gear.at("ratio").fail("must not be 0");
    const Vec3<double> about = gear.has("axis") ? gear.at("axis").unit_vector() : z;
    const int rotor = add_body("rotor", ends.root, about);
    Body& body = model.bodies[rotor];
    body.placement.p = ends.root_point;
    body.mass = gear.non_negative("mass", 0.0);
    const double axial = gear.non_negative("inertia", 0.0);
    const double transverse = gear.non_negative("inertia_transverse", 0.5 * axial);
    body.inertia =
        transverse * Mat3<double>::Identity() + (axial - transverse) * about * about.transpose();
    trains.push_back({in.leg, ends.name + "_gear", rotor, crank, ratio});
  }
  ends.add_loop({crank, cross, rod}, rod_length, ClosureKind::kR1R2R3, model);
  add_leg(in, {ends.name, crank, 0.0, length}, model);
}

void add_train(const LegTrain& train, MechanismModel& model) {
  check_loop_name(train.item, train.name, model);
  Loop loop = make_coupling(train.name, train.rotor, model);
  loop.terms = {{train.mover, train.ratio}};
  model.loops.push_back(loop);
}

/// A leg whose bodies are in the list of bodies: a slide or a crank.
void add_written_leg(const JsonReader& item, MechanismModel& model) {
  Leg leg;
  leg.name = item.at("name").text();
  const bool is_slide = item.has("slide");
  const JsonReader joint = item.at(is_slide ? "slide" : "crank_joint");
  const std::string place = "(leg '" + leg.name + "') ";
  leg.body = find_body(model, joint.text(), joint.path());
  const JointType type = is_slide ? JointType::kPrismatic : JointType::kRevolute;
  if (leg.body == kBase || model.bodies[leg.body].joint != type) {
    joint.fail(place + "must name a body with a " + (is_slide ? "prismatic" : "revolute") +
               " joint");
  }
  for (const Leg& other : model.legs) {
    if (other.name == leg.name) item.at("name").fail("'" + leg.name + "' is used twice");
    if (other.body == leg.body) {
      joint.fail(place + "is the " + (is_slide ? "slide" : "crank") + " of leg '" + other.name +
                 "' already");
    }
  }
  if (is_slide) {
    leg.home_length = item.positive("home_length");
  } else {
    leg.arm = item.positive("crank_length");
  }
  leg.force = static_cast<int>(model.forces.size());
  model.legs.push_back(leg);
  JointForce force;  // of its command alone: laws of such legs are elements
  force.body = leg.body;
  force.is_stated = false;
  model.forces.push_back(force);
}

/// A leg type of the short form.
struct LegForm {
  const char* type;
  void (*add)(const LegReader&, MechanismModel&, std::vector<LegTrain>&);
  std::vector<std::string> own;  ///< members that no other type has
};

const std::vector<LegForm> kLegForms = {
    {"R2P1R3", add_slide_leg, {"first_axis", "cylinder", "screw"}},
    {"R1R2R3", add_crank_leg, {"axis", "crank", "gear"}}};

const LegForm& find_leg_form(const JsonReader& type) {
  std::string known;
  for (const LegForm& form : kLegForms) {
    if (type.text() == form.type) return form;
    known += (known.empty() ? "" : ", ") + std::string(form.type);
  }
  type.fail("is '" + type.text() + "'; known leg types are " + known);
}

/// A leg must not have a member of another type; shared members need a leg of their type.
void check_leg_members(const JsonReader& item, const std::vector<const LegForm*>& used,
                       const std::string& what) {
  for (const LegForm& form : kLegForms) {
    if (std::find(used.begin(), used.end(), &form) != used.end()) continue;
    for (const std::string& key : form.own) {
      if (item.has(key)) {
        item.at(key).fail("is a member of legs of type " + std::string(form.type) + "; " + what);
      }
    }
  }
}

void read_legs(const JsonReader& root, MechanismModel& model) {
  const bool shared = root.has("leg_defaults");
  const JsonReader defaults = shared ? root.at("leg_defaults") : root;
  std::vector<LegTrain> trains;
  std::vector<const LegForm*> used;
  for (const JsonReader& item : root.list("legs", kMaxItems)) {
    if (item.has("slide") || item.has("crank_joint")) {
      add_written_leg(item, model);
      continue;
    }
    const LegReader leg{item, shared ? &defaults : nullptr};
    const LegForm& form = find_leg_form(leg.owner("type").at("type"));
    check_leg_members(item, {&form}, "this leg has type " + std::string(form.type));
    used.push_back(&form);
    form.add(leg, model, trains);
  }
  if (!used.empty() && shared) check_leg_members(defaults, used, "no leg here has this type");
  for (const LegTrain& train : trains) add_train(train, model);
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
  read_numbers(item, kJointForceNumbers, force);
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
