// Linearly implicit steps: Rodas4P2 (G. Steinebach, Improvement of Rosenbrock-Wanner method RODASP,
// Progress in Differential-Algebraic Equations II, Springer 2020), order 4(3), six stages,
// L-stable.
//
// No iteration: each stage solves one linear system, and all stages share one matrix,
//
//   (1/(h gamma) - A) u_i = f(t + c_i h, y0 + sum a_ij u_j) + (1/h) sum C_ij u_j + h d_i f_t
//   y1 = y0 + sum a_6j u_j + u_6,   estimated error u_6
//
// A need not be the Jacobian (Stepper::Problem::Matrix): the order is 2 with any A, even zero, and
// 4 with the exact one. What matters is that A knows the stiff parts. A sum that w'f and w'A leave
// alone (a momentum) is kept to rounding: w'u_i is zero too.
//
// Dense output is a cubic, with s from 0 to 1:
//
//   y(s) = (1 - s) y0 + s y1 + s (1 - s) (p + s q)
//
// With the rates at both ends it has order 4. But rates hold the error of the state times the
// stiffness, and inside a long step this polynomial is false. The method's own has order 3 and no
// rates: p = sum H_1j u_j, q = sum H_2j u_j. It serves where the two differ by more than kFalse.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "integrate/one_step_solver.hpp"

namespace dockloop {
namespace {

constexpr int kStages = 6;
constexpr double kGamma = 0.25;
/// Rows of the lower triangles. Row 6 of a is row 5 and a one.
constexpr double kA[kStages][kStages] = {
    {},
    {3.0},
    {0.906377755268814, -0.189707390391685},
    {3.758617027739064, 1.161741776019525, -0.849258085312803},
    {7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775},
    {7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775, 1.0}};
constexpr double kC[kStages][kStages] = {
    {},
    {-12.0},
    {-6.354581592719008, 0.338972550544623},
    {-8.575016317114033, -7.606483992117508, 12.22499765012482},
    {-5.888975457523102, -8.15739661784182, 24.805546872612922, 12.79040151279698},
    {-4.408651676063871, -6.692003137674639, 24.625568527593117, 16.627521966636085,
     -5.714285714285718}};
constexpr std::array<double, kStages> kStageTime = {0.0, 0.75, 0.321448134013046, 0.519745732277726,
                                                    1.0, 1.0};
constexpr std::array<double, kStages> kSlope = {0.25, -0.5, -0.189532918363016, 0.085612108792769,
                                                0.0,  0.0};

constexpr double kH[2][kStages] = {{-5.323528268423303, -10.042123754867493, 17.175254928256965,
                                    -5.079931171878093, -0.016185991706112, 0.0},
                                   {6.984505741529879, 6.914061169603662, -0.849178943070653,
                                    18.104410789349338, -3.516963011559032, 0.0}};

constexpr double kFalse = 3.0;  ///< difference of the two polynomials [tolerances]

class RosenbrockSolver : public OneStepSolver {
 public:
  RosenbrockSolver(System& system, bool adapts)
      : OneStepSolver(system, !adapts, kGrowth),
        stages_(static_cast<size_t>(stride_) * kStages, 0.0) {
    for (auto* x : {&first_, &last_, &slope_, &sum_}) {
      x->assign(static_cast<size_t>(stride_), 0.0);
    }
  }

  void set_known(const Stepper::Known& known) override {
    if (known.rates) std::copy_n(known.rates, size_, first_.begin());
    rated_ = known.rates != nullptr;
    last_error_ = known.last_error;
  }
  bool interpolate(double t, N_Vector y) override;
  bool find_slope(double t, double* slope) override;

 private:
  static constexpr double kSafety = 0.9, kGrowth = 5.0, kLeastShrink = 0.1;
  static constexpr double kProportional = 0.7 / 4.0, kIntegral = 0.3 / 4.0;
  static constexpr double kLeastError = 1e-3;  ///< errors below it say nothing of the next step

  double* get_stage(int i) { return stages_.data() + static_cast<size_t>(i) * stride_; }
  double* get_first_rates() override { return first_.data(); }
  void continue_from_end() override { std::swap(first_, last_); }
  bool prepare(double room) override;
  bool calc_end(double h) override;
  bool find_error(double, double& error) override {
    error = find_mean(get_stage(kStages - 1));
    return true;
  }
  bool calc_last_rates(double h) override { return calc_rates(t_ + h, end_.data(), last_.data()); }
  double find_shrink(double error) const override;
  double find_factor(double error) override;
  bool build_matrix();
  bool find_time_slope(double h);
  bool factorise(double g);
  void add_up(int stage, double h);
  double find_first_step(double room) const;
  /// p and q of a state, and of the method's own polynomial.
  std::array<double, 2> find_bends(int i) const;
  std::array<double, 2> find_own_bends(int i) const;
  void choose_bends();

  std::vector<double> stages_;         // u, one stage after another
  std::vector<double> first_, last_;   // rates at the start and at the end of the step
  std::vector<double> slope_;          // of the rates over time, at the start
  std::vector<double> sum_;            // of the stages, by a row of C/h
  double g_ = 0.0;                     // of the present factors [s]
  bool sloped_ = false;                // slope_ counts
  bool chosen_ = false, own_ = false;  // dense output of the last step: chosen; the method's own
};

bool RosenbrockSolver::prepare(double room) {
  if (!build_matrix()) return false;
  if (!(h_ > 0.0)) h_ = find_first_step(room);
  return find_time_slope(std::min(h_, room));
}

/// @pre the rates at the start have been evaluated last
bool RosenbrockSolver::build_matrix() {
  if (!system_.problem.matrix.build || system_.idle) return true;
  int cost = 0;
  const int said = system_.note(system_.problem.matrix.build(t_, start_.data(), cost));
  system_.evaluations += cost;
  return said == 0;
}

/// From a difference so short that rates linear in time lose no more than half their digits.
bool RosenbrockSolver::find_time_slope(double h) {
  const std::function<bool()>& depends = system_.problem.depends_on_time;
  sloped_ = !system_.idle && (!depends || depends());
  if (!sloped_) return true;
  constexpr double kShort = 1e-4, kRounding = 1e-9;
  const double later = t_ + std::max(kShort * h, kRounding * std::abs(t_));
  if (!calc_rates(later, start_.data(), slope_.data())) return false;
  for (int i = 0; i < size_; ++i) slope_[i] = (slope_[i] - first_[i]) / (later - t_);
  return true;
}

bool RosenbrockSolver::factorise(double g) {
  g_ = g;
  const auto& factor = system_.problem.matrix.factor;
  return !factor || system_.idle || factor(g);
}

/// end_ = start_ + a u, sum_ = C u/h, of the stages before this one.
void RosenbrockSolver::add_up(int stage, double h) {
  std::array<double, kStages> c;
  for (int j = 0; j < stage; ++j) c[j] = kC[stage][j] / h;
  std::fill(sum_.begin(), sum_.end(), 0.0);
  functions_.add_up(kA[stage], stages_.data(), stage, stride_, 1.0, start_.data(), end_.data());
  functions_.add_up(c.data(), stages_.data(), stage, stride_, 1.0, sum_.data(), sum_.data());
}

/// @pre matrix and time slope of the start
bool RosenbrockSolver::calc_end(double h) {
  chosen_ = false;
  if (!factorise(kGamma * h)) return false;
  const auto& solve = system_.problem.matrix.solve;
  for (int stage = 0; stage < kStages; ++stage) {
    double* u = get_stage(stage);
    if (stage == 0) {
      std::copy_n(first_.data(), size_, u);
    } else {
      add_up(stage, h);
      if (!calc_rates(t_ + kStageTime[stage] * h, end_.data(), u)) return false;
      for (int i = 0; i < size_; ++i) u[i] += sum_[i];
    }
    if (sloped_ && kSlope[stage] != 0.0) {
      const double weight = h * kSlope[stage];
      for (int i = 0; i < size_; ++i) u[i] += weight * slope_[i];
    }
    if (solve && !system_.idle) {
      solve(u);
    } else {
      for (int i = 0; i < size_; ++i) u[i] *= g_;
    }
  }
  const double* error = get_stage(kStages - 1);
  for (int i = 0; i < size_; ++i) end_[i] += error[i];
  if (fixed_) last_error_ = find_mean(error);
  return true;
}

double RosenbrockSolver::find_shrink(double error) const {
  const double shrink = kSafety * std::pow(error, -0.25);
  return shrink > kLeastShrink ? std::min(0.9, shrink) : kLeastShrink;
}

double RosenbrockSolver::find_factor(double error) {
  const double now = std::max(error, kLeastError), before = last_error_;
  last_error_ = now;
  return kSafety * std::pow(now, -kProportional) * std::pow(before, kIntegral);
}

/// Without a proposal: the time in which the state changes by one percent, or a hundredth of the
/// room. Stiffness does not matter, and error control does the rest.
double RosenbrockSolver::find_first_step(double room) const {
  const double y = std::max(1.0, find_mean(start_.data())), speed = find_mean(first_.data());
  return 0.01 * (y < room * speed ? y / speed : room);
}

std::array<double, 2> RosenbrockSolver::find_own_bends(int i) const {
  std::array<double, 2> bends = {};
  for (int j = 0; j < kStages; ++j) {
    const double u = stages_[static_cast<size_t>(j) * stride_ + i];
    bends[0] += kH[0][j] * u;
    bends[1] += kH[1][j] * u;
  }
  return bends;
}

std::array<double, 2> RosenbrockSolver::find_bends(int i) const {
  if (own_) return find_own_bends(i);
  const double way = end_[i] - start_[i];
  const double p = made_ * first_[i] - way;
  return {p, way - made_ * last_[i] - p};
}

/// @pre at_end_
void RosenbrockSolver::choose_bends() {
  if (chosen_) return;
  chosen_ = true;
  own_ = false;
  double difference = 0.0;
  for (const double s : {0.25, 0.75}) {
    for (int i = 0; i < size_; ++i) {
      const auto [p, q] = find_bends(i);
      const auto [own_p, own_q] = find_own_bends(i);
      sum_[i] = s * (1.0 - s) * (p - own_p + s * (q - own_q));
    }
    difference = std::max(difference, find_mean(sum_.data()));
  }
  own_ = !(difference <= kFalse);
}

bool RosenbrockSolver::interpolate(double t, N_Vector y) {
  if (fixed_) return true;  // no roots are looked for
  if (!at_end_) return false;
  choose_bends();
  const double s = 1.0 - (t_ - t) / made_, r = 1.0 - s;
  for (int i = 0; i < size_; ++i) {
    const auto [p, q] = find_bends(i);
    NV_Ith_S(y, i) = start_[i] + s * (end_[i] - start_[i] + r * (p + s * q));
  }
  return true;
}

bool RosenbrockSolver::find_slope(double t, double* slope) {
  if (fixed_ || !at_end_) return false;
  choose_bends();
  const double s = 1.0 - (t_ - t) / made_, r = 1.0 - s;
  for (int i = 0; i < size_; ++i) {
    const auto [p, q] = find_bends(i);
    slope[i] = (end_[i] - start_[i] + (r - s) * (p + s * q) + s * r * q) / made_;
  }
  return true;
}

}  // namespace

std::unique_ptr<Solver> make_rosenbrock_solver(System& system, bool adapts) {
  return std::make_unique<RosenbrockSolver>(system, adapts);
}

}  // namespace dockloop
