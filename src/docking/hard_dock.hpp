// Hardware of the hard dock: faces, hooks in rows, pushers, and the rigid joint.
//
// Everything acts between A, fixed on the chaser, and P, fixed on the target. Points t_i are fixed
// on A, in its mating plane. An opening is measured along x of P:
//
//   o_i = x_P . (o_P - t_i)          > 0 where the interfaces are apart
//
// A force f acts along x_P at t_i on P, the opposite on A. It is -dU/do_i, so force and moment are
// the exact gradient, and momentum balances. Per point:
//
//   face    f =  k s(-o), one-sided with a toe, times the damping factor; k is a share of the faces
//   hook    f = -k s(o - x(t)); its drive moves the end x from +play to the preloaded end
//   pusher  f =  F0 + k c for c = stroke - o > take-up; C1 from zero at c = 0
//
// The preloaded end leaves the tension `preload` in every hook when faces and hooks alone are in
// balance. Hooks open by a ramp that releases their tension, and books their energy as dissipated.
// Pushers are switched by a ramp: switched off they lose their energy, switched on a drive brings
// it. All ramps are C1.
//
// The rigid joint (RigidJoint) makes chaser, mechanism and target one rigid body in the relative
// pose of that moment. Momenta are kept; the kinetic energy of relative motion is dissipated.
// Stored energies of springs and hooks stay. Opening leaves the common twist to all bodies.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "contact/contact_model.hpp"
#include "contact/interface_tangent.hpp"
#include "math/choice.hpp"
#include "math/types.hpp"

namespace dockloop {

constexpr int kMaxHooks = 24, kMaxHookRows = 4;

/// Mating planes that press on each other, at points on a circle.
struct FaceLaw {
  std::vector<Eigen::Vector2d> points;  ///< y, z in A [m]
  double stiffness = 0.0;               ///< of all points together [N/m]
  double damping = 0.0;                 ///< factor 1 + damping * rate of depth [s/m]
  double toe = 1e-5;                    ///< [m]
};

inline constexpr LawNumber<FaceLaw> kFaceNumbers[] = {
    {"stiffness", &FaceLaw::stiffness, "N/m", Rule::kPositive, true,
     "Stiffness of the faces, all points together"},
    {"damping", &FaceLaw::damping, "s/m", Rule::kNotNegative, false,
     "Factor of the rate of depth on the elastic force of the faces"},
    {"toe", &FaceLaw::toe, "m", Rule::kPositive, false,
     "Depth over which the stiffness of the faces builds up"},
};

struct HookRow {
  std::vector<Eigen::Vector2d> points;  ///< y, z in A [m]
  double close_delay = 0.0;             ///< after the command [s]
};

inline constexpr LawNumber<HookRow> kHookRowNumbers[] = {
    {"close_delay", &HookRow::close_delay, "s", Rule::kNotNegative, false,
     "Delay of this row of hooks after the command to close"},
};

/// All hooks are equal.
struct HookLaw {
  std::vector<HookRow> rows;
  double stiffness = 0.0;                    ///< of one hook [N/m]
  double preload = 0.0;                      ///< of one hook, of the closed joint [N]
  double damping = 0.0;                      ///< factor 1 + damping * rate of stretch [s/m]
  double toe = 1e-5;                         ///< [m]
  double play = 0.0;                         ///< largest opening at which hooks can close [m]
  double close_time = 0.0, open_time = 0.5;  ///< of the ramps [s]
  int count() const;
};

inline constexpr LawNumber<HookLaw> kHookNumbers[] = {
    {"stiffness", &HookLaw::stiffness, "N/m", Rule::kPositive, true, "Stiffness of one hook"},
    {"preload", &HookLaw::preload, "N", Rule::kPositive, true,
     "Tension of one hook of the closed joint"},
    {"damping", &HookLaw::damping, "s/m", Rule::kNotNegative, false,
     "Factor of the rate of stretch on the elastic force of a hook"},
    {"toe", &HookLaw::toe, "m", Rule::kPositive, false,
     "Stretch over which the stiffness of a hook builds up"},
    {"play", &HookLaw::play, "m", Rule::kPositive, true,
     "Largest opening at which hooks can close"},
    {"close_time", &HookLaw::close_time, "s", Rule::kPositive, true, "Time in which a hook closes"},
    {"open_time", &HookLaw::open_time, "s", Rule::kPositive, false, "Time in which a hook opens"},
};

struct PusherLaw {
  std::vector<Eigen::Vector2d> points;  ///< y, z in A [m]
  double stroke = 0.0;                  ///< opening at which they let go [m]
  double preload = 0.0;                 ///< of one pusher at the end of its stroke [N]
  double stiffness = 0.0;               ///< of one pusher [N/m]
  double take_up = 5e-4;                ///< of the preload [m]
  double ramp = 0.05;                   ///< of switching [s]
  bool on_at_start = true;
};

inline constexpr LawNumber<PusherLaw> kPusherNumbers[] = {
    {"stroke", &PusherLaw::stroke, "m", Rule::kPositive, true,
     "Opening at which the pushers let go"},
    {"preload", &PusherLaw::preload, "N", Rule::kNotNegative, false,
     "Force of one pusher at the end of its stroke"},
    {"stiffness", &PusherLaw::stiffness, "N/m", Rule::kNotNegative, false,
     "Stiffness of one pusher"},
    {"take_up", &PusherLaw::take_up, "m", Rule::kPositive, false,
     "Travel over which the preload of a pusher builds up"},
    {"ramp", &PusherLaw::ramp, "s", Rule::kPositive, false,
     "Time in which the pushers are switched on or off"},
};

/// The hardware; without points, none.
struct HardDock {
  FaceLaw faces;
  HookLaw hooks;
  PusherLaw pushers;
  bool empty() const {
    return faces.points.empty() && hooks.rows.empty() && pushers.points.empty();
  }
  int face_count() const { return static_cast<int>(faces.points.size()); }
  int pusher_count() const { return static_cast<int>(pushers.points.size()); }
};

/// Points on a circle in the mating plane, evenly spaced. @param azimuth  of the first, y to z
std::vector<Eigen::Vector2d> make_circle(int count, double radius, double azimuth);

/// Opening of a hook's end that leaves the preload in every hook [m]. @pre faces and hooks
double find_preloaded_end(const HardDock& dock);

// ---------------------------------------------------------------- discrete state

enum class HookMode : int { kOpen = 1, kClosing = 2, kClosed = 3, kOpening = 4 };

struct HookRowState {
  HookMode mode = HookMode::kOpen;
  double since = 0.0;  ///< start of the ramp [s since the start of the run]
  double end = 0.0;    ///< where the ends stand while the row opens [m]
};

struct PusherState {
  bool on = true;
  double since = -kNever;  ///< start of the ramp [s]
  double share = 1.0;      ///< of the force, at the start of the ramp
};

/// Pose of D in C while the joint is rigid.
struct RigidJoint {
  bool on = false;
  Mat3<double> R = Mat3<double>::Identity();
  Vec3<double> p = Vec3<double>::Zero();
};

/// Values of the input `hard_dock.command`.
enum class HardDockCommand : int {
  kNone = 1,
  kCloseHooks,
  kOpenHooks,
  kPushersOn,
  kPushersOff,
  kJoin,
  kRelease
};
inline const ChoiceList kHardDockCommands = {
    {1, "none", ""},
    {2, "close_hooks", "as soon as the opening allows"},
    {3, "open_hooks", ""},
    {4, "pushers_on", ""},
    {5, "pushers_off", ""},
    {6, "join", "chaser, mechanism and target become one rigid body"},
    {7, "release", "the rigid joint opens"},
};

struct HardDockState {
  HardDockCommand command = HardDockCommand::kNone;  ///< of the host, read last
  std::array<HookRowState, kMaxHookRows> row;
  bool closes = false;  ///< rows close as soon as all hooks can
  PusherState pushers;
  bool wants_joint = false;  ///< to be rigid: asked for
  RigidJoint joint;
};

HardDockState make_start(const HardDock& dock);

// Commands, and what follows from them. @param t  [s since the start of the run]

void close_hooks(HardDockState& state);
void open_hooks(const HardDock& dock, double t, HardDockState& state);
void switch_pushers(const HardDock& dock, bool on, double t, HardDockState& state);

/// Do hooks wait for a smaller opening?
bool are_waiting(const HardDock& dock, const HardDockState& state);
/// Largest opening of a hook less the play [m]: falls through zero when waiting hooks can close.
template <class S>
S find_hook_distance(const HardDock& dock, const RelativeMotion<S>& motion);
/// Travel of the pushers that is left until the first one meets its surface (`to_touch`), and until
/// the first one has only its take-up left (`to_let_go`) [m]: where their force begins to change.
struct PusherTravel {
  double to_touch, to_let_go;
};
/// @pre pushers
PusherTravel find_pusher_travel(const PusherLaw& law, const RelativeMotion<double>& motion);
/// Rows that can close begin to; ramps that are over end. @param can_close  by the opening
/// @return whether a mode changed
bool update_hooks(const HardDock& dock, bool can_close, double t, HardDockState& state);
/// Next start or end of a ramp after t [s].
std::optional<double> find_next_ramp(const HardDock& dock, const HardDockState& state, double t);
/// Is a ramp going on at t?
bool is_ramping(const HardDock& dock, const HardDockState& state, double t);
int count_closed_hooks(const HardDock& dock, const HardDockState& state);

// ---------------------------------------------------------------- forces

template <class S>
struct HardDockResult {
  Wrench<S> on_passive;                 ///< about the origin of A, axes of A [N], [N m]
  S energy = S(0);                      ///< stored [J]
  S dissipation = S(0);                 ///< >= 0 [W]
  S work = S(0);                        ///< of the drives of hooks and pushers [W]
  S face_force = S(0);                  ///< sum, pressing [N]
  S pusher_force = S(0);                ///< sum [N]
  std::array<S, kMaxHooks> hook_force;  ///< tension [N], row by row
  HardDockResult() { hook_force.fill(S(0)); }
};

/// @param motion  of P relative to A, axes of A. No allocation.
template <class S>
void calc_hard_dock(const HardDock& dock, const HardDockState& state, const S& t,
                    const RelativeMotion<S>& motion, HardDockResult<S>& out);

/// How deep the faces are in each other at the deepest point [m]; below 0: they are apart.
double find_face_depth(const HardDock& dock, const RelativeMotion<double>& motion);

/// Lower bound of the distance to any force [m]; 0 while a hook is not open.
double find_free_opening(const HardDock& dock, const HardDockState& state,
                         const RelativeMotion<double>& motion);

/// How the wrench on P about the origin of A changes with the motion of P relative to A, axes of A
/// (contact/interface_tangent.hpp).
void add_hard_dock_tangent(const HardDock& dock, const HardDockState& state, double t,
                           const RelativeMotion<double>& motion, InterfaceTangent& tangent);

/// @throws ModelError for parameters out of range.
void check_hard_dock(const HardDock& dock);

}  // namespace dockloop
