// Recognition: does a branch of the loop table have the geometry of a leg with a closed form?
//
// Only axes and points count, not how the file places its body axes: joint zeros may lie anywhere,
// axes may point either way. The branch sign is the one of the home pose.
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "loops/closed_form.hpp"
#include "model/mechanism_model.hpp"

namespace dockloop {

/// The two paths of a loop, from below the lowest common ancestor down to terminal and closing.
struct LoopPaths {
  int lca = kBase;
  std::vector<int> terminal, closing;  ///< bodies; empty if the lca is that body itself
  int root_on_terminal = -1;  ///< position of the root in `terminal`, -1 if it is the lca or above
  std::vector<int> tied;      ///< bodies of a coupling, whose paths are empty
};

/// Canonical coordinate of a joint: theta = sign x q + zero.
struct JointMap {
  int body = 0;
  int row = 0;  ///< place of the joint among the dependents of its loop
  int sign = 1;
  double c = 1.0, s = 0.0, zero = 0.0;  ///< cosine, sine and value of the offset [rad]
};

/// Last turning joint of a branch with a universal cut: it turns about an axis through the cut
/// point, so it moves nothing but the cross axis.
struct LegSpin {
  int body = 0;
  Vec3<double> cross_axis;  ///< cross axis of the terminal body at zero spin, axes of the joint
  int branch = 1;
};

/// A leg as it lies in the mechanism.
struct ClosedForm {
  LegKind kind = LegKind::kR2P1R3;
  LegShape shape;
  LegBranch branch;
  Pose<double> in_parent;       ///< canonical axes at the leg's centre, in axes of its parent body
  int parent_on_terminal = -1;  ///< position of that parent in LoopPaths::terminal, -1: the lca
  std::vector<JointMap> joint;  ///< from the parent outwards; 3, planar 2
  std::optional<LegSpin> spin;
  bool has_inverse() const { return !spin && kind <= LegKind::kR1R2R3Perpendicular; }
};

/// A closed form, or the reason why there is none.
struct Recognition {
  std::optional<ClosedForm> form;
  std::string reason;
  bool misfit = false;  ///< the joints are one chain, but its lines are not those of a known leg
};

/// @param home  poses of all bodies in the base at q
/// @param q     all coordinates; the branch is the one nearest to them, with the sign of
///              Loop::branch where the file states no home pose
Recognition recognise_leg(const MechanismModel& model, const Loop& loop, const LoopPaths& paths,
                          const std::vector<Pose<double>>& home, const std::vector<double>& q,
                          double size);

/// Signs with which a closed form comes nearest to the joints in q. @param elbow_given  0 = free
/// @return distance [-], infinite if no branch reaches the point L (canonical axes)
template <class S>
double choose_branch(const MechanismModel& model, const ClosedForm& form, const Vec3<S>& L,
                     const VecX<S>& q, double size, int elbow_given, LegBranch& branch);

/// Name of the leg type, as in the loop table of a file.
std::string describe_leg(const ClosedForm& form);

/// Does the declared closure of a loop allow this leg type?
bool fits_declaration(ClosureKind declared, const ClosedForm& form);

/// Joint coordinate, as cosine and sine, of a canonical angle given so.
template <class S>
void find_joint_angle(const JointMap& joint, const S& c, const S& s, S& c_joint, S& s_joint) {
  c_joint = c * S(joint.c) + s * S(joint.s);
  s_joint = S(joint.sign) * (s * S(joint.c) - c * S(joint.s));
}

/// An angle and so many turns that it lies nearest to `near`.
template <class S>
S add_turns(const S& angle, const S& near) {
  using std::floor;
  const S turn = S(2) * S(3.14159265358979323846264338327950288L);
  return angle + turn * floor((near - angle) / turn + S(0.5));
}

/// Angle of (c, s) that lies nearest to `near`.
template <class S>
S find_angle(const S& c, const S& s, const S& near) {
  using std::atan2;
  return add_turns<S>(atan2(s, c), near);
}

}  // namespace dockloop
