// Inner steps that end after the communication point.
// 1. motion, events, peaks and work are the same with any communication step, and whether outputs
//    are read or not;
// 2. saved and restored at any point, also inside a step and across changes of inputs and
//    parameters, a run gives the bits of the uninterrupted run;
// 3. a host that changes its inputs at every point pays little more than without steps ahead;
// 4. momentum is kept to rounding, and the mean loads are its changes;
// 5. a derivative inside a step is the slope of what is read there;
// 6. nothing is allocated.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "sim/sim_state.hpp"
#include "sim/solver_methods.hpp"
#include "unit/allocations.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

constexpr double kEnd = 4.0;  // [s]; contact after 0.1 s, capture soon after

std::unique_ptr<DockingSim> make_sim_ahead(SolverMethod method) {
  constexpr double rtol = 1e-3;
  static const auto scene = share(short_ring_scene());
  auto sim = std::make_unique<DockingSim>(scene);
  Parameters& p = sim->parameters();
  p.solver_method = method;
  const double looser = rtol / p.rtol;
  p.rtol = rtol;
  p.atol_position *= looser;
  p.atol_velocity *= looser;
  p.atol_energy *= looser;
  sim->initialise(0.0, 0.0);
  return sim;
}

/// @return simulation at kEnd. @param reads  after every step
std::unique_ptr<DockingSim> run_ahead(SolverMethod method, double h, bool reads) {
  auto sim = make_sim_ahead(method);
  const int count = static_cast<int>(std::lround(kEnd / h));
  for (int i = 0; i < count; ++i) {
    const Status status = sim->step(i * h, h);
    EXPECT_TRUE(status.ok()) << sim->status_text();
    if (reads) {
      sim->outputs();
      EXPECT_TRUE(sim->update(OutputGroup::kStateVector).ok());
      EXPECT_TRUE(sim->calc_time_derivative().ok());
    }
  }
  return sim;
}

/// Of linearly implicit steps, of both explicit pairs.
class RunningAhead : public testing::TestWithParam<SolverMethod> {};

INSTANTIATE_TEST_SUITE_P(methods, RunningAhead,
                         testing::Values(kRosenbrock, kStabilised, kExplicit),
                         [](const auto& of) { return std::string(find_method(of.param)->name); });

bool is_pending(const DockingSim& sim) {
  SavedSim saved;
  sim.save(saved);
  return saved.snapshot.state.ahead.pending;
}

TEST_P(RunningAhead, gives_the_same_motion_with_any_communication_step) {
  const auto coarse = run_ahead(GetParam(), 1.0, false);
  const Outputs& expected = coarse->outputs();
  ASSERT_TRUE(expected.captured);
  for (const double h : {0.25, 0.01, 0.003125}) {
    const auto sim = run_ahead(GetParam(), h, false);
    const Outputs& out = sim->outputs();
    EXPECT_TRUE(is_pending(*sim));
    EXPECT_NEAR(out.time_of_contact, expected.time_of_contact, 1e-12);
    EXPECT_NEAR(out.time_of_capture, expected.time_of_capture, 1e-12);
    EXPECT_LT((out.relative_position - expected.relative_position).norm(), 1e-11);
    EXPECT_LT((out.relative_velocity - expected.relative_velocity).norm(), 1e-10);
    for (size_t i = 0; i < out.capture_peak.size(); ++i) {
      EXPECT_NEAR(out.capture_peak[i].value, expected.capture_peak[i].value,
                  1e-9 * expected.capture_peak[i].value);
    }
    EXPECT_EQ(out.solver_rhs_evaluations, expected.solver_rhs_evaluations);
    EXPECT_EQ(out.solver_steps, expected.solver_steps);
    EXPECT_LT(out.momentum_residual, 1e-13);
  }
}

TEST_P(RunningAhead, gives_the_same_bits_whether_outputs_are_read_or_not) {
  const auto silent = run_ahead(GetParam(), 0.01, false), read = run_ahead(GetParam(), 0.01, true);
  EXPECT_TRUE(same_bits(flatten(silent->outputs(), true), flatten(read->outputs(), true)));
}

// ---------------------------------------------------------------- saving and restoring

/// What a host does in its i-th step; must depend on the step only.
struct RandomStep {
  double h, force;
  bool is_new_force, is_new_friction;
};

std::vector<RandomStep> draw_steps(int count) {
  std::mt19937_64 random(19);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  std::vector<RandomStep> steps;
  for (int i = 0; i < count; ++i) {
    const double h = 0.02 * any(random) * any(random) + 1e-5;
    steps.push_back({h, 20.0 * any(random), any(random) < 0.1, any(random) < 0.02});
  }
  // Now and then at many points in a row.
  for (int i = 300; i < 340; ++i) steps[static_cast<size_t>(i)].is_new_force = true;
  return steps;
}

double make_random_step(DockingSim& sim, double t, const RandomStep& step) {
  if (step.is_new_force) sim.inputs().vehicle[kChaser].force_ext.y() = step.force;
  if (step.is_new_friction) {
    sim.parameters().friction_coefficient = 0.1 + 1e-3 * step.force;
    sim.adopt_tunables();
  }
  const Status status = sim.step(t, step.h);
  EXPECT_TRUE(status.ok()) << sim.status_text();
  return t + step.h;
}

TEST_P(RunningAhead, is_saved_and_restored_bit_for_bit_at_any_point) {
  const std::vector<RandomStep> steps = draw_steps(1000);
  auto sim = make_sim_ahead(GetParam()), other = make_sim_ahead(GetParam());
  const auto reference = make_sim_ahead(GetParam());
  SavedSim saved;
  int pending = 0;
  double t = 0.0;
  for (size_t i = 0; i < steps.size(); ++i) {
    sim->save(saved);
    pending += saved.snapshot.state.ahead.pending;
    if (i % 3 == 0) {  // something else first
      sim->inputs().vehicle[kTarget].torque_ext.x() += 1.0;
      ASSERT_TRUE(sim->step(t, 0.3 * steps[i].h).ok());
      sim->outputs();
      sim->load(saved);
    } else if (i % 3 == 1) {
      other->load(i % 2 ? saved : through_bytes(saved));
      std::swap(sim, other);
    }
    make_random_step(*sim, t, steps[i]);
    t = make_random_step(*reference, t, steps[i]);
    ASSERT_TRUE(same_bits(flatten(sim->outputs(), true), flatten(reference->outputs(), true)))
        << "step " << i << ", t = " << t;
  }
  EXPECT_TRUE(reference->outputs().captured);
  EXPECT_GT(pending, 600);
}

TEST_P(RunningAhead, goes_back_to_the_point_inside_a_step_after_a_refusal) {
  const auto sim = make_sim_ahead(GetParam()), reference = make_sim_ahead(GetParam());
  for (int i = 0; i < 200; ++i) {
    const double t = 0.01 * i;
    EXPECT_FALSE(sim->step(t, -1.0).ok());
    ASSERT_TRUE(sim->step(t, 0.01).ok());
    ASSERT_TRUE(reference->step(t, 0.01).ok());
    ASSERT_TRUE(same_bits(flatten(sim->outputs()), flatten(reference->outputs()))) << i;
  }
}

// ---------------------------------------------------------------- changes of inputs

/// Evaluations of a run in steps of 10 ms in which a force changes at every n-th point.
double count_evaluations(int every) {
  const auto sim = make_sim_ahead(kRosenbrock);
  for (int i = 0; i < 400; ++i) {
    if (i % every == 0) {
      sim->inputs().vehicle[kChaser].force_ext.y() = 1e-6 * (i / every % 2);
    }
    EXPECT_TRUE(sim->step(0.01 * i, 0.01).ok());
  }
  return sim->outputs().solver_rhs_evaluations;
}

TEST(RunningAheadOfImplicitSteps, costs_little_where_inputs_change_at_every_point) {
  const double never = count_evaluations(1000), always = count_evaluations(1);
  RecordProperty("never", static_cast<int>(never));
  RecordProperty("always", static_cast<int>(always));
  std::printf("%.0f evaluations without changes, %.0f with one at every point\n", never, always);
  EXPECT_LT(never, 0.6 * always);
  for (const int every : {2, 3, 4, 7}) {
    const double here = count_evaluations(every);
    std::printf("%.0f at every %d points\n", here, every);
    EXPECT_LT(here, 1.1 * always) << every;
  }
}

// ---------------------------------------------------------------- what is read

TEST_P(RunningAhead, mean_loads_are_the_changes_of_momentum) {
  const auto sim = make_sim_ahead(GetParam());
  const double mass = sim->parameters().vehicle[kTarget].mass;
  const Vec3<double> start = sim->outputs().vehicle[kTarget].velocity;
  Vec3<double> impulse = Vec3<double>::Zero();
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(sim->step(0.01 * i, 0.01).ok());
    impulse += 0.01 * sim->outputs().vehicle[kTarget].force_mean;
  }
  const Vec3<double> change = mass * (sim->outputs().vehicle[kTarget].velocity - start);
  EXPECT_GT(change.norm(), 100.0);
  EXPECT_LT((impulse - change).norm(), 1e-5 * change.norm());
}

TEST_P(RunningAhead, derivatives_are_the_slopes_of_outputs) {
  const auto sim = make_sim_ahead(GetParam());
  constexpr double kShort = 1e-6;
  double t = 0.0;
  int inside = 0;
  for (int i = 0; i < 60; ++i) {
    ASSERT_TRUE(sim->step(t, 0.02).ok());
    t += 0.02;
    ASSERT_TRUE(sim->calc_time_derivative().ok());
    Outputs& out = sim->output_storage();
    int place = 0, found = -1;
    for_each_value(static_cast<OutputValues<double>&>(out), [&](double& cell) {
      if (&cell == &out.relative_position[0]) found = place;
      ++place;
    });
    ASSERT_GE(found, 0);
    const double slope = sim->output_derivative(found),
                 before = sim->outputs().relative_position.x();
    SavedSim saved;
    sim->save(saved);
    inside += saved.snapshot.state.ahead.pending;
    ASSERT_TRUE(sim->step(t, kShort).ok());
    const double after = sim->outputs().relative_position.x();
    EXPECT_NEAR((after - before) / kShort, slope, 1e-5) << t;
    t += kShort;
  }
  EXPECT_GT(inside, 30);
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST_P(RunningAhead, allocates_nothing) {
  const auto sim = make_sim_ahead(GetParam());
  const long allocated = count_allocations([&] {
    for (int i = 0; i < 300; ++i) {
      if (i % 10 == 0) sim->inputs().vehicle[kChaser].force_ext.y() = i % 20;
      ASSERT_TRUE(sim->step(0.01 * i, 0.01).ok());
      sim->outputs();
    }
  });
  EXPECT_EQ(allocated, 0);
  EXPECT_TRUE(sim->outputs().captured);
}
#endif

}  // namespace
}  // namespace dockloop
