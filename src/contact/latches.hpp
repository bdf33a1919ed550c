// Capture latches: a spring-loaded pawl on G catches a striker on P and then holds it.
//
// Latch i has its hook H at a point of G and its striker at a point of P. Its measure
// (LatchMeasure) gives s: s_x is the opening, rho = sqrt(s_y^2 + s_z^2) the lateral offset. The
// mode (open, held, releasing, spent) is discrete state that the integrator changes at the zero of
// an event function. Every force is the gradient of an energy or a power that is a square.
// Functions return the energy that an event dissipates. With play >= catch distance the force is
// zero on both sides of the catch, so there is no jump and a late detection costs nothing.
#pragma once

#include <array>
#include <vector>

#include "contact/contact_model.hpp"
#include "math/types.hpp"

namespace dockloop {

/// Parameters of one latch (defaults assumed).
struct LatchLaw {
  double pawl_range = 0.020;      ///< x_r: the pawl starts to push [m]
  double catch_distance = 0.004;  ///< x_c: the pawl has snapped in [m]
  double play = 0.005;            ///< x_p >= x_c: free opening of the held striker [m]
  double window = 0.025;          ///< w: lateral; the pawl force fades from w to 2 w [m]
  double guard = 0.030;           ///< a striker this far beyond the hook is not caught [m]
  double push_force = 20.0;       ///< F_l: peak of the pawl force [N]
  double hold_stiffness = 1e6;    ///< k_l [N/m]
  double hold_damping = 4.0;      ///< lambda_l [s/m]
  double hold_toe = 5e-5;         ///< parabolic start of the tension [m]
  bool releases_on_overload = false;
  double rated_load = 0.0;     ///< tension of the release on overload [N]
  double release_ramp = 0.05;  ///< the tension fades over this time [s]
};

/// The numbers of a latch that files and hosts may set.
inline constexpr LawNumber<LatchLaw> kLatchNumbers[] = {
    {"range", &LatchLaw::pawl_range, "m", Rule::kPositive, true,
     "Opening at which the pawl of this latch starts to push"},
    {"catch", &LatchLaw::catch_distance, "m", Rule::kPositive, true,
     "Opening at which this latch catches"},
    {"play", &LatchLaw::play, "m", Rule::kPositive, true,
     "Free opening of the striker that this latch holds"},
    {"window", &LatchLaw::window, "m", Rule::kPositive, true,
     "Lateral offset up to which this latch catches"},
    {"push_force", &LatchLaw::push_force, "N", Rule::kNotNegative, true,
     "Largest force of the pawl of this latch"},
    {"stiffness", &LatchLaw::hold_stiffness, "N/m", Rule::kPositive, true,
     "Stiffness of this latch while it holds"},
    {"damping", &LatchLaw::hold_damping, "s/m", Rule::kNotNegative, true,
     "Factor of the rate of stretch on the force of this latch"},
    {"release_ramp", &LatchLaw::release_ramp, "s", Rule::kPositive, false,
     "Time over which the force of this latch fades at release"},
    {"rated_load", &LatchLaw::rated_load, "N", Rule::kNotNegative, false,
     "Tension at which this latch releases, if it releases on overload"},
};

constexpr int kMaxLatches = 8;

enum class LatchMeasure : signed char {
  kActiveAxis,   ///< s = striker - hook in axes of G, as of the hooks of a guide ring
  kPassivePlane  ///< s_x from the hook to the plane across x of P through the striker; s_y, s_z
                 ///< from the origin of G to the x axis of P: pawls of a probe head, axes of P
};

struct Latch {
  LatchLaw law;
  Vec3<double> hook = Vec3<double>::Zero();     ///< axes of G [m]
  Vec3<double> striker = Vec3<double>::Zero();  ///< axes of P [m]
  LatchMeasure measure = LatchMeasure::kActiveAxis;
};

struct LatchSet {
  std::vector<Latch> latch;
  int required = 0;  ///< latches that hold when captured; 0 = all
  int count() const { return static_cast<int>(latch.size()); }
  bool is_capture(int held) const { return held > 0 && held >= (required ? required : count()); }
};

/// @throws ModelError for parameters out of range.
void check_latches(const LatchSet& set);

/// kSpent: released; ready again after the opening has exceeded the pawl range.
enum class LatchMode : int { kOpen = 1, kHeld = 2, kReleasing = 3, kSpent = 4 };

/// Discrete state of one latch.
struct LatchState {
  LatchMode mode = LatchMode::kOpen;
  double release_time = 0.0;  ///< start of the release [s], used in kReleasing only
};

template <class S>
struct LatchResult {
  Wrench<S> on_passive;                ///< about the origin of G, axes of G [N], [N m]
  S energy = S(0);                     ///< pawls and holds [J]
  S power = S(0);                      ///< dissipated by hold damping and release ramps, >= 0 [W]
  std::array<S, kMaxLatches> opening;  ///< s_x [m]
  std::array<S, kMaxLatches> lateral;  ///< rho [m]
  std::array<S, kMaxLatches> force;    ///< along x, > 0 pulls the sides together [N]
  std::array<S, kMaxLatches> event;    ///< <= 0: mode must change, see below (units differ by mode)
  LatchResult() {
    opening.fill(S(0));
    lateral.fill(S(0));
    force.fill(S(0));
    event.fill(S(1));
  }
};

/// Forces and event functions of all latches. On the open latch acts the gradient of E(s_x) W(rho):
/// a push apart F_l sin^2 between x_c and x_r, and sideways out where W falls from 1 at w to 0 at
/// 2 w. On the held one the tension k_l s(s_x - x_p) max(0, 1 + lambda_l s_x'), one-sided; while
/// releasing, times 1 - 3 u^2 + 2 u^3 with u from 0 to 1 over the ramp.
/// Events: open: striker inside the catch region (from the front or from the side); held:
/// relative reserve to the rated load; releasing: time left; spent: pawl range - s_x.
/// With kPassivePlane every force acts at the hook along x of P, or at the origin of G across it.
/// Limit: the latch holds along x only; lateral restraint is left to petals and rings.
/// @pre set.count() <= kMaxLatches. No allocation.
template <class S>
void calc_latches(const LatchSet& set, const LatchState* state, S t,
                  const RelativeMotion<S>& motion, LatchResult<S>& out);

/// What latch i measures: striker relative to hook, and its rate.
struct LatchMotion {
  Vec3<double> s, rate;  ///< [m], [m/s]
};
LatchMotion find_latch_motion(const LatchSet& set, int i, const RelativeMotion<double>& motion);

/// The event function of latch i is the largest of these conditions, along its axis and across. For
/// integrators that check signs at the ends of steps only.
std::array<double, 2> find_conditions(const LatchLaw& law, const LatchState& state,
                                      const LatchMotion& motion, double event);

/// Upper bound of the rate of the event function of a latch [1/s times its unit]; 0 = not known.
double find_event_speed(const LatchState& state, const LatchMotion& motion);

/// Was the event function of a latch below zero between one motion and another, h later? The path
/// is the cubic through both.
bool is_passed(const LatchLaw& law, const LatchState& state, const LatchMotion& from,
               const LatchMotion& to, double h);

/// Change the mode of latch i if that is due (event <= 0 within 1e-9, as a root finder leaves it).
/// @param passed  the change is due for any event function: it was below zero just before
/// @return energy dissipated by the change [J], which the caller adds to the latches; 0 if no
/// change is due.
double update_latch(const LatchSet& set, int i, double t, const RelativeMotion<double>& motion,
                    LatchState& state, bool passed = false);

/// Number of latches that hold.
int count_held(const LatchSet& set, const LatchState* states);

/// Release on command: a latch that holds lets go, an open one does not catch.
/// @return energy dissipated [J]
double release_latch(const LatchSet& set, int i, double t, const RelativeMotion<double>& motion,
                     LatchState& state);

}  // namespace dockloop
