// Recognition of legs; see leg_geometry.hpp.
//
// A chain is looked at with all its joints at zero, in axes of the body it hangs on: each joint is
// then a line (direction, point), and the pose of the tip is a product of turns and slides along
// those lines. The test of a leg type is whether its lines are parallel, perpendicular and
// intersecting as they must; what is left over becomes an offset of a joint angle.
#include "loops/leg_geometry.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "loops/leg_geometry_body.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;
constexpr double kFits = 1e-12;  ///< of directions; of points, times the size of the loop

/// A joint of the chain at zero coordinates, axes of the chain's parent.
struct Line {
  int body = 0;
  bool turns = true;
  V axis, point;
};

struct Chain {
  std::vector<Line> joints;
  V tip;  ///< cut point
  double size = 1.0;
};

bool are_perpendicular(const V& a, const V& b) { return std::abs(a.dot(b)) <= kFits; }
bool are_parallel(const V& a, const V& b) { return a.cross(b).norm() <= kFits; }

/// Where two perpendicular lines meet. @return false if they miss each other
bool find_intersection(const Line& a, const Line& b, double size, V& point) {
  const V between = b.point - a.point;
  if (std::abs(between.dot(a.axis.cross(b.axis))) > kFits * std::max(size, between.norm())) {
    return false;
  }
  point = a.point + between.dot(a.axis) * a.axis;
  return true;
}

/// Offset of a joint: the angle of (x, y).
JointMap make_joint(const Line& line, int sign, double x, double y) {
  JointMap joint;
  joint.body = line.body;
  joint.sign = sign;
  const double length = find_length(x, y);
  joint.c = x / length;
  joint.s = y / length;
  joint.zero = std::atan2(y, x);
  return joint;
}
JointMap make_joint(const Line& line, int sign = 1) { return make_joint(line, sign, 1.0, 0.0); }

Mat3<double> make_axes(const V& x, const V& y, const V& z) {
  Mat3<double> axes;
  axes << x, y, z;
  return axes;
}

V turn_z(const JointMap& joint, const V& v) {  // by minus the offset
  return {joint.c * v.x() + joint.s * v.y(), joint.c * v.y() - joint.s * v.x(), v.z()};
}
V turn_y(const JointMap& joint, const V& v) {
  return {joint.c * v.x() - joint.s * v.z(), v.y(), joint.c * v.z() + joint.s * v.x()};
}

/// Universal joint and what follows: axes y = first, z = second. @return false: no universal joint
bool put_universal(const Chain& chain, int first, ClosedForm& form) {
  const Line &a = chain.joints[first], &b = chain.joints[first + 1];
  if (!are_perpendicular(a.axis, b.axis)) return false;
  form.in_parent.R = make_axes(a.axis.cross(b.axis), a.axis, b.axis);
  return find_intersection(a, b, chain.size, form.in_parent.p);
}

std::string fit_R2P1R3(const Chain& chain, ClosedForm& form) {
  const Line& slide = chain.joints[2];
  if (!put_universal(chain, 0, form)) return "its first two axes are not a universal joint";
  const V along = form.in_parent.R.transpose() * slide.axis;
  if (std::abs(along.z()) > kFits) return "its slide is not perpendicular to the axis before";
  form.kind = LegKind::kR2P1R3;
  form.joint = {make_joint(chain.joints[0]), make_joint(chain.joints[1], 1, along.x(), along.y()),
                make_joint(slide)};
  form.shape.tip =
      turn_z(form.joint[1], form.in_parent.R.transpose() * (chain.tip - form.in_parent.p));
  return "";
}

std::string fit_R1R2R3(const Chain& chain, ClosedForm& form) {
  const Line &a = chain.joints[0], &b = chain.joints[1], &c = chain.joints[2];
  V elbow;
  if (!are_perpendicular(b.axis, c.axis) || !find_intersection(b, c, chain.size, elbow)) {
    return "its last two axes are not a universal joint";
  }
  const V from_a = elbow - a.point;
  const V z = a.axis, flat = from_a - from_a.dot(z) * z, tip = chain.tip - elbow;
  form.in_parent.p = a.point;
  form.shape.height = from_a.dot(z);
  if (are_parallel(a.axis, b.axis)) {
    if (flat.norm() < 1e-9 * chain.size) return "its crank has no length";
    const V x = flat.normalized(), y = z.cross(x);
    form.kind = LegKind::kR1R2R3;
    form.shape.l1 = flat.norm();
    form.in_parent.R = make_axes(x, y, z);
    form.joint = {make_joint(a),
                  make_joint(b, b.axis.dot(z) > 0 ? 1 : -1, c.axis.dot(y), -c.axis.dot(x)),
                  make_joint(c)};
    form.shape.tip = turn_z(form.joint[1], form.in_parent.R.transpose() * tip);
    if (find_length(form.shape.tip.x(), form.shape.tip.z()) < 1e-9 * chain.size) {
      return "its rod has no length";
    }
    return "";
  }
  if (!are_perpendicular(a.axis, b.axis))
    return "its first two axes are neither parallel nor square";
  const double side = flat.dot(b.axis.cross(z)) < 0.0 ? -1.0 : 1.0;
  const V y = side * b.axis, x = y.cross(z);
  if (std::abs(flat.dot(y)) > kFits * chain.size) return "its elbow is off the crank";
  form.kind = LegKind::kR1R2R3Perpendicular;
  form.shape.l1 = flat.dot(x);
  form.in_parent.R = make_axes(x, y, z);
  form.joint = {make_joint(a), make_joint(b, side > 0 ? 1 : -1, c.axis.dot(z), c.axis.dot(x)),
                make_joint(c)};
  const V rod = turn_y(form.joint[1], form.in_parent.R.transpose() * tip);
  form.shape.l2 = find_length(rod.x(), rod.y());
  if (std::abs(rod.z()) > kFits * chain.size) return "its cut point is off the last hinge";
  if (!(form.shape.l1 > 1e-9 * chain.size) || !(form.shape.l2 > 1e-9 * chain.size)) {
    return "its crank or rod has no length";
  }
  form.joint[2] = make_joint(c, 1, rod.x(), rod.y());
  return "";
}

std::string fit_P1R2R3(const Chain& chain, ClosedForm& form) {
  if (!put_universal(chain, 1, form)) return "its last two axes are not a universal joint";
  form.kind = LegKind::kP1R2R3;
  form.joint = {make_joint(chain.joints[0]), make_joint(chain.joints[1]),
                make_joint(chain.joints[2])};
  form.shape.slide = form.in_parent.R.transpose() * chain.joints[0].axis;
  form.shape.tip = form.in_parent.R.transpose() * (chain.tip - form.in_parent.p);
  if (find_length(form.shape.tip.x(), form.shape.tip.y()) < 1e-9 * chain.size) {
    return "its strut has no length";
  }
  return "";
}

std::string fit_R2R1R3(const Chain& chain, ClosedForm& form) {
  const Line &b = chain.joints[1], &c = chain.joints[2];
  if (!put_universal(chain, 0, form)) return "its first two axes are not a universal joint";
  if (!are_parallel(b.axis, c.axis)) return "its elbow is not parallel to the axis before";
  const V elbow = form.in_parent.R.transpose() * (c.point - form.in_parent.p);
  form.kind = LegKind::kR2R1R3;
  form.joint = {make_joint(chain.joints[0]), make_joint(b, 1, elbow.x(), elbow.y()), make_joint(c)};
  const V rod = turn_z(form.joint[1], form.in_parent.R.transpose() * (chain.tip - c.point));
  form.joint[2] = make_joint(c, b.axis.dot(c.axis) > 0 ? 1 : -1, rod.x(), rod.y());
  form.shape.l1 = find_length(elbow.x(), elbow.y());
  form.shape.l2 = find_length(rod.x(), rod.y());
  form.shape.height = elbow.z() + rod.z();
  if (!(form.shape.l1 > 1e-9 * chain.size) || !(form.shape.l2 > 1e-9 * chain.size)) {
    return "one of its links has no length";
  }
  return "";
}

/// Planar kinds. @param normal  of the plane, axes of the parent
std::string fit_planar(const Chain& chain, const V& normal, ClosedForm& form) {
  const Line &a = chain.joints[0], &b = chain.joints[1];
  const auto sign = [&](const Line& line) { return line.axis.dot(normal) > 0 ? 1 : -1; };
  const auto flatten = [&](const V& v) { return V(v - v.dot(normal) * normal); };
  const auto set_axes = [&](const V& x) {
    form.in_parent.R = make_axes(x, normal.cross(x), normal);
  };
  if (a.turns && b.turns) {
    const V first = flatten(b.point - a.point);
    if (first.norm() < 1e-9 * chain.size) return "its first link has no length";
    set_axes(first.normalized());
    form.kind = LegKind::kR1R1R1;
    form.in_parent.p = a.point;
    form.shape.l1 = first.norm();
  } else if (a.turns) {
    set_axes(flatten(b.axis).normalized());
    form.kind = LegKind::kR1P1R1;
    form.in_parent.p = a.point;
    form.shape.tip = form.in_parent.R.transpose() * (chain.tip - a.point);
    form.joint = {make_joint(a, sign(a)), make_joint(b)};
    return "";
  } else if (b.turns) {
    set_axes(flatten(a.axis).normalized());
    form.kind = LegKind::kP1R1R1;
    form.in_parent.p = b.point;
  } else {
    return "two slides have no closed form here";
  }
  const V rod = form.in_parent.R.transpose() * (chain.tip - b.point);
  form.shape.l2 = find_length(rod.x(), rod.y());
  if (form.shape.l2 < 1e-9 * chain.size) return "its last link has no length";
  form.joint = {make_joint(a, a.turns ? sign(a) : 1), make_joint(b, sign(b), rod.x(), rod.y())};
  return "";
}

/// Sequence of joints as text: "RRP".
std::string describe_chain(const Chain& chain) {
  std::string text;
  for (const Line& line : chain.joints) text += line.turns ? 'R' : 'P';
  return text;
}

/// Take the spin of a universal cut out of the chain; the rest is a leg with a spherical cut.
std::string take_spin(const MechanismModel& model, const Loop& loop, Chain& chain,
                      ClosedForm& form) {
  const auto misses = [&](const Line& line) {
    return (chain.tip - line.point).cross(line.axis).norm() > kFits * chain.size;
  };
  size_t at = 3;
  V cross = loop.axis_on_terminal;
  if (!chain.joints[3].turns) {  // a slide behind the spin, along its axis, changes nothing
    cross = model.bodies[chain.joints[3].body].placement.R * cross;
    at = 2;
    if (!chain.joints[2].turns || !are_parallel(chain.joints[2].axis, chain.joints[3].axis)) {
      return "its slide is not along a spin axis before it";
    }
  }
  if (misses(chain.joints[at])) return "its spin axis misses the cut point";
  form.spin = LegSpin{chain.joints[at].body, cross, 1};
  chain.joints.erase(chain.joints.begin() + static_cast<std::ptrdiff_t>(at));
  return "";
}

std::string fit(const MechanismModel& model, const Loop& loop, Chain& chain, ClosedForm& form) {
  if (loop.cut == CutType::kPlanarRevolute) {
    const V normal =
        V(loop.plane_axes_in_root.row(0)).cross(V(loop.plane_axes_in_root.row(1))).normalized();
    return fit_planar(chain, normal, form);
  }
  if (loop.cut == CutType::kUniversal) {
    const std::string reason = take_spin(model, loop, chain, form);
    if (!reason.empty()) return reason;
  }
  const std::string type = describe_chain(chain);
  if (type == "RRP") return fit_R2P1R3(chain, form);
  if (type == "PRR") return fit_P1R2R3(chain, form);
  if (type == "RRR") {
    const std::string elbow_last = fit_R2R1R3(chain, form);
    return elbow_last.empty() ? elbow_last : fit_R1R2R3(chain, form);
  }
  return "no closed form is known for joints " + type;
}

}  // namespace

Recognition recognise_leg(const MechanismModel& model, const Loop& loop, const LoopPaths& paths,
                          const std::vector<Pose<double>>& home, const std::vector<double>& q,
                          double size) {
  const bool planar = loop.cut == CutType::kPlanarRevolute;
  if (loop.cut == CutType::kRevolute || loop.cut == CutType::kCoupling || !loop.redundant.empty()) {
    return {std::nullopt, "no closed form is known for this cut", false};
  }
  // The dependent joints must be the last ones of the branch, without others in between.
  Chain chain;
  chain.size = size;
  ClosedForm form;
  const size_t count = loop.dependent.size();
  if (paths.terminal.size() < count)
    return {std::nullopt, "its dependent joints are not one chain", false};
  const size_t first = paths.terminal.size() - count;
  form.parent_on_terminal = static_cast<int>(first) - 1;
  const int parent = first == 0 ? paths.lca : paths.terminal[first - 1];
  if (planar && parent != loop.root)
    return {std::nullopt, "its dependent joints do not begin at its root", false};
  Pose<double> zero;
  for (size_t i = first; i < paths.terminal.size(); ++i) {
    const int index = paths.terminal[i];
    const auto row = std::find(loop.dependent.begin(), loop.dependent.end(), index);
    if (row == loop.dependent.end())
      return {std::nullopt, "its dependent joints are not one chain", false};
    const Body& body = model.bodies[index];
    zero = zero * body.placement;
    chain.joints.push_back({index, body.joint == JointType::kRevolute, zero.R * body.axis, zero.p});
  }
  chain.tip = zero.R * loop.point_on_terminal + zero.p;
  const std::string reason = fit(model, loop, chain, form);
  if (!reason.empty()) return {std::nullopt, reason, true};
  for (JointMap& joint : form.joint) {
    joint.row =
        static_cast<int>(std::find(loop.dependent.begin(), loop.dependent.end(), joint.body) -
                         loop.dependent.begin());
  }

  // Branch: the one of the pose, if the loop is closed there.
  const auto locate = [&](int body, const V& point) {
    return body == kBase ? point : V(home[body].R * point + home[body].p);
  };
  const V closing = locate(loop.closing, loop.point_on_closing);
  V gap = locate(loop.terminal, loop.point_on_terminal) - closing;
  const Pose<double> centre = (parent == kBase ? Pose<double>() : home[parent]) * form.in_parent;
  if (planar) gap = (gap - gap.dot(V(centre.R.col(2))) * centre.R.col(2)).eval();
  const V L = centre.R.transpose() * (closing - centre.p);
  const bool closed = gap.norm() <= 1e-6 * size;
  const VecX<double> pose = Eigen::Map<const VecX<double>>(q.data(), model.nq);
  const double distance = choose_branch<double>(model, form, L, pose, size,
                                                model.home_given ? 0 : loop.branch, form.branch);
  if (closed && model.home_given && !(distance < 1e-5)) {
    return {std::nullopt, "its pose lies on no branch of the closed form", false};
  }
  if (form.spin) {
    // The spin has two solutions, half a turn apart or mirrored: take the side it stands on.
    const Body& spin = model.bodies[form.spin->body];
    const Mat3<double> before =
        (spin.parent == kBase ? Mat3<double>::Identity() : home[spin.parent].R) * spin.placement.R;
    const double at = q[static_cast<size_t>(spin.q_index)];
    const V B = before.transpose() * (loop.closing == kBase
                                          ? loop.axis_on_closing
                                          : V(home[loop.closing].R * loop.axis_on_closing));
    const V A = form.spin->cross_axis, across = spin.axis.cross(A);
    // f = cos A.B + sin across.B + const: its slope at the pose has the sign of the branch.
    const V flat = A - A.dot(spin.axis) * spin.axis;
    const double slope = std::cos(at) * across.dot(B) - std::sin(at) * flat.dot(B);
    form.spin->branch = slope < 0.0 ? -1 : 1;
  }
  return {form, "", false};
}

std::string describe_leg(const ClosedForm& form) {
  switch (form.kind) {
    case LegKind::kR2P1R3:
      return form.spin ? "R2C2R2" : "R2P1R3";
    case LegKind::kR1R2R3:
      return form.spin ? "R1R3R2" : "R1R2R3";
    case LegKind::kR1R2R3Perpendicular:
      return form.spin ? "R1R3R2_perp" : "R1R2R3_perp";
    case LegKind::kP1R2R3:
      return form.spin ? "P1R3R2" : "P1R2R3";
    case LegKind::kR2R1R3:
      return form.spin ? "R2R2R2" : "R2R1R3";
    case LegKind::kR1P1R1:
      return "R1P1R1";
    case LegKind::kR1R1R1:
      return "R1R1R1";
    case LegKind::kP1R1R1:
      break;
  }
  return "P1R1R1";
}

bool fits_declaration(ClosureKind declared, const ClosedForm& form) {
  switch (declared) {
    case ClosureKind::kAutomatic:
    case ClosureKind::kNewton:
      return true;
    case ClosureKind::kR2P1R3:
    case ClosureKind::kR2C2R2:
      return form.kind == LegKind::kR2P1R3;
    case ClosureKind::kR1R2R3:
      return form.kind == LegKind::kR1R2R3 || form.kind == LegKind::kR1R2R3Perpendicular;
    case ClosureKind::kP1R2R3:
      return form.kind == LegKind::kP1R2R3;
    case ClosureKind::kR2R1R3:
      return form.kind == LegKind::kR2R1R3;
    case ClosureKind::kR1P1R1:
      return form.kind == LegKind::kR1P1R1;
    case ClosureKind::kR1R1R1:
      return form.kind == LegKind::kR1R1R1;
    case ClosureKind::kP1R1R1:
      break;
  }
  return form.kind == LegKind::kP1R1R1;
}

}  // namespace dockloop
