// Choice of method, tolerances and inner step; see accuracy.hpp.
#include "sim/accuracy.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include "math/dock_assert.hpp"
#include "sim/accuracy_table.hpp"

namespace dockloop {
namespace {

/// Passive rings and other dockings were measured apart. So were bristles: loose tolerances let
/// them slip too late, which changes loads and costs more steps than tight ones.
const AccuracyTable& get_table(const DockingModel& model) {
  const bool is_passive = model.contact.rings && model.mechanism.model.elements.empty();
  if (model.layout.bristle_count > 0) {
    return is_passive ? kPassiveRingsWithBristles : kOthersWithBristles;
  }
  return is_passive ? kPassiveRings : kOthers;
}

/// Errors are relative to the motion and the loads of the docking, and both follow from the speed
/// of the approach. Without a target nothing is known of them. A vehicle at rest will be pulled.
double find_scale(const DockingModel& model, double speed) {
  constexpr double kUsual = 0.05, kLeast = 0.1;  // [m/s], [-]
  return model.present[kTarget] ? std::clamp(speed / kUsual, kLeast, 1.0) : 1.0;
}

/// Surfaces that stick slide slowly. The tolerance of velocities stays below the transition speed
/// of friction; else accepted errors shake the surfaces loose again and again.
double find_velocity_limit(const DockingModel& model) {
  constexpr double kShare = 0.5;
  double limit = std::numeric_limits<double>::infinity();
  if (!model.contact.has_surfaces()) return limit;
  for (const ContactLaw& law : model.contact.laws) {
    if (law.friction_model != 1 || law.friction_coefficient == 0.0) continue;
    limit = std::min(limit, kShare * law.friction_speed);
  }
  return limit;
}

/// The smallest relative tolerance that is chosen beyond the measured ones.
constexpr double kTightest = 2e-11;

/// Rows of one method: wanted error and tolerance, both fall from row to row.
struct Column {
  const AccuracyTable& table;
  size_t method;  ///< place in kCalibratedMethods
  size_t count;   ///< rows; further rows are not reached

  Column(const AccuracyTable& rows, size_t place) : table(rows), method(place), count(0) {
    while (count < table.size && table.row[count].rtol[method] > 0.0) ++count;
  }
  double error(size_t row) const { return table.row[row].error; }
  double rtol(size_t row) const { return table.row[row].rtol[method]; }
  double find_rtol(double wanted) const {
    const double last = error(count - 1), least = rtol(count - 1);
    // Nothing was measured there, but stabilised steps can be tighter, in proportion.
    if (wanted < last && kCalibratedMethods[method] == kStabilised) {
      return std::min(least, std::max(kTightest, least * wanted / last));
    }
    return interpolate(
        wanted, [this](size_t i) { return error(i); }, [this](size_t i) { return rtol(i); });
  }
  double find_error(double tolerance) const {
    return interpolate(
        tolerance, [this](size_t i) { return rtol(i); }, [this](size_t i) { return error(i); });
  }
  /// The smallest error that the method promises for a wanted one.
  double clamp(double wanted) const { return std::clamp(wanted, error(count - 1), error(0)); }

 private:
  /// Linear in the logarithms, constant outside.
  template <class From, class To>
  double interpolate(double value, const From& from, const To& to) const {
    if (value >= from(0)) return to(0);
    for (size_t i = 1; i < count; ++i) {
      const double a = from(i - 1), b = from(i);
      if (value < b) continue;
      return to(i - 1) * std::pow(to(i) / to(i - 1), std::log(value / a) / std::log(b / a));
    }
    return to(count - 1);
  }
};

/// Place of a method in the table, or its size.
size_t find_place(int method) {
  // `auto` takes stabilised steps at these tolerances, and others where they cost less.
  const int measured = method == kAuto ? kStabilised : method;
  const auto found = std::find(kCalibratedMethods.begin(), kCalibratedMethods.end(), measured);
  return static_cast<size_t>(found - kCalibratedMethods.begin());
}

/// The cheapest method for the expected communication step: of the loosest row that is tight
/// enough. If a tighter tolerance is stated, the row is one at which the method has this tolerance.
/// @param tolerance  of the host, 0: none
SolverMethod find_best(const Parameters& p, double tolerance, const AccuracyTable& table) {
  double stated = tolerance > 0.0 ? tolerance : 1.0;
  if (p.rtol != SolverSettings().rtol) stated = std::min(stated, p.rtol);
  const size_t step = p.coupling_expected_step < kLongStep ? 0 : 1;
  SolverMethod best = kStabilised;
  for (size_t i = 0; i < table.size; ++i) {
    const AccuracyRow& row = table.row[i];
    best = row.method[step];
    if (row.error <= p.accuracy && row.rtol[find_place(best)] <= stated) return best;
  }
  // No row is tight enough: stabilised steps still pay where they reach the wanted error.
  const Column stabilised(table, find_place(kStabilised));
  return stabilised.error(stabilised.count - 1) <= p.accuracy ? kStabilised : best;
}

/// Equal steps for real time. Regularised friction can become faster than any affordable explicit
/// step, as where legs reach their stops: linearly implicit steps are stable at any rate.
SolverMethod find_real_time_method(const DockingModel& model) {
  const std::vector<ContactLaw>& laws = model.contact.laws;
  const bool is_regularised = model.contact.has_surfaces() && model.layout.bristle_count == 0 &&
                              std::any_of(laws.begin(), laws.end(), [](const ContactLaw& law) {
                                return law.friction_coefficient > 0.0;
                              });
  return is_regularised ? kFixedRosenbrock : kFixedRk4;
}

/// The setting `name` is not explicit: its value may be chosen. Otherwise it is listed.
bool may_choose(const char* name, bool is_default, SolverChoice& choice) {
  if (is_default) return true;
  choice.stated += (choice.stated.empty() ? "solver." : ", solver.") + std::string(name);
  return false;
}

/// Tolerances of the method in use. A method without measured errors has those of the best one.
void choose_tolerances(const Parameters& p, double tolerance, const DockingModel& model,
                       double speed, SolverChoice& c) {
  const AccuracyTable& table = get_table(model);
  const SolverSettings defaults;
  const size_t place = find_place(find_method(c.method, needs_other_matrix(model))->method);
  const bool is_measured = place < kCalibratedMethods.size() && table.row[0].rtol[place] > 0.0 &&
                           p.model_level != kReference;
  const Column column(table, is_measured ? place : find_place(find_best(p, tolerance, table)));
  const double rtol = column.find_rtol(p.accuracy);
  if (may_choose("rtol", p.rtol == defaults.rtol, c)) c.rtol = rtol;
  const double scale = find_scale(model, speed);
  bool is_in_proportion = true;
  const auto choose = [&](const char* name, bool is_default, double per_rtol, double& value) {
    if (may_choose(name, is_default, c)) {
      value = per_rtol * c.rtol;
      c.atol_scale = scale;
    }
    is_in_proportion = is_in_proportion && value <= per_rtol * c.rtol;
  };
  choose("atol_position", p.atol_position == defaults.atol_position, scale * kAtolPosition,
         c.atol_position);
  const bool is_default_velocity = p.atol_velocity == defaults.atol_velocity;
  choose("atol_velocity", is_default_velocity, scale * kAtolVelocity, c.atol_velocity);
  if (is_default_velocity) c.atol_velocity = std::min(c.atol_velocity, find_velocity_limit(model));
  choose("atol_energy", p.atol_energy == defaults.atol_energy, scale * scale * kAtolEnergy,
         c.atol_energy);
  // A smaller tolerance of the host reduces all of them (DockingSim::Impl::make_loop).
  const double used = tolerance > 0.0 ? std::min(tolerance, c.rtol) : c.rtol;
  if (is_measured && is_in_proportion && used <= column.rtol(0)) {
    c.error_estimate = used == rtol ? column.clamp(p.accuracy) : column.find_error(used);
  }
}

template <class... Numbers>
std::string format(const char* pattern, Numbers... numbers) {
  char text[300];
  std::snprintf(text, sizeof text, pattern, numbers...);
  return text;
}

/// Free drift and the rigid joint. Their evaluations are estimated from those of the other times.
std::string describe_left_out_motion(const WorkDone& work) {
  const LeftOut& left = work.counters.left_out;
  const double passed = left.quiescent_time + left.joined_time, other = work.time - passed;
  std::string parts;
  if (left.quiescent_time > 0.0) {
    parts += format(
        "; inner steps for %.4g s of free drift with a quiescent mechanism (error of its "
        "coordinates at most %.2g m)",
        left.quiescent_time, work.place);
  }
  if (left.joined_time > 0.0) {
    parts += format("; relative motion for %.4g s with a rigid joint", left.joined_time);
  }
  const double made = static_cast<double>(work.counters.rate_evaluations);
  if (passed > 0.0 && other > 1e-9 * work.time) {
    parts += format(
        "; these times would need about %.2g evaluations at the mean rate of the other times, "
        "which needed %.0f",
        made / other * passed, made);
  }
  return parts;
}

/// What cannot be promised after a longer time than the measured dockings took.
std::string describe_long_motion(const WorkDone& work) {
  const double passed = work.counters.left_out.time_since_contact;
  if (!(work.accuracy > 0.0) || passed <= kMeasuredTime) return {};
  return format(
      ". The docking went on for %.4g s after first contact, the measured ones for at most %g s. "
      "Where surfaces rattle in their play, errors of late peaks and of the final motion can grow "
      "beyond accuracy; a second run (--estimate-error) shows them",
      passed, kMeasuredTime);
}

}  // namespace

void check_accuracy(double accuracy) {
  if (accuracy == kRealTime || accuracy >= 0.0) return;
  char text[200];
  std::snprintf(text, sizeof text,
                "accuracy is %.9g; it must be above 0 (wanted relative error), 0 (solver.* as they "
                "are) or -1 (real time)",
                accuracy);
  throw ModelError(text);
}

SolverChoice choose_solver(const Parameters& p, double tolerance, const DockingModel& model,
                           double speed) {
  SolverChoice c;
  static_cast<SolverSettings&>(c) = get_settings(p);
  c.method = find_used_method(p.solver_method);
  if (p.accuracy == 0.0) return c;
  const bool is_real_time = p.accuracy == kRealTime;
  // The form with multipliers has its own method.
  if (may_choose("method", p.solver_method == SolverSettings().method, c) &&
      p.model_level != kReference) {
    c.method =
        is_real_time ? find_real_time_method(model) : find_best(p, tolerance, get_table(model));
    if (c.method == kStabilised) c.method = kAuto;
  }
  if (find_method(c.method)->fixed_step) {
    c.needs_step = may_choose("step", p.step == SolverSettings().step, c) && is_real_time;
  } else if (!is_real_time) {
    choose_tolerances(p, tolerance, model, speed, c);
  }
  return c;
}

std::string describe_choice(const Parameters& p, const SolverChoice& c, const MethodFacts& method,
                            double tolerance, const DockingModel& model) {
  DOCK_ASSERT(p.accuracy != 0.0);
  const AccuracyTable& table = get_table(model);
  char text[400];
  if (method.fixed_step) {
    std::snprintf(text, sizeof text,
                  "accuracy = %.6g%s: solver.method %s with solver.step %.3g s; the cost of a step "
                  "is bounded, its error is not controlled",
                  p.accuracy, p.accuracy == kRealTime ? " (real-time)" : "", method.name, c.step);
  } else if (p.accuracy == kRealTime) {
    std::snprintf(text, sizeof text,
                  "accuracy = -1 (real-time): solver.method %s stays; the cost of a step is not "
                  "bounded",
                  method.name);
  } else {
    std::snprintf(text, sizeof text, "accuracy = %.6g: solver.method %s, solver.rtol %.3g",
                  p.accuracy, method.name, c.rtol);
  }
  std::string sentence = text;
  if (c.atol_scale < 1.0) {
    sentence += format(
        "; absolute tolerances of positions and velocities %.2g times the usual ones: "
        "a slow approach, or a start at rest",
        c.atol_scale);
  }
  if (c.error_estimate > 0.0) {
    std::snprintf(
        text, sizeof text,
        "; 98 %% of %d measured dockings had an error below %.3g with these tolerances or "
        "larger ones",
        table.dockings, c.error_estimate);
    sentence += text;
  } else if (!method.fixed_step && p.accuracy != kRealTime) {
    sentence += "; there is no measured error for these settings";
  }
  const double least = table.row[table.size - 1].error;
  if (p.accuracy > 0.0 && p.accuracy < least) {
    std::snprintf(text, sizeof text, "; no smaller error than %.3g was measured", least);
    sentence += text;
  }
  if (tolerance > 0.0 && tolerance < c.rtol && !method.fixed_step) {
    std::snprintf(text, sizeof text, "; the smaller tolerance of the host, %.3g, is used",
                  tolerance);
    sentence += text;
  }
  if (!c.stated.empty()) sentence += "; as stated: " + c.stated;
  if (p.model_level == kRigid || p.model_level == kMasslessLegs) {
    sentence += "; the error of model.level is not included: a run at level 3 (reduced) shows it";
  }
  return sentence;
}

std::string describe_forgotten(const Parameters& p) {
  const SolverSettings defaults;
  constexpr double kFar = 0.1;  // of the default: a digit more was wanted
  if (p.rtol > kFar * defaults.rtol) return {};
  std::string names;
  const auto note = [&](const char* name, double value, double usual, const char* unit) {
    if (value != usual) return;
    names += format("%ssolver.%s = %.3g %s", names.empty() ? "" : ", ", name, value, unit);
  };
  note("atol_position", p.atol_position, defaults.atol_position, "m");
  note("atol_velocity", p.atol_velocity, defaults.atol_velocity, "m/s");
  note("atol_energy", p.atol_energy, defaults.atol_energy, "J");
  if (names.empty()) return {};
  return format("solver.rtol = %.3g is tighter than usual, but ", p.rtol) + names +
         " stay as they are and limit the accuracy; set them too, or set accuracy, which chooses "
         "all of them";
}

std::string describe_left_out(const WorkDone& work) {
  const LeftOut& left = work.counters.left_out;
  std::string parts = describe_left_out_motion(work);
  if (work.pairs > 0 && left.booked_steps > 0) {
    const double near =
        static_cast<double>(left.near_pairs) / static_cast<double>(left.booked_steps);
    parts += format(
        "; at least %.1f of %d contact pairs on average, which were too far apart to touch "
        "(exact)",
        work.pairs - near, work.pairs);
  }
  if (work.read_points < work.points) {
    parts += format("; outputs at %.0f of %.0f communication points, where they were not read",
                    static_cast<double>(work.points - work.read_points),
                    static_cast<double>(work.points));
  }
  return "left out: " + (parts.empty() ? "nothing" : parts.substr(2)) + describe_long_motion(work);
}

}  // namespace dockloop
