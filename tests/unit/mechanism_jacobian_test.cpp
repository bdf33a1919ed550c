// Exact Jacobians of the independent accelerations.
// 1. against central differences of sixth order in Extended: by coordinates, velocities and
// joint
//    forces, at several states of three mechanisms, base moving or not, with closed forms and by
//    Newton iteration alone;
// 2. closed forms and Newton closures give the same Jacobians: the derivative through a Newton
//    closure is exact, not merely converged; also on another branch than that of home;
// 3. forces that depend on the state enter: springs and dampers of six legs, base at rest or
//    floating;
// 4. no call allocates memory;
// 5. a body alone in space: the Jacobian by torques is the inverse of its inertia.
#include "mechanism/mechanism_jacobian.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "mechanism/joint_forces.hpp"
#include "unit/allocations.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using L = Extended;

constexpr double kDifferences = 6e-14;  // worst residual 5.7e-15 (planar_two_loop)
constexpr double kClosures = 4e-14;     // worst residual 3.8e-15 (crank_nested)
constexpr int kStates = 6;

template <class S>
BaseMotion<S> cast_base(const BaseMotion<double>& base) {
  return {base.w.cast<S>(), base.alpha.cast<S>(), base.a.cast<S>(), base.gravity.cast<S>()};
}

/// A mechanism at one state of a file, evaluated.
struct StateOfFile {
  StateOfFile(const json& document, int state, bool newton_only)
      : mechanism(read_mechanism(document.dump(), "file"), newton_only), data(mechanism) {
    const json& at = document["states"][state];
    data.tree.q = to_vector(at["q"]);
    data.tau = to_vector(at["tau"]);
    const VecX<double> v = to_vector(at["v_independent"]);
    for (int i = 0; i < v.size(); ++i) data.tree.v[mechanism.plan.ind_v[i]] = v[i];
    base.gravity = mechanism.model.gravity;
    base.w = to_vector(at["base_motion"]["angular_velocity"]);
    base.alpha = to_vector(at["base_motion"]["angular_acceleration"]);
    base.a = to_vector(at["base_motion"]["linear_acceleration"]);
    for (const json& load : at["external"]) {
      const int body = find_body(mechanism.model, load["body"], "test");
      data.tree.external[body].f = to_vector(load["force"]);
      data.tree.external[body].t = to_vector(load["moment"]);
    }
    evaluate();
  }
  void evaluate() {
    if (!calc_position(mechanism, data).ok()) throw ModelError("a state cannot be closed");
    calc_velocity(mechanism, base, data);
    calc_acceleration(mechanism, base, data);
  }
  AccelerationJacobian find_jacobian() const {
    AccelerationJacobian jacobian(mechanism);
    JacobianData work(mechanism);
    EXPECT_TRUE(calc_acceleration_jacobian(mechanism, base, data, work, jacobian).ok());
    return jacobian;
  }
  Mechanism mechanism;
  MechanismData<double> data;
  BaseMotion<double> base;
};

/// Central difference of the independent accelerations along one number of the state.
/// @param h          step; any serves for velocities and forces, in which they are quadratic and
///                   linear (without stops)
/// @param number     L&(MechanismData<L>&): the number that is varied
/// @param put_loads  void(MechanismData<L>&): forces that depend on the state
template <class Number, class PutLoads>
VecX<L> differentiate(const Mechanism& mechanism, const BaseMotion<double>& base,
                      const MechanismData<double>& at, L h, Number number, PutLoads put_loads) {
  const L weight[3] = {3.0L / 4, -3.0L / 20, 1.0L / 60};
  MechanismData<L> data(mechanism);
  const BaseMotion<L> moved = cast_base<L>(base);
  const auto evaluate = [&](L step) {
    data.tree.q = at.tree.q.cast<L>();
    data.tree.v = at.tree.v.cast<L>();
    data.tau = at.tau.cast<L>();
    for (size_t i = 0; i < data.tree.external.size(); ++i) {
      data.tree.external[i].f = at.tree.external[i].f.cast<L>();
      data.tree.external[i].t = at.tree.external[i].t.cast<L>();
    }
    number(data) += step;
    EXPECT_TRUE(calc_position(mechanism, data).ok());
    calc_velocity(mechanism, moved, data);
    put_loads(data);
    calc_acceleration(mechanism, moved, data);
    VecX<L> a(mechanism.plan.ind_v.size());
    for (int i = 0; i < a.size(); ++i) a[i] = data.vdot[mechanism.plan.ind_v[i]];
    return a;
  };
  VecX<L> slope = VecX<L>::Zero(mechanism.plan.ind_v.size());
  for (int s = 1; s <= 3; ++s) {
    slope += weight[s - 1] / h * (evaluate(s * h) - evaluate(-s * h));
  }
  return slope;
}

template <class PutLoads>
void compare_with_differences(const Mechanism& mechanism, const BaseMotion<double>& base,
                              const MechanismData<double>& at, PutLoads put_loads,
                              const AccelerationJacobian& jacobian, bool with_tau,
                              const std::string& where, Residual& residual) {
  MatX<L> dq(jacobian.dq.rows(), jacobian.dq.cols()), dv(jacobian.dv.rows(), jacobian.dv.cols()),
      dtau(jacobian.dtau.rows(), jacobian.dtau.cols());
  for (int j = 0; j < dq.cols(); ++j) {
    dq.col(j) = differentiate(
        mechanism, base, at, 2e-4L,
        [&](MechanismData<L>& d) -> L& { return d.tree.q[mechanism.plan.ind_q[j]]; }, put_loads);
  }
  for (int j = 0; j < dv.cols(); ++j) {
    dv.col(j) = differentiate(
        mechanism, base, at, 0.5L,
        [&](MechanismData<L>& d) -> L& { return d.tree.v[mechanism.plan.ind_v[j]]; }, put_loads);
  }
  residual.add(find_relative_error(jacobian.dq, dq), where + " by coordinates");
  residual.add(find_relative_error(jacobian.dv, dv), where + " by velocities");
  if (!with_tau) return;
  for (int j = 0; j < dtau.cols(); ++j) {
    dtau.col(j) = differentiate(
        mechanism, base, at, 0.5L, [&](MechanismData<L>& d) -> L& { return d.tau[j]; }, put_loads);
  }
  residual.add(find_relative_error(jacobian.dtau, dtau), where + " by forces");
}

class MechanismJacobian : public ::testing::TestWithParam<const char*> {
 protected:
  json document = json::parse(read_test_file(std::string(GetParam()) + ".json"));
};

TEST_P(MechanismJacobian, is_that_of_central_differences) {
  const auto held = [](MechanismData<L>&) {};
  for (const bool newton_only : {false, true}) {
    Residual residual;
    for (int n = 0; n < kStates; ++n) {
      const StateOfFile state(document, n, newton_only);
      compare_with_differences(state.mechanism, state.base, state.data, held, state.find_jacobian(),
                               true, "state " + std::to_string(n + 1), residual);
    }
    EXPECT_RESIDUAL_BELOW(residual, kDifferences) << (newton_only ? ", Newton" : ", closed form");
  }
}

INSTANTIATE_TEST_SUITE_P(files, MechanismJacobian,
                         ::testing::Values("hexapod_r2p1r3", "crank_nested", "planar_two_loop"),
                         [](const ::testing::TestParamInfo<const char*>& at) {
                           return std::string(at.param);
                         });

int count_closed_forms(const Mechanism& mechanism) {
  const std::vector<LoopBlock>& blocks = mechanism.plan.blocks;
  return static_cast<int>(std::count_if(blocks.begin(), blocks.end(), [](const LoopBlock& block) {
    return block.form() != nullptr;
  }));
}

TEST(MechanismJacobianClosures, newton_gives_what_closed_forms_give) {
  Residual residual;
  for (const char* file : {"hexapod_r2p1r3", "crank_nested"}) {
    const json document = json::parse(read_test_file(std::string(file) + ".json"));
    for (int n = 0; n < kStates; ++n) {
      const std::string where = file + std::string(" state ") + std::to_string(n + 1);
      const StateOfFile closed_form(document, n, false), newton(document, n, true);
      EXPECT_GE(count_closed_forms(closed_form.mechanism), 3);
      EXPECT_EQ(count_closed_forms(newton.mechanism), 0);
      const AccelerationJacobian a = closed_form.find_jacobian(), b = newton.find_jacobian();
      residual.add(find_relative_error(b.dq, a.dq), where + " by coordinates");
      residual.add(find_relative_error(b.dv, a.dv), where + " by velocities");
      residual.add(find_relative_error(b.dtau, a.dtau), where + " by forces");
    }
  }
  EXPECT_RESIDUAL_BELOW(residual, kClosures);
}

TEST(MechanismJacobianClosures, are_on_the_branch_of_the_pose_not_on_that_of_home) {
  // A mechanism may have moved through a pose where branches meet: put the first leg on another.
  for (const char* file : {"hexapod_r2p1r3", "planar_two_loop"}) {
    const json document = json::parse(read_test_file(std::string(file) + ".json"));
    const StateOfFile home(document, 0, false);
    StateOfFile other(document, 0, false), newton(document, 0, true);
    other.data.loops.block[0].branch.elbow *= -1;
    other.evaluate();
    newton.data.tree.q = other.data.tree.q;
    newton.evaluate();
    const AccelerationJacobian a = newton.find_jacobian(), b = other.find_jacobian();
    EXPECT_GT((home.find_jacobian().dq - a.dq).norm(), 0.01 * a.dq.norm()) << "the same branch";
    Residual residual;
    residual.add(find_relative_error(b.dq, a.dq), file + std::string(" by coordinates"));
    residual.add(find_relative_error(b.dv, a.dv), file + std::string(" by velocities"));
    EXPECT_RESIDUAL_BELOW(residual, kClosures);
  }
}

TEST(MechanismJacobianForces, springs_and_dampers_of_the_legs_enter) {
  const std::string file = std::string(DOCKLOOP_MODELS) + "/mechanisms/hexapod_bench.json";
  std::ifstream stream(file);
  ASSERT_TRUE(stream.good());
  const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  VehicleBody vehicle;
  vehicle.mass = 200;
  vehicle.com = Vec3<double>(0.1, 0, -0.2);
  vehicle.inertia = Vec3<double>(30, 40, 50).asDiagonal();
  const MechanismModel model = read_mechanism(text, file);
  for (const bool floating : {false, true}) {
    Mechanism mechanism(floating ? attach_vehicle(model, vehicle, Pose<double>()) : model);
    close_home(mechanism, file);
    MechanismData<double> data(mechanism);
    for (int i : mechanism.plan.ind_bodies) {
      const Body& body = mechanism.model.bodies[i];
      data.tree.q.segment<3>(body.q_index) += Vec3<double>(0.02, -0.03, 0.01);
      data.tree.q.segment<4>(body.q_index + 3) = quat_exp<double>(Vec3<double>(0.1, -0.06, 0.2));
      data.tree.v.segment<6>(body.v_index) << 0.1, -0.2, 0.05, 0.3, 0.1, -0.2;
    }
    const BaseMotion<double> base;
    const auto make_loads = [&](auto scalar) {
      using S = decltype(scalar);
      const VecX<S> zero = VecX<S>::Zero(static_cast<int>(model.forces.size()));
      return [&mechanism, command = zero, force = zero](MechanismData<S>& d) mutable {
        d.tau.setZero();
        calc_joint_forces<S>(mechanism.model, d.tree.q, d.tree.v, command, force, d.tau);
      };
    };
    ASSERT_TRUE(calc_position(mechanism, data).ok());
    calc_velocity(mechanism, base, data);
    make_loads(0.0)(data);
    calc_acceleration(mechanism, base, data);

    AccelerationJacobian jacobian(mechanism), held(mechanism);
    JacobianData work(mechanism);
    ASSERT_TRUE(
        calc_acceleration_jacobian(mechanism, base, data, make_loads(Derivative(0)), work, jacobian)
            .ok());
    ASSERT_TRUE(calc_acceleration_jacobian(mechanism, base, data, work, held).ok());
    EXPECT_GT((jacobian.dq - held.dq).norm(), jacobian.dq.norm() / 2) << "stiffness rules here";
    Residual residual;
    compare_with_differences(mechanism, base, data, make_loads(L(0)), jacobian, false,
                             floating ? "floating" : "base at rest", residual);
    EXPECT_RESIDUAL_BELOW(residual, kDifferences);
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(MechanismJacobianMemory, is_not_allocated_by_the_call) {
  for (const char* file : {"hexapod_r2p1r3", "crank_nested"}) {
    const StateOfFile state(json::parse(read_test_file(std::string(file) + ".json")), 0, false);
    AccelerationJacobian jacobian(state.mechanism);
    JacobianData work(state.mechanism);
    const long count = count_allocations([&] {
      calc_acceleration_jacobian(state.mechanism, state.base, state.data, work, jacobian);
    });
    EXPECT_GT(jacobian.dq.norm(), 0.0);
    EXPECT_EQ(count, 0) << file;
  }
}
#endif

TEST(MechanismJacobianBody, alone_is_the_inverse_of_its_mass_and_inertia) {
  const Mechanism mechanism(read_mechanism(
      R"({"name": "body", "bodies": [{"name": "body", "parent": "base", "joint": {"type": "free"},
          "mass": 4, "inertia": [[1, 0, 0], [0, 2, 0], [0, 0, 8]]}], "loops": []})",
      "body.json"));
  MechanismData<double> data(mechanism);
  data.tree.q << 1, 2, 3, 1, 0, 0, 0;
  data.tree.v << 0, 0, 0, 0.5, 0, 0.25;
  const BaseMotion<double> base;
  ASSERT_TRUE(calc_position(mechanism, data).ok());
  calc_velocity(mechanism, base, data);
  calc_acceleration(mechanism, base, data);
  AccelerationJacobian jacobian(mechanism);
  JacobianData work(mechanism);
  ASSERT_TRUE(calc_acceleration_jacobian(mechanism, base, data, work, jacobian).ok());
  VecX<double> inverse(6);
  inverse << 0.25, 0.25, 0.25, 1, 0.5, 0.125;
  EXPECT_LE((jacobian.dtau - MatX<double>(inverse.asDiagonal())).norm(), 1e-15);
  // Euler: 2 w2' = (8 - 1) w3 w1.
  EXPECT_NEAR(jacobian.dv(4, 3), 3.5 * 0.25, 1e-15);
  EXPECT_NEAR(jacobian.dv(4, 5), 3.5 * 0.5, 1e-15);
  EXPECT_LE(jacobian.dq.norm(), 1e-15) << "in free space no place or attitude differs";
}

}  // namespace
}  // namespace dockloop
