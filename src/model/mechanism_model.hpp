// A mechanism as data: bodies on a tree of joints, a table of loops, joint force laws.
//
// Every loop is cut at one joint, which leaves a tree. The model does not change after
// read_mechanism(); a run computes its numbers in workspaces (tree/, loops/, mechanism/).
// Conventions (joint axes, free joint, cut sign): src/README.md.
#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "math/law_number.hpp"
#include "math/types.hpp"
#include "model/force_element.hpp"

namespace dockloop {

constexpr int kBase =
    -1;  ///< body index of the base (frame B, or the body that carries the mechanism)

/// A mode is no joint: its coordinate is the amplitude of a normal mode of the parent, found with
/// the parent held, with a modal mass of 1. It moves no frame.
enum class JointType { kRevolute, kPrismatic, kFree, kMode };

/// A body and the joint that connects it to its parent (parent index < own index, or kBase).
struct Body {
  std::string name;
  int parent = kBase;
  JointType joint = JointType::kFree;
  Vec3<double> axis = Vec3<double>::UnitZ();  ///< unit, joint axes; unused for free joints. Of a
                                              ///< mode: its participation in translation [kg^(1/2)]
  /// Of a mode, its participation in rotation about the origin [kg^(1/2) m]
  Vec3<double> axis_of_rotation = Vec3<double>::Zero();
  Pose<double> placement;                       ///< joint axes in parent axes at zero coordinate
  double mass = 0.0;                            ///< [kg]
  Vec3<double> com = Vec3<double>::Zero();      ///< body axes [m]
  Mat3<double> inertia = Mat3<double>::Zero();  ///< about the com, body axes [kg m2]
  int q_index = 0;                              ///< first coordinate in q
  int v_index = 0;                              ///< first velocity in v
  int nq() const { return joint == JointType::kFree ? 7 : 1; }
  int nv() const { return joint == JointType::kFree ? 6 : 1; }
};

/// Equations of the cut joint of a loop.
enum class CutType {
  kSpherical,       ///< 3 equations: points coincide
  kUniversal,       ///< 4: points coincide, cross axes stay perpendicular
  kPlanarRevolute,  ///< 2: points coincide within the plane of the loop
  kRevolute,        ///< 5: points coincide, hinge axes stay parallel
  kCoupling         ///< 1: a joint coordinate is a linear function of others (gear, screw)
};

constexpr int kMaxEquations = 5;  ///< of one cut

/// Method for the dependent coordinates of a loop.
enum class ClosureKind {
  kAutomatic,  ///< closed form if the geometry allows one, else Newton
  kNewton,
  kR2P1R3,  ///< universal joint, slide, spherical cut
  kR2C2R2,  ///< the same with a spin about the slide and a universal cut
  kR1R2R3,  ///< crank, universal joint (either order of its axes), spherical cut
  kP1R2R3,  ///< slide, universal joint with a strut, spherical cut
  kR2R1R3,  ///< universal joint, elbow, spherical cut
  kR1P1R1,  ///< planar: hinge, slide
  kR1R1R1,  ///< planar: two hinges
  kP1R1R1   ///< planar: slide, hinge
};

/// Its name in a file.
std::string describe_closure(ClosureKind kind);

/// One term of a coupling: ratio x coordinate of a joint.
struct CouplingTerm {
  int body = 0;
  double ratio = 0.0;  ///< unit of the dependent coordinate per unit of this one
};

/// One row of the loop table: branch first..terminal on root, cut from `closing`.
/// A coupling is a row too: its dependent joint follows q_dep = offset + rate t + sum of terms.
struct Loop {
  std::string name;
  int root = kBase, first = 0, terminal = 0, closing = kBase;
  CutType cut = CutType::kSpherical;
  Vec3<double> point_on_terminal = Vec3<double>::Zero();  ///< axes of terminal [m]
  Vec3<double> point_on_closing = Vec3<double>::Zero();   ///< axes of closing [m]
  Vec3<double> axis_on_terminal = Vec3<double>::UnitX();  ///< universal cut: unit cross axes;
  Vec3<double> axis_on_closing = Vec3<double>::UnitY();   ///< revolute cut: unit hinge axes
  Eigen::Matrix<double, 2, 3> plane_axes_in_root =
      Eigen::Matrix<double, 2, 3>::Zero();  ///< planar cut: orthonormal rows
  std::vector<CouplingTerm> terms;          ///< coupling
  double offset = 0.0;                      ///< coupling [m] or [rad]
  double rate = 0.0;                        ///< coupling: of a drive [m/s] or [rad/s]
  std::vector<int> dependent;               ///< bodies whose joints this row determines
  std::vector<int> redundant;               ///< cut equations left out because they are redundant
  ClosureKind closure = ClosureKind::kAutomatic;
  /// Assembly branch of a closed form if home_q does not define it: +1 or -1, 0 = the nearest.
  int branch = 0;
};

/// Number of equations of a cut.
inline int equation_count(CutType cut) {
  switch (cut) {
    case CutType::kUniversal:
      return 4;
    case CutType::kPlanarRevolute:
      return 2;
    case CutType::kRevolute:
      return 5;
    case CutType::kCoupling:
      return 1;
    case CutType::kSpherical:
      break;
  }
  return 3;
}

/// Factor of a joint's coordinate in the equation of a coupling: q_dep - offset - sum of terms = 0.
double find_coupling_factor(const Loop& loop, int body);

/// Equations of a row in use: equations of its cut without redundant ones.
std::vector<int> find_active_equations(const Loop& loop);

/// Limits of the dimensionless margin of a loop [-]: below, the loop is singular, or a warning is
/// issued.
struct SingularityLimits {
  double error = 1e-4, warning = 1e-2;
};

/// One-sided elastic stop at a limit; see mechanism/joint_forces.hpp for the law.
struct EndStops {
  bool present = false;
  double lower = 0.0, upper = 0.0;  ///< joint coordinates of the stops [m] or [rad]
  double stiffness = 0.0;           ///< [N/m]
  double damping = 0.0;             ///< [s/m], factor on the elastic force
  double toe = 0.0;                 ///< [m] over which the stiffness builds up
};

/// Spring, damper and stops along one joint coordinate:
/// tau = -stiffness (q - rest) - damping v + preload + stops.
struct JointForce {
  int body = 0;            ///< body of the joint
  double stiffness = 0.0;  ///< [N/m]
  double damping = 0.0;    ///< [N s/m]
  double rest = 0.0;       ///< [m]
  double preload = 0.0;    ///< [N], positive extends
  EndStops stops;
  bool is_stated = true;  ///< by the file; false: command to a leg alone, or a part of a vehicle
};

/// Units are those of a slide or a turn.
inline constexpr LawNumber<JointForce> kJointForceNumbers[] = {
    {"stiffness", &JointForce::stiffness, "", Rule::kNotNegative, false, "Stiffness"},
    {"damping", &JointForce::damping, "", Rule::kNotNegative, false, "Damping"},
    {"rest", &JointForce::rest, "", Rule::kAny, false, "Coordinate without a spring force"},
    {"preload", &JointForce::preload, "", Rule::kAny, false,
     "Constant force, positive along the coordinate"},
};

/// End stops of a leg.
struct LegStops {
  double min_length = 0.0, max_length = 0.0;         ///< [m]
  double stiffness = 0.0, damping = 0.0, toe = 0.0;  ///< [N/m], [s/m], [m]
};

inline constexpr LawNumber<LegStops> kLegStopNumbers[] = {
    {"min_length", &LegStops::min_length, "m", Rule::kAny, true,
     "Length, or travel of the crank pin, at the lower stop"},
    {"max_length", &LegStops::max_length, "m", Rule::kAny, true,
     "Length, or travel of the crank pin, at the upper stop"},
    {"stiffness", &LegStops::stiffness, "N/m", Rule::kPositive, true, "Stiffness of the end stops"},
    {"damping", &LegStops::damping, "s/m", Rule::kNotNegative, false,
     "Factor of the rate of depth on the elastic force of the end stops"},
    {"toe", &LegStops::toe, "m", Rule::kPositive, true,
     "Depth over which the stiffness of the end stops builds up"},
};

/// Spring, damper and stops of a leg in its own lengths.
struct LegLaw {
  double stiffness = 0.0;    ///< [N/m]
  double damping = 0.0;      ///< [N s/m]
  double free_length = 0.0;  ///< [m]
  double preload = 0.0;      ///< [N]
  std::optional<LegStops> stops;
};

inline constexpr LawNumber<LegLaw> kLegNumbers[] = {
    {"stiffness", &LegLaw::stiffness, "N/m", Rule::kNotNegative, false, "Stiffness of the spring"},
    {"damping", &LegLaw::damping, "N.s/m", Rule::kNotNegative, false, "Damping"},
    {"free_length", &LegLaw::free_length, "m", Rule::kAny, false,
     "Length, or travel of the crank pin, without a force of the spring"},
    {"preload", &LegLaw::preload, "N", Rule::kAny, false,
     "Constant force, positive when it increases the length or travel"},
};

/// A leg for users: length, rate and force along one slide, or along the arc of a crank pin.
struct Leg {
  std::string name;
  int body = 0;              ///< body with the slide of the leg, or its crank
  double home_length = 0.0;  ///< [m] between the ends of a slide leg at coordinate 0; crank: 0
  double arm = 1.0;          ///< length per joint coordinate: crank length [m/rad]; slide: 1
  int force = 0;             ///< index into MechanismModel::forces; its numbers follow from `law`
  /// Springs and stops; none if a file states none: laws of such a leg are elements.
  std::optional<LegLaw> law = {};
};

struct MechanismModel {
  std::string name;
  Vec3<double> gravity = Vec3<double>::Zero();  ///< base axes [m/s2]; used by `check` and tests
  std::vector<Body> bodies;
  std::vector<Loop> loops;  ///< couplings last
  SingularityLimits singularity;
  std::vector<JointForce> forces;
  std::vector<ForceElement> elements;
  std::vector<LawFailure> failures;  ///< of laws of elements
  std::vector<Leg> legs;
  std::vector<double> home_q;       ///< all coordinates, nq
  bool home_given = false;          ///< the file states home_q
  int capture_body = kBase;         ///< body that carries frame G; kBase: the chaser, at A
  Pose<double> capture_in_body;     ///< G in axes of that body, or of A
  std::vector<int> contact_bodies;  ///< others that carry contact surfaces, as closing fingers
  int nq = 0, nv = 0;
  /// Of parts of the vehicle that carries the mechanism (model/vehicle_part.hpp): bodies that hang
  /// on it, and joint forces along coordinates; both are at the end of their lists.
  int part_bodies = 0, part_forces = 0;
  int carrier = kBase;  ///< body on which the mechanism stands: vehicle or adapter
  int first_part() const { return static_cast<int>(bodies.size()) - part_bodies; }
  /// Does it carry G or contact surfaces? Loads act on it, and its motion is needed at every state.
  bool is_contact_body(int body) const {
    return body == capture_body ||
           std::find(contact_bodies.begin(), contact_bodies.end(), body) != contact_bodies.end();
  }
};

/// Number the coordinates in body order (q_index, v_index, nq, nv). A missing home becomes zero.
void number_coordinates(MechanismModel& model);

/// All checks without kinematics. @throws ModelError with element, value, limit.
void check_mechanism(const MechanismModel& model);
/// Warnings of moments of inertia that no rigid body has, which may idealise a rotor or a strut;
/// legs that share them are named together.
std::vector<std::string> list_doubtful_inertias(const MechanismModel& model);

/// Read a mechanism document (low-level members, or under the key "mechanism"; `legs` expanded).
/// @param source_name file name for messages. @throws ModelError
MechanismModel read_mechanism(const std::string& json_text, const std::string& source_name);

/// Index of a body; "base" is kBase. @throws ModelError naming `place`, the element with this name.
int find_body(const MechanismModel& model, const std::string& body, const std::string& place);

}  // namespace dockloop
