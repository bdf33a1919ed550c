// How a mechanism is made, moved, attached and taken apart; its equations of motion are in
// mechanism_dynamics_body.hpp.
#include "mechanism/mechanism_dynamics.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "loops/loop_analysis.hpp"
#include "math/decompositions.hpp"
#include "mechanism/mechanism_dynamics_body.hpp"
#include "model/joint_coordinates.hpp"

namespace dockloop {

Mechanism::Mechanism(MechanismModel description, bool newton_only_)
    : model(std::move(description)), newton_only(newton_only_) {
  notes = remove_redundancy(model);
  plan = make_loop_plan(model, model.home_q, newton_only);
}

Status move_to(const Mechanism& mechanism, const VecX<double>& q, MechanismData<double>& data) {
  const MechanismModel& model = mechanism.model;
  double length = 1e-9, way = 0.0;
  for (const double size : mechanism.plan.loop_size) length = std::max(length, size);
  for (int i : mechanism.plan.ind_bodies) {
    const Body& body = model.bodies[i];
    for (int j = body.q_index; j < body.q_index + body.nq(); ++j) {
      const bool is_length = body.joint == JointType::kPrismatic ||
                             (body.joint == JointType::kFree && j < body.q_index + 3);
      way = std::max(way, std::abs(q[j] - model.home_q[j]) / (is_length ? length : 1.0));
    }
  }
  constexpr double kStep = 0.1;       // rad, or part of the largest loop
  constexpr double kSmallest = 1e-3;  // of that
  // Without loops there is no branch to stay on.
  const double usual = way > kStep && !model.loops.empty() ? kStep / way : 1.0;
  for (size_t i = 0; i < model.home_q.size(); ++i)
    data.tree.q[static_cast<int>(i)] = model.home_q[i];
  data.loops.reference.valid = false;
  Status status = calc_position(mechanism, data);
  if (status.ok()) keep_reference(mechanism, data);
  double done = 0.0, step = usual;
  while (status.ok() && done < 1.0) {
    const double part = done + step < 1.0 - 1e-9 ? done + step : 1.0;
    for (int i : mechanism.plan.ind_bodies) {
      const Body& body = model.bodies[i];
      for (int j = body.q_index; j < body.q_index + body.nq(); ++j) {
        data.tree.q[j] = part < 1.0 ? (1.0 - part) * model.home_q[j] + part * q[j] : q[j];
      }
      if (body.joint == JointType::kFree) data.tree.q.segment<4>(body.q_index + 3).normalize();
    }
    const Status reached = calc_position(mechanism, data);
    if (reached.ok()) {
      keep_reference(mechanism, data);
      done = part;
      step = std::min(usual, 2.0 * step);
    } else {
      step *= 0.5;
      if (step < kSmallest * usual) status = reached;
    }
  }
  return status;
}

std::optional<Coordinates> find_better_coordinates(const Mechanism& mechanism,
                                                   const MechanismData<double>& data) {
  const VecX<double>& q = data.tree.q;
  Coordinates better;
  better.pose.assign(q.data(), q.data() + q.size());
  try {
    std::optional<Dependents> dependents = find_better_dependents(mechanism.model, better.pose);
    if (!dependents) return std::nullopt;
    better.dependent = std::move(*dependents);
  } catch (const ModelError&) {  // rounding made a plane look bent: stay with what there is
    return std::nullopt;
  }
  for (size_t k = 0; k < better.dependent.size(); ++k) {
    const Loop& loop = mechanism.model.loops[k];
    const bool searched =
        loop.dependent != better.dependent[k] && loop.closure != ClosureKind::kNewton;
    better.closure.push_back(searched ? ClosureKind::kAutomatic : loop.closure);
  }
  return better;
}

Mechanism with_coordinates(const Mechanism& mechanism, const Coordinates& coordinates) {
  Mechanism changed = mechanism;
  const size_t count = changed.model.loops.size();
  if (coordinates.dependent.size() != count || coordinates.closure.size() != count ||
      coordinates.pose.size() != static_cast<size_t>(changed.model.nq)) {
    throw ModelError("a choice of coordinates belongs to another mechanism");
  }
  const int bodies = static_cast<int>(changed.model.bodies.size());
  for (size_t k = 0; k < count; ++k) {
    const bool known = std::all_of(coordinates.dependent[k].begin(), coordinates.dependent[k].end(),
                                   [&](int body) { return body >= 0 && body < bodies; });
    const ClosureKind closure = coordinates.closure[k];
    if (!known || closure < ClosureKind::kAutomatic || closure > ClosureKind::kP1R1R1 ||
        coordinates.dependent[k].size() != changed.model.loops[k].dependent.size()) {
      throw ModelError("a choice of coordinates names joints or closures that do not exist");
    }
    changed.model.loops[k].dependent = coordinates.dependent[k];
    changed.model.loops[k].closure = coordinates.closure[k];
  }
  // Closed forms take the branch of this pose.
  changed.model.home_given = true;
  changed.plan = make_loop_plan(changed.model, coordinates.pose, mechanism.newton_only);
  return changed;
}

std::vector<double> find_home_gaps(const Mechanism& mechanism) {
  const MechanismModel& model = mechanism.model;
  TreeData<double> tree(model);
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    calc_joint_pose(model, static_cast<int>(i), tree);
  }
  LoopData<double> loops(model, mechanism.plan);
  std::vector<double> gaps;
  for (size_t k = 0; k < model.loops.size(); ++k) {
    calc_cut_position(model, mechanism.plan, static_cast<int>(k), tree, loops.cut[k]);
    const int points = std::min(3, equation_count(model.loops[k].cut));
    gaps.push_back(loops.cut[k].residual.head(points).norm());
  }
  return gaps;
}

namespace {

constexpr double kNoInertia = 1e-12;  // relative to the largest; rounding is less

/// Which bodies lack a mass or an inertia, in words. @param A_ind  not positive definite
std::string describe_missing_inertia(const Mechanism& mechanism, const MatX<double>& A_ind) {
  // Coordinates without inertia; where each has one, a motion of several that has none names one.
  VecX<double> inertia = A_ind.diagonal();
  const MatX<double> free = find_null_space(A_ind, kNoInertia);
  if (inertia.minCoeff() > 0.0 && free.cols() > 0) {
    int largest = 0;
    free.col(0).cwiseAbs().maxCoeff(&largest);
    inertia[largest] = 0.0;
  }
  std::string lists[2];  // of bodies that move along, that turn about such a coordinate
  for (int i : mechanism.plan.ind_bodies) {
    const Body& body = mechanism.model.bodies[static_cast<size_t>(i)];
    bool is_listed[2] = {false, false};
    for (size_t k = 0; k < mechanism.plan.ind_v.size(); ++k) {
      const int v = mechanism.plan.ind_v[k] - body.v_index;
      if (v < 0 || v >= body.nv() || inertia[static_cast<int>(k)] > 0.0) continue;
      is_listed[is_angle(body, v)] = true;
    }
    for (int kind : {0, 1}) {
      if (!is_listed[kind]) continue;
      lists[kind] += (lists[kind].empty() ? "'" : ", '") + body.name + "'";
    }
  }
  std::string text;
  if (!lists[0].empty()) {
    text += "; give the bodies they move a mass: nothing that moves with " + lists[0] + " has one";
  }
  if (!lists[1].empty()) {
    text +=
        "; give the bodies they turn an inertia, or a com away from the axis: nothing that "
        "turns with " +
        lists[1] + " has a moment of inertia about every axis";
  }
  return text;
}

/// Why the home pose cannot be evaluated, in words. @param status  of calc_position, not ok
std::string describe_home_failure(const Mechanism& mechanism, const MechanismData<double>& data,
                                  const Status& status) {
  const MechanismModel& model = mechanism.model;
  if (status.index >= 0) {
    const std::string reason = status.code == StatusCode::kOutOfReach ? "its branch cannot reach"
                               : status.code == StatusCode::kLoopSingular
                                   ? "it is singular there"
                                   : "Newton does not converge";
    return "loop '" + model.loops[status.index].name + "' cannot be closed from the home pose (" +
           reason + "); correct the geometry or give home_q";
  }
  return "the inertia in the independent coordinates is not positive definite" +
         describe_missing_inertia(mechanism, data.A_ind);
}

constexpr double kAssembleGap = 0.01;  // of a stated home, part of the loop size

/// Note for each loop that was open by how much it was, and which joint moved farthest to close it;
/// then the closed pose, if the file states another. @param data  closed
void describe_assembly(const std::vector<double>& gaps, const MechanismData<double>& data,
                       Mechanism& mechanism) {
  const MechanismModel& model = mechanism.model;
  char text[256];
  bool was_open = false;
  for (size_t k = 0; k < model.loops.size(); ++k) {
    if (gaps[k] <= kHomeGap * mechanism.plan.loop_size[k]) continue;
    was_open = true;
    std::snprintf(text, sizeof text, "is open by %.6g%s at the %s; it was closed from there",
                  gaps[k], model.loops[k].cut == CutType::kCoupling ? "" : " m",
                  model.home_given ? "stated home" : "zero pose (no home_q is given)");
    std::string note = "loop '" + model.loops[k].name + "' " + text;
    const Body* farthest = nullptr;
    double most = 0.0;
    for (int i : model.loops[k].dependent) {
      const int q = model.bodies[i].q_index;
      const double moved = data.tree.q[q] - model.home_q[q];
      if (std::abs(moved) <= std::abs(most)) continue;
      most = moved;
      farthest = &model.bodies[i];
    }
    if (farthest) {
      std::snprintf(text, sizeof text, "' moved by %.3g %s", most,
                    farthest->joint == JointType::kPrismatic ? "m" : "rad");
      note += ": '" + farthest->name + text;
    }
    mechanism.notes.push_back(note);
  }
  if (!was_open || !model.home_given) return;
  std::string pose;
  for (int i = 0; i < model.nq; ++i) {
    std::snprintf(text, sizeof text, "%s%.17g", i > 0 ? ", " : "", data.tree.q[i]);
    pose += text;
  }
  mechanism.notes.push_back("home_q was a first guess; the closed pose is \"home_q\": [" + pose +
                            "]");
}

}  // namespace

void calc_home_position(const Mechanism& mechanism, const std::string& source,
                        MechanismData<double>& data) {
  const Status status = calc_position(mechanism, data);
  if (status.ok()) return;
  throw ModelError(source + ": " + describe_home_failure(mechanism, data, status));
}

void close_home(Mechanism& mechanism, const std::string& source_name) {
  MechanismModel& model = mechanism.model;
  char text[256];
  const std::vector<double> gaps = find_home_gaps(mechanism);
  for (size_t k = 0; model.home_given && k < model.loops.size(); ++k) {
    // A stated home may be a first guess, as read off a drawing.
    const double limit = kAssembleGap * mechanism.plan.loop_size[k];
    if (gaps[k] <= limit) continue;
    if (model.loops[k].cut == CutType::kCoupling) {
      std::snprintf(text, sizeof text,
                    "(a coupling) is open by %.6g at the stated home (limit %.2g); correct home_q "
                    "or 'offset'",
                    gaps[k], limit);
    } else {
      std::snprintf(text, sizeof text,
                    "is open by %.6g m at the stated home (limit %.2g m); correct home_q or the "
                    "cut points",
                    gaps[k], limit);
    }
    throw ModelError(source_name + ": loop '" + model.loops[k].name + "' " + text);
  }
  MechanismData<double> data(mechanism);
  calc_home_position(mechanism, source_name, data);
  // A leg whose slide must travel a good part of its length to close was not closed at home.
  for (const LoopBlock& block : mechanism.plan.blocks) {
    for (size_t i = 0; block.form() && i < block.form()->joint.size(); ++i) {
      const Body& slide = model.bodies[block.form()->joint[i].body];
      if (slide.joint != JointType::kPrismatic) continue;
      const double moved = std::abs(data.tree.q[slide.q_index] - model.home_q[slide.q_index]);
      const double limit = 0.25 * mechanism.plan.loop_size[block.loops[0]];
      if (moved <= limit) continue;
      std::snprintf(text, sizeof text,
                    "is open at home: slide '%s' would have to move by %.6g m (limit %.6g m, a "
                    "quarter of the leg); correct the cut points or give home_q",
                    slide.name.c_str(), moved, limit);
      throw ModelError(source_name + ": loop '" + model.loops[block.loops[0]].name + "' " + text);
    }
  }
  describe_assembly(gaps, data, mechanism);
  for (int i = 0; i < model.nq; ++i) model.home_q[i] = data.tree.q[i];
  // Closed forms take their branch from the closed pose.
  model.home_given = true;
  mechanism.plan = make_loop_plan(model, model.home_q, mechanism.newton_only);
}

namespace {

/// Bodies of a part: massless ones but for the last, each moved by one coordinate of its
/// connection.
void add_part(const VehiclePart& part, int parent, std::vector<Body>& bodies) {
  for (size_t k = 0; k < part.coordinates.size(); ++k) {
    Body body;
    body.name = part.name;
    if (k + 1 < part.coordinates.size()) body.name += " (" + std::to_string(k + 1) + ")";
    body.parent = parent;
    body.joint = part.coordinates[k].joint;
    body.axis = part.coordinates[k].axis;
    body.axis_of_rotation = part.coordinates[k].axis_of_rotation;
    if (k == 0) body.placement = part.placement;
    parent = static_cast<int>(bodies.size());
    bodies.push_back(body);
  }
  bodies.back().mass = part.mass;
  bodies.back().com = part.com;
  bodies.back().inertia = part.inertia;
}

/// Springs and dampers of a part whose first body is `body`.
void add_part_forces(const VehiclePart& part, int body, std::vector<JointForce>& forces) {
  for (const PartCoordinate& coordinate : part.coordinates) {
    JointForce force;
    force.body = body++;
    force.stiffness = coordinate.stiffness;
    force.damping = coordinate.damping;
    force.is_stated = false;
    forces.push_back(force);
  }
}

}  // namespace

MechanismModel attach_vehicle(const MechanismModel& mechanism, const VehicleBody& vehicle,
                              const Pose<double>& base_in_vehicle, const VehicleParts& parts) {
  MechanismModel model = mechanism;
  std::vector<Body> carriers(1);
  carriers[0].name = "vehicle";
  carriers[0].mass = vehicle.mass;
  carriers[0].com = vehicle.com;
  carriers[0].inertia = vehicle.inertia;
  Pose<double> base = base_in_vehicle;  // in the last carrier
  if (parts.adapter) {
    add_part(*parts.adapter, 0, carriers);
    base = inverse(parts.adapter->placement) * base;
  }
  const int shift = static_cast<int>(carriers.size());
  model.bodies.insert(model.bodies.begin(), carriers.begin(), carriers.end());
  for (size_t i = carriers.size(); i < model.bodies.size(); ++i) {
    Body& b = model.bodies[i];
    if (b.parent == kBase) b.placement = base * b.placement;
    b.parent += shift;  // kBase becomes the last carrier
  }
  for (Loop& loop : model.loops) {
    // What was fixed on the base is now fixed on the carrier, in its axes.
    if (loop.closing == kBase) {
      loop.point_on_closing = base.R * loop.point_on_closing + base.p;
      loop.axis_on_closing = base.R * loop.axis_on_closing;
    }
    if (loop.root == kBase) loop.plane_axes_in_root = loop.plane_axes_in_root * base.R.transpose();
    for (int* index : {&loop.root, &loop.first, &loop.terminal, &loop.closing}) *index += shift;
    for (int& index : loop.dependent) index += shift;
    for (CouplingTerm& term : loop.terms) term.body += shift;
  }
  for (JointForce& force : model.forces) force.body += shift;
  for (ForceElement& element : model.elements) {
    for (ElementTerm& term : element.along) term.body += shift;
  }
  for (Leg& leg : model.legs) leg.body += shift;
  model.capture_body += shift;
  for (int& body : model.contact_bodies) body += shift;
  std::vector<double> home(static_cast<size_t>(shift + 6), 0.0);
  home[3] = 1.0;
  model.home_q.insert(model.home_q.begin(), home.begin(), home.end());
  model.carrier = shift - 1;
  const size_t first_part = model.bodies.size();
  for (const VehiclePart& part : parts.hung) {
    add_part_forces(part, static_cast<int>(model.bodies.size()), model.forces);
    add_part(part, 0, model.bodies);
  }
  if (parts.adapter) add_part_forces(*parts.adapter, 1, model.forces);
  model.part_bodies = static_cast<int>(model.bodies.size() - first_part);
  model.part_forces = parts.count_coordinates();
  model.home_q.resize(model.home_q.size() + model.bodies.size() - first_part, 0.0);
  number_coordinates(model);
  return model;
}

VehicleBody find_rigid_parts(const VehicleParts& parts) {
  VehicleBody all;
  parts.for_each([&](const VehiclePart& part) {
    all = join(all, transform(part.placement, {part.mass, part.com, part.inertia}));
  });
  return all;
}

double find_share_without_modes(const VehicleBody& vehicle, const VehicleParts& parts) {
  if (!parts.has_modes()) return 1.0;
  const Mat3<double> h = skew<double>(vehicle.mass * vehicle.com);
  Mat6<double> rigid;
  rigid << vehicle.mass * Mat3<double>::Identity(), -h, h,
      vehicle.inertia - h * skew<double>(vehicle.com);
  const Mat6<double> factor = find_cholesky_factor(rigid);
  Mat6<double> taken = Mat6<double>::Zero();
  parts.for_each([&](const VehiclePart& part) {
    if (!is_mode(part)) return;
    const PartCoordinate& mode = part.coordinates.front();
    Vec6<double> share;
    share << mode.axis, mode.axis_of_rotation;
    factor.triangularView<Eigen::Lower>().solveInPlace(share);
    taken += share * share.transpose();
  });
  return 1.0 - find_eigenvalues(taken)[5];
}

MechanismModel fix_base(const MechanismModel& mechanism, const Pose<double>& base_pose) {
  MechanismModel model = mechanism;
  for (Body& body : model.bodies) {
    if (body.parent == kBase) body.placement = base_pose * body.placement;
  }
  for (Loop& loop : model.loops) {
    if (loop.closing == kBase) {
      loop.point_on_closing = base_pose.R * loop.point_on_closing + base_pose.p;
      loop.axis_on_closing = base_pose.R * loop.axis_on_closing;
    }
    if (loop.root == kBase) {
      loop.plane_axes_in_root = loop.plane_axes_in_root * base_pose.R.transpose();
    }
  }
  return model;
}

VehicleBody join(const VehicleBody& a, const VehicleBody& b) {
  VehicleBody both;
  both.mass = a.mass + b.mass;
  both.inertia = a.inertia + b.inertia;
  if (!(both.mass > 0.0)) return both;
  both.com = (a.mass * a.com + b.mass * b.com) / both.mass;
  both.inertia += find_point_inertia<double>(a.mass * b.mass / both.mass, b.com - a.com);
  return both;
}

VehicleBody transform(const Pose<double>& pose, const VehicleBody& body) {
  return {body.mass, pose.R * body.com + pose.p, pose.R * body.inertia * pose.R.transpose()};
}

VehicleBody find_frozen_body(const Mechanism& mechanism) {
  MechanismData<double> data(mechanism);
  calc_home_position(mechanism, "mechanism", data);
  VehicleBody frozen;
  Vec3<double> first_moment = Vec3<double>::Zero();
  for (size_t i = 0; i < mechanism.model.bodies.size(); ++i) {
    frozen.mass += mechanism.model.bodies[i].mass;
    first_moment += data.tree.h_body[i] + mechanism.model.bodies[i].mass * data.tree.p[i];
  }
  if (frozen.mass > 0.0) frozen.com = first_moment / frozen.mass;
  for (size_t i = 0; i < mechanism.model.bodies.size(); ++i) {
    const Body& body = mechanism.model.bodies[i];
    const Mat3<double>& R = data.tree.R[i];
    const Vec3<double> c = data.tree.p[i] + R * body.com - frozen.com;
    frozen.inertia += R * body.inertia * R.transpose() + find_point_inertia(body.mass, c);
  }
  return frozen;
}

}  // namespace dockloop
