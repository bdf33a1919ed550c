// The whole docking by every method of integration (solver.method).
// 1. all capture, and agree with an explicit run at tight tolerance: peak load, times of contact
// and
//    capture, pose at the end; energy and momentum add up;
// 2. every run repeats to the last bit, and a step that was refused leaves nothing behind;
// 3. where the legs are heavily damped (stiff), implicit methods need far fewer steps, and equal
//    implicit steps are stable where equal explicit ones are not;
// 4. numbers that stand for nothing are refused.
//
// Scene: idss_25t_350t, shortly before contact.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <tuple>

#include "sim/sim_state.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

constexpr double kEnd = 1.2;       ///< [s]; captured at 0.92
constexpr double kStiffEnd = 0.6;  ///< [s]; the largest load is over

std::shared_ptr<const Scene> stiff_scene() {
  Scene scene = short_ring_scene();
  for (Leg& leg : scene.mechanism.legs) leg.law->damping = 1e5;  // 100 times that of the scene
  return share(scene);
}

std::unique_ptr<DockingSim> start(const std::shared_ptr<const Scene>& scene, int method,
                                  double rtol = 1e-6) {
  auto sim = std::make_unique<DockingSim>(scene, FmiKind::kCoSimulation, get_comparison());
  sim->parameters().solver_method = method;
  sim->parameters().model_level = method == kDae ? kReference : kReduced;
  sim->initialise(0.0, rtol);
  return sim;
}

/// All tolerances a thousand times those of the scene.
std::unique_ptr<DockingSim> start_loosely(const std::shared_ptr<const Scene>& scene, int method) {
  auto sim = std::make_unique<DockingSim>(scene);
  Parameters& p = sim->parameters();
  p.solver_method = method;
  for (double* each : {&p.rtol, &p.atol_position, &p.atol_velocity, &p.atol_energy}) *each *= 1e3;
  sim->initialise(0.0, 0.0);
  return sim;
}

/// @return status of the first step that is refused, or of the last one
Status run(DockingSim& sim, double h = 0.01, double end = kEnd) {
  Status status;
  for (int i = 0; i < std::lround(end / h) && status.ok(); ++i) status = sim.step(i * h, h);
  return status;
}

void print(const char* name, const Outputs& out) {
  std::printf("%s: peak %.6g N, capture at %.7f s, %.0f steps, %.0f evaluations\n", name,
              out.capture_peak[Outputs::kCompression].value, out.time_of_capture, out.solver_steps,
              out.solver_rhs_evaluations);
}

/// Limits of the differences from the run at tight tolerance: about three times those measured.
struct MethodCase {
  int method;
  const char* name;
  double peak;  ///< relative
  double time;  ///< [s] of capture
  double pose;  ///< [m] at the end
};
void PrintTo(const MethodCase& c, std::ostream* out) { *out << c.name; }

class Methods : public ::testing::TestWithParam<MethodCase> {};

TEST_P(Methods, capture_as_a_tight_explicit_run_does) {
  static const Outputs expected = [] {
    const auto sim = start(share(short_ring_scene()), kExplicit, 1e-10);
    EXPECT_TRUE(run(*sim).ok());
    print("tight", sim->outputs());
    return sim->outputs();
  }();
  const auto sim = start(share(short_ring_scene()), GetParam().method);
  ASSERT_TRUE(run(*sim).ok()) << sim->status_text();
  const Outputs& out = sim->outputs();
  print(GetParam().name, out);
  EXPECT_TRUE(out.captured);
  EXPECT_EQ(out.outcome, expected.outcome);
  const double peak = expected.capture_peak[Outputs::kCompression].value;
  EXPECT_NEAR(out.capture_peak[Outputs::kCompression].value, peak, GetParam().peak * peak);
  EXPECT_NEAR(out.time_of_contact, expected.time_of_contact, GetParam().time);
  EXPECT_NEAR(out.time_of_capture, expected.time_of_capture, GetParam().time);
  const double pose = (out.relative_position - expected.relative_position).norm();
  EXPECT_LE(pose, GetParam().pose);
  std::printf(
      "  differences: peak %.1e, capture %.1e s, pose %.1e m; energy residual %.1e J, momentum "
      "residual %.1e\n",
      out.capture_peak[Outputs::kCompression].value / peak - 1.0,
      out.time_of_capture - expected.time_of_capture, pose, out.energy_residual,
      out.momentum_residual);
  EXPECT_LE(std::abs(out.energy_residual), 0.01 * expected.energy_dissipated);
  EXPECT_LE(out.momentum_residual, 1e-12);
}

TEST_P(Methods, repeat_to_the_last_bit_also_after_a_refused_step) {
  const auto scene = share(short_ring_scene());
  const auto sim = start(scene, GetParam().method), other = start(scene, GetParam().method);
  int refused = 0;
  constexpr int kSteps = 16;
  for (int i = 0; i < kSteps; ++i) {
    ASSERT_TRUE(sim->step(0.01 * i, 0.01).ok()) << sim->status_text();
    if (i % 7 == 1) {                                          // twice before contact, once in it
      other->inputs().vehicle[kChaser].force_ext.x() = 1e200;  // nothing finite comes of it
      refused += !other->step(0.01 * i, 0.03).ok();
      other->inputs().vehicle[kChaser].force_ext.x() = 0.0;
    }
    ASSERT_TRUE(other->step(0.01 * i, 0.01).ok()) << other->status_text();
    ASSERT_TRUE(same_bits(flatten(sim->outputs(), true), flatten(other->outputs(), true)))
        << "step " << i;
  }
  EXPECT_EQ(refused, 3);
}

INSTANTIATE_TEST_SUITE_P(All, Methods,
                         ::testing::Values(MethodCase{kExplicit, "explicit", 5e-6, 1e-6, 1e-8},
                                           MethodCase{kBdf, "bdf", 2e-5, 3e-6, 1e-5},
                                           MethodCase{kFixedRk4, "fixed_rk4", 1e-2, 1.1e-3, 1e-7},
                                           MethodCase{kStabilised, "stabilised", 5e-6, 1e-6, 1e-8},
                                           MethodCase{kRosenbrock, "rosenbrock", 2e-6, 1e-8, 1e-10},
                                           MethodCase{kFixedRosenbrock, "fixed_rosenbrock", 1e-2,
                                                      1.1e-3, 1e-7},
                                           MethodCase{kDae, "dae", 5e-6, 3e-6, 1e-5}),
                         [](const auto& c) { return std::string(c.param.name); });

TEST(StiffLegs, need_few_implicit_steps) {
  double steps[2];
  Outputs out[2];
  for (int i : {0, 1}) {
    const auto sim = start_loosely(stiff_scene(), i == 0 ? kExplicit : kRosenbrock);
    ASSERT_TRUE(run(*sim, 0.01, kStiffEnd).ok()) << sim->status_text();
    out[i] = sim->outputs();
    steps[i] = out[i].solver_steps;
    print(i == 0 ? "explicit" : "rosenbrock", out[i]);
  }
  EXPECT_GT(steps[0], 5.0 * steps[1]);
  EXPECT_GT(out[0].solver_rhs_evaluations, 1.5 * out[1].solver_rhs_evaluations);
  const double peak = out[0].capture_peak[Outputs::kCompression].value;
  EXPECT_NEAR(out[1].capture_peak[Outputs::kCompression].value, peak, 1e-4 * peak);
  EXPECT_LE((out[1].relative_position - out[0].relative_position).norm(), 1e-7);
}

TEST(StiffLegs, are_stable_with_equal_implicit_steps_only) {
  const auto reference = start(stiff_scene(), kBdf);
  ASSERT_TRUE(run(*reference, 0.01, kStiffEnd).ok()) << reference->status_text();
  const Outputs& expected = reference->outputs();
  const double peak = expected.capture_peak[Outputs::kCompression].value;
  const auto linear = start(stiff_scene(), kFixedRosenbrock);
  ASSERT_TRUE(run(*linear, 0.01, kStiffEnd).ok()) << linear->status_text();
  print("fixed_rosenbrock", linear->outputs());
  EXPECT_NEAR(linear->outputs().capture_peak[Outputs::kCompression].value, peak, 1e-4 * peak);
  EXPECT_LE((linear->outputs().relative_position - expected.relative_position).norm(), 1e-7);
  const auto explicit_ = start(stiff_scene(), kFixedRk4);
  EXPECT_FALSE(run(*explicit_, 0.01, kStiffEnd).ok())
      << "peak " << explicit_->outputs().capture_peak[Outputs::kCompression].value;
}

TEST(StiffLegs, are_crossed_in_long_communication_steps) {
  for (int method : {kBdf, kRosenbrock}) {
    const auto sim =
        method == kRosenbrock ? start_loosely(stiff_scene(), method) : start(stiff_scene(), method);
    ASSERT_TRUE(run(*sim, 0.6, kStiffEnd).ok()) << sim->status_text();
    print(find_method(method)->name, sim->outputs());
    EXPECT_EQ(sim->outputs().phase, 2) << "in contact, not yet captured";
    EXPECT_LT(sim->outputs().solver_steps, 1000.0);
  }
}

TEST(LooseTolerances, are_cheaper_with_linearly_implicit_steps) {
  constexpr double kStep = 0.4, kHeld = 4.0;  // [s]; latches hold from 0.9 s on
  const auto exact = start(share(short_ring_scene()), kExplicit, 1e-10);
  ASSERT_TRUE(run(*exact, kStep, kHeld).ok());
  const Outputs& expected = exact->outputs();
  const double peak = expected.capture_peak[Outputs::kCompression].value;
  double evaluations[2], off[2], pose[2];
  for (int i : {0, 1}) {
    const auto sim = start_loosely(share(short_ring_scene()), i == 0 ? kStabilised : kRosenbrock);
    ASSERT_TRUE(run(*sim, kStep, kHeld).ok()) << sim->status_text();
    const Outputs& out = sim->outputs();
    print(i == 0 ? "stabilised" : "rosenbrock", out);
    evaluations[i] = out.solver_rhs_evaluations;
    off[i] = std::abs(out.capture_peak[Outputs::kCompression].value / peak - 1.0);
    pose[i] = (out.relative_position - expected.relative_position).norm();
    std::printf("  differences: peak %.1e, pose %.1e m\n", off[i], pose[i]);
  }
  EXPECT_LE(off[1], 7e-5);
  EXPECT_LE(pose[1], 1.4e-6);
  EXPECT_GT(evaluations[0], 2.5 * evaluations[1]);
}

TEST(Auto, takes_linearly_implicit_steps_where_they_pay) {
  const auto scene = share(short_ring_scene());
  Scene changed = short_ring_scene();
  changed.contact.law.friction_speed = 5e-5;
  const auto steep = share(changed);
  changed.contact = ContactModel();
  const auto apart = share(changed);
  const auto count = [](const std::unique_ptr<DockingSim>& sim) {
    EXPECT_TRUE(run(*sim, 0.1, 0.3).ok()) << sim->status_text();
    return sim->outputs().solver_rhs_evaluations;
  };
  EXPECT_EQ(count(start_loosely(scene, kAuto)), count(start_loosely(scene, kRosenbrock)));
  EXPECT_NE(count(start_loosely(scene, kAuto)), count(start_loosely(scene, kStabilised)));
  EXPECT_EQ(count(start(steep, kAuto)), count(start(steep, kRosenbrock)));
  EXPECT_NE(count(start(steep, kAuto)), count(start(steep, kStabilised)));
  EXPECT_EQ(count(start(scene, kAuto)), count(start(scene, kStabilised)));
  EXPECT_NE(count(start(scene, kAuto)), count(start(scene, kRosenbrock)));
  EXPECT_EQ(count(start_loosely(apart, kAuto)), count(start_loosely(apart, kStabilised)));
}

TEST(Implicit, is_another_name_of_rosenbrock) {
  const auto scene = share(short_ring_scene());
  const auto sim = start_loosely(scene, kImplicit), other = start_loosely(scene, kRosenbrock);
  for (const auto& each : {sim.get(), other.get()}) {
    ASSERT_TRUE(run(*each, 0.1, 0.3).ok()) << each->status_text();
    EXPECT_EQ(each->outputs().solver_chosen_method, kRosenbrock);
  }
  EXPECT_TRUE(same_bits(flatten(sim->outputs(), true), flatten(other->outputs(), true)));
}

TEST(MethodsThatDoNotExist, are_refused_with_the_choice) {
  for (const auto& [method, form, reason] :
       {std::tuple{0, 3, "solver.method is 0; it must be 1 (auto)"},
        std::tuple{14, 3, "solver.method is 14; it must be 1 (auto)"},
        std::tuple{int(kDae), 4, "solver.dae_form is 4; it must be 1 (index 1)"}}) {
    ComparingSim sim(share(short_ring_scene()));
    sim.parameters().solver_method = method;
    sim.parameters().model_level = method == kDae ? kReference : kReduced;
    sim.parameters().dae_form = form;
    try {
      sim.initialise(0.0, 0.0);
      ADD_FAILURE() << method << " was accepted";
    } catch (const ModelError& error) {
      EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
    }
  }
}

/// Why a simulation does not start; empty if it does.
std::string find_reason(int method, int level, const Comparison* comparison) {
  DockingSim sim(share(short_ring_scene()), FmiKind::kCoSimulation, comparison);
  sim.parameters().solver_method = method;
  sim.parameters().model_level = level;
  try {
    sim.initialise(0.0, 0.0);
  } catch (const ModelError& error) {
    return error.what();
  }
  return "";
}

TEST(MethodsForComparison, are_refused_by_a_simulation_that_does_not_carry_them) {
  EXPECT_EQ(find_reason(kDae, kReduced, nullptr),
            "solver.method is 9 (dae), a method for comparison, which this build does not carry: "
            "take 1 (auto), 2 (explicit), 3 (implicit), 6 (bdf), 7 (fixed_rk4), 11 (stabilised), "
            "12 (rosenbrock) or 13 (fixed_rosenbrock), or compare methods with `dockloop trade`, "
            "which carries this one");
  EXPECT_EQ(find_reason(kDae, kReference, get_comparison()), "");
  EXPECT_EQ(find_reason(kAuto, kReference, nullptr).rfind("model.level is 4 (reference), a form"),
            0u);
}

TEST(MethodsNoLongerBuilt, keep_name_and_number_and_are_refused_with_the_method_to_take) {
  const std::tuple<int, const char*, SolverMethod> reserved[] = {
      {4, "imex", kRosenbrock},
      {5, "adams", kStabilised},
      {8, "fixed_implicit", kFixedRosenbrock},
      {10, "high_order", kStabilised}};
  size_t count = 0;
  for (const MethodFacts& m : list_methods()) count += m.carried == Carried::kNoLonger;
  EXPECT_EQ(count, std::size(reserved));
  for (const auto& [number, name, instead] : reserved) {
    EXPECT_EQ(find_choice(get_method_choices(), name), number);
    const std::string what = std::to_string(number) + " (" + name + ")";
    const std::string take = "; no longer built: take " + std::to_string(instead) + " (" +
                             find_method(instead)->name + ")";
    for (const Comparison* comparison :
         {get_comparison(), static_cast<const Comparison*>(nullptr)}) {
      const std::string reason = find_reason(number, kReduced, comparison);
      EXPECT_EQ(reason.rfind("solver.method is " + what + ", a method for comparison: ", 0), 0u)
          << reason;
      EXPECT_EQ(reason.find(take), reason.size() - take.size()) << reason;
    }
    EXPECT_EQ(find_reason(instead, kReduced, nullptr), "");
  }
}

TEST(MethodsForComparison, of_a_saved_state_are_refused_too_and_nothing_changes) {
  ComparingSim from(share(short_ring_scene()));
  from.parameters().model_level = kReference;
  from.initialise(0.0, 0.0);
  SavedSim saved;
  from.save(saved);
  DockingSim sim(from.shared_scene());
  sim.initialise(0.0, 0.0);
  ASSERT_TRUE(sim.step(0.0, 0.01).ok());
  const std::vector<double> before = flatten(sim.outputs(), true);
  EXPECT_THROW(sim.load(saved), ModelError);
  EXPECT_TRUE(same_bits(flatten(sim.outputs(), true), before));
}

}  // namespace
}  // namespace dockloop
