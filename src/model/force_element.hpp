// Force elements as data: laws that act along one coordinate of a mechanism.
//
//   s = sum of ratio x joint coordinate,   f = sum over the laws,   tau of a joint += ratio f
//
// Formulas: mechanism/force_laws.hpp. The numbers of a law are listed once, by for_each_member()
// and for_each_entry(): the reader, the parameters of the FMU and the checks follow these lists.
// A force is positive when it increases s. Units: m and N, or rad and N m.
#pragma once

#include <algorithm>
#include <array>
#include <string>
#include <variant>
#include <vector>

#include "math/law_number.hpp"
#include "math/monotone_cubic.hpp"
#include "model/onset.hpp"

namespace dockloop {

constexpr double kUnlimited = 1e30;  ///< of a force or voltage without limit

/// One row of a table: start of a stage and its stiffness; coordinate and factor of an orifice.
using TableRow = std::array<double, 2>;

/// Staged spring: stiffness of stage i beyond its start. With a preload the first `take_up` of the
/// travel builds the preload up. One side: acts only beyond the first start, for s > rest (+1) or
/// s < rest (-1).
struct SpringLaw {
  static constexpr const char* kType = "spring";
  std::vector<TableRow> stages;
  double rest = 0.0, preload = 0.0, take_up = 0.0;
  double corner = 0.0;  ///< half width of the rounding between stages
  int side = 0;         ///< 0 both, +1, -1
};

/// The same force everywhere.
struct ConstantLaw {
  static constexpr const char* kType = "constant";
  double force = 0.0, rest = 0.0;
};

/// Damper: -(linear + quadratic |v|) v h(s); other figures for v < 0.
struct DamperLaw {
  static constexpr const char* kType = "damper";
  double linear = 0.0, quadratic = 0.0, linear_back = 0.0, quadratic_back = 0.0;
  double limit = kUnlimited;
  std::vector<TableRow> orifice;  ///< (s, h), h = 1 if empty
};

/// Electromagnetic brake: -slope v/(1 + (v/peak_rate)^2).
struct EddyLaw {
  static constexpr const char* kType = "eddy";
  double slope = 0.0, peak_rate = 0.0;
};

/// Friction brake with two levels; numbers that are 0 follow from the levels.
struct BrakeLaw {
  static constexpr const char* kType = "brake";
  double forward = 0.0, back = 0.0;  ///< levels for growing and falling s
  double engagement = 1.0;           ///< 0 open, 1 closed
  double load_share = 0.0;           ///< of the other laws of the element, added to the level
  double presliding = 3e-5;          ///< deflection of the bristle at the larger level
  double rate_cap = 0.01;            ///< v_b: bounds the decay rate while sliding
  double bristle_stiffness = 0.0, bristle_damping = 0.0, bristle_relaxation = 0.0, floor = 0.0;
  double friction_speed = 1e-3;  ///< of model 1
  int model = 2;                 ///< numbers as friction.model
  bool has_bristle() const { return model == 2; }
};

/// Electric motor on its own shaft, without inductance.
struct MotorLaw {
  static constexpr const char* kType = "motor";
  double constant = 0.0, resistance = 0.0, current_limit = 0.0;
  double voltage_limit = kUnlimited, corner = 0.0;
  double voltage = 0.0, current = 0.0;  ///< applied; the one in use depends on by_current
  bool by_current = false, commanded = false;
};

/// Rate drive with a braking profile.
struct DriveLaw {
  static constexpr const char* kType = "drive";
  double target = 0.0, speed = 0.0, acceleration = 0.0, deceleration = 0.0;
  double approach = 2e-4;  ///< distance over which the drive comes to rest at the target
  double gain = 0.0, limit = 0.0, corner = 0.0;
  bool commanded = false;
};

/// End stops at two coordinates; law of math/one_sided_spring.hpp.
struct StopLaw {
  static constexpr const char* kType = "stop";
  double lower = 0.0, upper = 0.0, stiffness = 0.0, damping = 0.0, toe = 0.0;
};

/// What a table says outside of its rows.
enum class Outside { kRefuse, kHold, kExtend };

/// Measured force over travel, and over rate: `factor` times the table at s - rest and v. Its rows
/// are no numbers of a list: they are as in the file during all runs.
struct TableLaw {
  static constexpr const char* kType = "table";
  double factor = 1.0, rest = 0.0;
  Outside outside = Outside::kRefuse, outside_rate = Outside::kRefuse;
  std::vector<double> travel;              ///< increases
  std::vector<double> rates{0.0};          ///< increase; one is 0
  std::vector<std::vector<double>> force;  ///< per rate, over the travel

  // Of the rows, by interpolate():
  MonotoneCubic elastic;               ///< at the rate 0: its integral is the energy
  std::vector<MonotoneCubic> viscous;  ///< per rate, less the elastic force
  void interpolate();
};

using ForceLaw = std::variant<SpringLaw, ConstantLaw, DamperLaw, EddyLaw, BrakeLaw, MotorLaw,
                              DriveLaw, StopLaw, TableLaw>;

/// f(name, number, rule, is_required, text) for every member of a law that is one number.
template <class F>
void for_each_member(SpringLaw& law, F&& f) {
  f("rest", law.rest, Rule::kAny, false, "Coordinate at which the spring is slack");
  f("preload", law.preload, Rule::kNotNegative, false, "Preload after the take-up");
  f("take_up", law.take_up, Rule::kNotNegative, false, "Travel that builds the preload up");
  f("corner", law.corner, Rule::kNotNegative, false, "Half width of the rounding between stages");
}
template <class F>
void for_each_member(ConstantLaw& law, F&& f) {
  f("force", law.force, Rule::kAny, true, "Force");
  f("rest", law.rest, Rule::kAny, false, "Coordinate at which the energy is zero");
}
template <class F>
void for_each_member(DamperLaw& law, F&& f) {
  f("linear", law.linear, Rule::kNotNegative, false, "Force per rate");
  f("quadratic", law.quadratic, Rule::kNotNegative, false, "Force per square of the rate");
  f("linear_back", law.linear_back, Rule::kNotNegative, false, "Force per rate, backwards");
  f("quadratic_back", law.quadratic_back, Rule::kNotNegative, false,
    "Force per square of the rate, backwards");
  f("limit", law.limit, Rule::kPositive, false, "Force that the damper approaches");
}
template <class F>
void for_each_member(EddyLaw& law, F&& f) {
  f("slope", law.slope, Rule::kNotNegative, true, "Force per rate at rest");
  f("peak_rate", law.peak_rate, Rule::kPositive, true, "Rate of the largest force");
}
template <class F>
void for_each_member(BrakeLaw& law, F&& f) {
  f("forward", law.forward, Rule::kNotNegative, true, "Level for a growing coordinate");
  f("back", law.back, Rule::kNotNegative, false, "Level for a falling coordinate");
  f("engagement", law.engagement, Rule::kShare, false, "Engagement, 0 open to 1 closed");
  f("load_share", law.load_share, Rule::kNotNegative, false,
    "Share of the other laws of the element that adds to the level");
  f("presliding", law.presliding, Rule::kPositive, false,
    "Deflection of the bristle at the larger level");
  f("rate_cap", law.rate_cap, Rule::kPositive, false, "Rate that bounds the decay of the bristle");
  f("bristle_stiffness", law.bristle_stiffness, Rule::kNotNegative, false,
    "Stiffness of the bristle, 0: from presliding");
  f("bristle_damping", law.bristle_damping, Rule::kNotNegative, false,
    "Damping of the bristle while it sticks, 0: from its stiffness");
  f("bristle_relaxation", law.bristle_relaxation, Rule::kNotNegative, false,
    "Relaxation of the bristle above the level, 0: from its stiffness");
  f("floor", law.floor, Rule::kNotNegative, false,
    "Least level in the decay of the bristle, 0: from the larger level");
  f("friction_speed", law.friction_speed, Rule::kPositive, false,
    "Transition rate of the regularised model");
}
template <class F>
void for_each_member(MotorLaw& law, F&& f) {
  f("constant", law.constant, Rule::kNotNegative, true, "Torque and back-EMF constant [N m/A]");
  f("resistance", law.resistance, Rule::kPositive, true, "Resistance [ohm]");
  f("current_limit", law.current_limit, Rule::kPositive, true, "Largest current [A]");
  f("voltage_limit", law.voltage_limit, Rule::kPositive, false, "Largest voltage [V]");
  f("corner", law.corner, Rule::kNotNegative, false, "Half width of the rounding at the limit [A]");
  f("voltage", law.voltage, Rule::kAny, false, "Applied voltage [V]");
  f("current", law.current, Rule::kAny, false, "Applied current [A]");
}
template <class F>
void for_each_member(DriveLaw& law, F&& f) {
  f("target", law.target, Rule::kAny, true, "Coordinate to reach");
  f("speed", law.speed, Rule::kPositive, true, "Largest rate");
  f("acceleration", law.acceleration, Rule::kPositive, true, "Rate of change of the rate");
  f("deceleration", law.deceleration, Rule::kPositive, false, "The same before the target");
  f("approach", law.approach, Rule::kPositive, false, "Distance of the final approach");
  f("gain", law.gain, Rule::kPositive, true, "Force per difference of rates");
  f("limit", law.limit, Rule::kPositive, true, "Largest force");
  f("corner", law.corner, Rule::kNotNegative, false, "Half width of the rounding at the limit");
}
template <class F>
void for_each_member(StopLaw& law, F&& f) {
  f("lower", law.lower, Rule::kAny, true, "Coordinate of the lower stop");
  f("upper", law.upper, Rule::kAny, true, "Coordinate of the upper stop");
  f("stiffness", law.stiffness, Rule::kPositive, true, "Stiffness of the stop");
  f("damping", law.damping, Rule::kNotNegative, false, "Factor of the rate on the elastic force");
  f("toe", law.toe, Rule::kPositive, true, "Depth over which the stiffness builds up");
}
template <class F>
void for_each_member(TableLaw& law, F&& f) {
  f("factor", law.factor, Rule::kAny, false, "Factor of the force of the table");
  f("rest", law.rest, Rule::kAny, false, "Coordinate at which the travel is 0");
}

/// f(name, number, rule, text) for every number of the table of a law.
template <class Law, class F>
void for_each_entry(Law&, F&&) {}
template <class F>
void for_each_entry(SpringLaw& law, F&& f) {
  for (size_t i = 0; i < law.stages.size(); ++i) {
    const std::string stage = "stage[" + std::to_string(i + 1) + "]";
    f(stage + ".start", law.stages[i][0], Rule::kNotNegative, "Travel at which the stage begins");
    f(stage + ".stiffness", law.stages[i][1], Rule::kNotNegative, "Stiffness of the stage");
  }
}
template <class F>
void for_each_entry(DamperLaw& law, F&& f) {
  for (size_t i = 0; i < law.orifice.size(); ++i) {
    const std::string row = "orifice[" + std::to_string(i + 1) + "]";
    f(row + ".position", law.orifice[i][0], Rule::kAny, "Coordinate of a row of the orifice");
    f(row + ".factor", law.orifice[i][1], Rule::kNotNegative, "Factor of the damping there");
  }
}

/// f(name, number, rule, text) for every number of a law.
template <class F>
void for_each_number(ForceLaw& law, F&& f) {
  std::visit(
      [&](auto& each) {
        for_each_member(each, [&](const char* name, double& number, Rule rule, bool,
                                  const char* text) { f(std::string(name), number, rule, text); });
        for_each_entry(each, f);
      },
      law);
}

/// What is wrong with the numbers of a law, as the rest of a sentence; empty if nothing is.
std::string find_fault(const ForceLaw& law);

/// Joint whose coordinate counts with a ratio.
struct ElementTerm {
  int body = 0;
  double ratio = 1.0;
};

struct ForceElement {
  std::string name;
  std::vector<ElementTerm> along;
  std::vector<ForceLaw> laws;
};

/// What a sequence has switched in a law. As long as it has switched nothing, the numbers of the
/// law hold.
struct LawSetting {
  enum class Drive : int { kAsStated, kOff, kRuns };
  double engagement = 1.0;           ///< of a brake, multiplies its own; or of an eddy brake
  Drive drive = Drive::kAsStated;    ///< kRuns: towards the target below
  bool is_held = false;              ///< a drive that runs keeps its place
  double since = 0.0;                ///< start of the run [s since the start]
  double target = 0.0, speed = 0.0;  ///< of the run, as in DriveLaw
  double acceleration = 0.0, deceleration = 0.0;
};

constexpr int kMaxUnderWay = 8;  ///< settings on their way to one law

/// Settings on their way to a law that a failure delays, the oldest first.
struct LateSettings {
  struct Entry {
    double arrival = 0.0;  ///< [s since the start]
    LawSetting setting;
  };
  int count = 0;
  std::array<Entry, kMaxUnderWay> entry;
};

constexpr double kLockStiffness = 5e7;  ///< of an elastic lock, if none is stated [N/m]

/// What holds an element where it was when a sequence locked it.
struct ElementLock {
  double stiffness = 0.0;  ///< 0: open
  double damping = 0.0;
  double place = 0.0;  ///< coordinate of the element that is held
  bool is_closed() const { return stiffness > 0.0; }
  /// Stored energy [J].
  template <class S>
  S find_energy(const S& coordinate) const {
    const S deflection = coordinate - S(place);
    return S(0.5 * stiffness) * deflection * deflection;
  }
};

/// What happens to a law, or to a whole element, during a run.
struct LawFailure {
  enum class Kind {
    kOff,     ///< the law fades out within 0.05 s
    kFactor,  ///< the same to `value`
    kJammed,  ///< an elastic lock of stiffness `value` holds the element
    kDelayed  ///< start and settings of a sequence reach the law `value` seconds later
  };
  int element = 0, law = 0;
  int number = 0;  ///< of the law, among the laws of all elements
  Kind kind = Kind::kOff;
  bool active = true;
  Onset onset;
  double value = 0.0;  ///< see Kind
};

inline const char* describe_type(const ForceLaw& law) {
  return std::visit([](const auto& each) { return each.kType; }, law);
}

/// Has the law a bristle, whose deflection is a state?
inline bool has_bristle(const ForceLaw& law) {
  const BrakeLaw* brake = std::get_if<BrakeLaw>(&law);
  return brake && brake->has_bristle();
}

/// Does the law do work on the mechanism?
inline bool is_powered(const ForceLaw& law) {
  return std::holds_alternative<MotorLaw>(law) || std::holds_alternative<DriveLaw>(law);
}

/// Has the law a start, or settings of a sequence, that a failure may delay?
inline bool takes_settings(const ForceLaw& law) {
  return is_powered(law) || std::holds_alternative<BrakeLaw>(law) ||
         std::holds_alternative<EddyLaw>(law);
}

/// Does an input replace the voltage, current or target of the law?
inline bool is_commanded(const ForceLaw& law) {
  const MotorLaw* motor = std::get_if<MotorLaw>(&law);
  const DriveLaw* drive = std::get_if<DriveLaw>(&law);
  return (motor && motor->commanded) || (drive && drive->commanded);
}

/// Next time after `now` at which a failure begins, or a motor or drive starts that it makes late
/// [s since the start]; infinite: none is known. @param entered  as of find_time(Onset)
double find_next_failure(const std::vector<LawFailure>& failures, const double* entered,
                         double now);

/// The element of each state of all elements: bristles of brakes, then locks of jammed elements.
std::vector<int> list_bristle_elements(const std::vector<ForceElement>& elements,
                                       const std::vector<LawFailure>& failures);
/// Their number.
int count_element_bristles(const std::vector<ForceElement>& elements,
                           const std::vector<LawFailure>& failures);

/// Number of laws of all elements.
int count_laws(const std::vector<ForceElement>& elements);

/// Per element what its commanded law has in the file: start values of the inputs.
std::vector<double> list_start_commands(const std::vector<ForceElement>& elements);

/// All numbers of all laws, in the order of for_each_number(); and back.
std::vector<double> get_element_numbers(const std::vector<ForceElement>& elements);
void put_element_numbers(const std::vector<double>& numbers, std::vector<ForceElement>& elements);

/// @throws ModelError naming element, law, number and limit
void check_elements(const std::vector<ForceElement>& elements);

}  // namespace dockloop
