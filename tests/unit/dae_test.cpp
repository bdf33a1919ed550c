// The form of the equations in which multipliers hold the loops (solver.method 9), against the
// reduced form.
// 1. states, accelerations and cut forces of the reduced form leave no residual in any of the three
//    forms: ring with its legs, cranks nested in cranks, two vehicles in contact;
// 2. in the Jacobian multipliers enter as the residual says;
// 3. a swinging ring comes nearer to the reduced form the tighter the tolerance; what its cuts open
//    by is reported, and does what the form promises: index 1 drifts, Baumgarte bounds it,
//    positions held by multipliers of their own stay within the tolerance of the iteration;
// 4. a communication point closes the loops: nothing that has drifted is carried on.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "compare/unreduced_model.hpp"
#include "unit/random_docking.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

constexpr DaeForm kForms[] = {DaeForm::kIndex1, DaeForm::kBaumgarte, DaeForm::kStabilised};

/// A mechanism alone on a base that does not move.
Scene bench(const std::string& file) {
  Scene scene = read_test_scene("scene_slider_crank.json");
  std::ifstream text(file);
  scene.mechanism = read_mechanism({std::istreambuf_iterator<char>(text), {}}, file);
  scene.joint_starts.clear();
  return scene;
}

/// As modelDescription/scenes/hexapod_bench.toml.
Scene hexapod_scene() {
  Scene scene = bench(std::string(DOCKLOOP_MODELS) + "/mechanisms/hexapod_bench.json");
  scene.capture_body_start.displacement = Vec3<double>(0.02, -0.015, -0.03);
  scene.capture_body_start.rotation_vector = Vec3<double>(0.03, -0.02, 0.04);
  scene.capture_body_start.velocity = Vec3<double>(0.05, 0.02, -0.10);
  scene.capture_body_start.angular_velocity = Vec3<double>(0.01, 0.02, -0.015);
  return scene;
}

/// Largest residual relative to what the row is a difference of, and of the columns of multipliers.
void add_residuals(Docking& docking, DaeForm form, Residual& worst, Residual& columns) {
  docking.evaluate();
  const UnreducedModel reference(docking.model, form);
  UnreducedData data(docking.model, reference);
  const int n = reference.size;
  VecX<double> z(n), zdot(n), residual(n), other(n), start(n);
  std::copy(docking.y.begin(), docking.y.end(), z.data());
  std::copy(docking.ydot.begin(), docking.ydot.end(), zdot.data());
  complete_unreduced_state(docking.model, reference, docking.data, z.data(), zdot.data());
  const auto calc = [&](const VecX<double>& at, const VecX<double>& rates, VecX<double>& into) {
    ASSERT_TRUE(calc_unreduced_residual(docking.model, reference, docking.discrete, docking.memory,
                                        docking.loads, docking.t, at.data(), rates.data(),
                                        into.data(), data)
                    .ok());
  };
  VecX<double> free = z;
  free.segment(reference.lambda, reference.cuts).setZero();
  calc(free, VecX<double>::Zero(n), start);
  calc(z, zdot, residual);
  EXPECT_GT(z.segment(reference.lambda, reference.cuts).cwiseAbs().maxCoeff(), 0.01);
  for (int i = 0; i < n; ++i) {
    const double scale = std::max({std::abs(start[i]), std::abs(zdot[i]), 1.0});
    worst.add(residual[i] / scale, "form " + std::to_string(int(form)) + ", row " +
                                       std::to_string(i) + " of " + std::to_string(n));
  }
  MatX<double> J(n, n);
  const VecX<double> nominal = VecX<double>::Ones(n);
  ASSERT_TRUE(calc_unreduced_jacobian(docking.model, reference, docking.discrete, docking.memory,
                                      docking.loads, docking.t, 1e3, z.data(), zdot.data(),
                                      residual.data(), nominal, J.data(), data)
                  .ok());
  for (int k = reference.lambda; k < n; ++k) {
    VecX<double> moved = z;
    moved[k] += 1.0;
    calc(moved, zdot, other);
    columns.add((other - residual - J.col(k)).cwiseAbs().maxCoeff() / J.col(k).norm(),
                "column " + std::to_string(k));
  }
}

TEST(ReferenceForm, has_no_residual_where_the_reduced_form_is) {
  Residual worst, columns;
  TestRandom random(91);
  const Scene crank = bench(std::string(DOCKLOOP_TEST_DATA) + "/crank_nested.json");
  const auto states = nlohmann::json::parse(read_test_file("crank_nested.json"))["states"];
  for (const auto& state : states) {
    Docking docking(crank);
    TreeData<double>& tree = docking.data.mechanism.tree;
    tree.q = to_vector(state["q"]);
    for (int i = 0; i < tree.v.size(); ++i) tree.v[i] = random.uniform(-0.3, 0.3);
    get_mechanism_state(docking.model, tree, docking.y.data());
    docking.loads.gravity = random.vector(3.0);
    for (DaeForm form : kForms) add_residuals(docking, form, worst, columns);
  }
  Scene swinging = hexapod_scene();
  for (const bool floats : {false, true}) {
    swinging.motion[kChaser] = floats ? Motion::kFree : Motion::kFixed;
    Docking docking(swinging);
    docking.set_random_state(random, 0.0);
    docking.set_random_loads(random);
    for (DaeForm form : kForms) add_residuals(docking, form, worst, columns);
  }
  int trial = 0;
  for (const char* scene : {"scene_ring.json", "scene_ring.json", "scene_fingers.json"}) {
    const int friction_model = 1 + trial++ % 2;
    Docking docking(read_test_scene(scene), friction_model);
    docking.set_random_state(random, 2e-4);
    docking.set_random_loads(random);
    for (DaeForm form : kForms) add_residuals(docking, form, worst, columns);
    EXPECT_GT(docking.data.on_passive.f.norm(), 1.0) << "must be in contact";
  }
  std::printf("residual %.1e (%s), columns %.1e\n", worst.value, worst.where.c_str(),
              columns.value);
  EXPECT_RESIDUAL_BELOW(worst, 1e-10);
  EXPECT_RESIDUAL_BELOW(columns, 1e-10);
}

/// One second of the ring in one step.
Outputs swing(const Scene& scene, int method, DaeForm form, double rtol) {
  ComparingSim sim(share(scene));
  Parameters& p = sim.parameters();
  p.solver_method = method;
  p.model_level = method == kDae ? kReference : kReduced;
  p.dae_form = static_cast<int>(form);
  p.rtol = rtol;
  p.atol_position = p.atol_velocity = 1e-2 * rtol;
  p.atol_energy = rtol;
  sim.initialise(0.0, 0.0);
  EXPECT_TRUE(sim.step(0.0, 1.0).ok()) << sim.status_text();
  return sim.outputs();
}

TEST(ReferenceForm, comes_near_the_reduced_form_and_tells_how_far_loops_open) {
  const Scene scene = hexapod_scene();
  const Outputs expected = swing(scene, kExplicit, DaeForm::kStabilised, 1e-12);
  double gap[3][2], error[3][2];
  for (int form = 0; form < 3; ++form) {
    for (int i : {0, 1}) {
      const Outputs out = swing(scene, kDae, kForms[form], i == 0 ? 1e-5 : 1e-8);
      error[form][i] = (out.ring_position - expected.ring_position).norm();
      gap[form][i] = out.solver_closure_residual;
      std::printf("form %d, rtol %g: error %.1e m, gap %.1e m, %.0f steps, %.0f evaluations\n",
                  form + 1, i == 0 ? 1e-5 : 1e-8, error[form][i], gap[form][i], out.solver_steps,
                  out.solver_rhs_evaluations);
    }
    EXPECT_LT(error[form][0], 1e-6) << form;
    EXPECT_LT(error[form][1], 3e-9) << form;
    EXPECT_LT(error[form][1], 0.05 * error[form][0]) << form;
  }
  // Loose tolerance: what the forms do to the same steps.
  EXPECT_GT(gap[0][0], 1e-7) << "index 1 must drift";
  EXPECT_LT(gap[1][0], 0.5 * gap[0][0]) << "Baumgarte holds it back";
  EXPECT_LT(gap[2][0], 0.5 * gap[0][0]);
  // Tight: index 1 and Baumgarte open by their errors, the stabilised form by what the iteration
  // leaves over.
  EXPECT_GT(gap[0][1], 10.0 * gap[1][1]);
  EXPECT_GT(gap[1][1], 10.0 * gap[2][1]);
  EXPECT_LT(gap[2][1], 1e-11);
}

TEST(ReferenceForm, begins_closed_at_every_communication_point) {
  ComparingSim sim(share(hexapod_scene()));
  sim.parameters().model_level = kReference;
  sim.parameters().dae_form = static_cast<int>(DaeForm::kIndex1);
  sim.parameters().rtol = 1e-5;
  sim.initialise(0.0, 0.0);
  double largest = 0.0;
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(sim.step(0.01 * i, 0.01).ok()) << sim.status_text();
    largest = std::max(largest, sim.outputs().solver_closure_residual);
  }
  const double whole = swing(hexapod_scene(), kDae, DaeForm::kIndex1, 1e-5).solver_closure_residual;
  std::printf("largest gap in steps of 0.01 s %.1e m, of 1 s %.1e m\n", largest, whole);
  EXPECT_GT(largest, 1e-15);
  EXPECT_LT(largest, 0.1 * whole);
}

}  // namespace
}  // namespace dockloop
