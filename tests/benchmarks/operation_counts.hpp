// Counts the arithmetic operations of one evaluation of a mechanism, phase by phase.
//
// `Counted` is a double that counts what is done with it. The algorithms of the core are templates
// that the library holds for its own scalars only; their definitions (*_body.hpp) are therefore
// included here, with the list of scalars replaced by this one.
//
// An operation is + - * / or a call of sqrt, sin, cos, atan2. Sign changes, abs, floor, comparisons
// and copies are not counted. An operation is *trivial* if a symbolic program would fold it away:
// x + 0, x - 0, x 0, x 1, x (-1), 0/x, x/1. What is left then still holds common sub-expressions.
#pragma once

#define DOCK_INSTANTIATE_FOR_SCALARS(X) X(Counted)

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace dockloop {

struct OperationCount {
  long all = 0, trivial = 0;
  long left() const { return all - trivial; }
  OperationCount& operator+=(const OperationCount& other) {
    all += other.all;
    trivial += other.trivial;
    return *this;
  }
};

/// A double that counts.
struct Counted {
  double value;
  inline static OperationCount count;

  Counted() = default;
  template <class T, class = std::enable_if_t<std::is_arithmetic_v<T>>>
  Counted(T number) : value(static_cast<double>(number)) {}
  explicit operator double() const { return value; }

  static Counted result(double value, bool trivial = false) {
    count += {1, trivial ? 1 : 0};
    return Counted(value);
  }
  bool is_unit() const { return value == 1.0 || value == -1.0; }

  Counted operator-() const { return Counted(-value); }
  friend Counted operator+(const Counted& a, const Counted& b) {
    return result(a.value + b.value, a.value == 0.0 || b.value == 0.0);
  }
  friend Counted operator-(const Counted& a, const Counted& b) {
    return result(a.value - b.value, a.value == 0.0 || b.value == 0.0);
  }
  friend Counted operator*(const Counted& a, const Counted& b) {
    return result(a.value * b.value,
                  a.value == 0.0 || b.value == 0.0 || a.is_unit() || b.is_unit());
  }
  friend Counted operator/(const Counted& a, const Counted& b) {
    return result(a.value / b.value, a.value == 0.0 || b.is_unit());
  }
  Counted& operator+=(const Counted& b) { return *this = *this + b; }
  Counted& operator-=(const Counted& b) { return *this = *this - b; }
  Counted& operator*=(const Counted& b) { return *this = *this * b; }
  Counted& operator/=(const Counted& b) { return *this = *this / b; }

  friend bool operator==(const Counted& a, const Counted& b) { return a.value == b.value; }
  friend bool operator!=(const Counted& a, const Counted& b) { return a.value != b.value; }
  friend bool operator<(const Counted& a, const Counted& b) { return a.value < b.value; }
  friend bool operator<=(const Counted& a, const Counted& b) { return a.value <= b.value; }
  friend bool operator>(const Counted& a, const Counted& b) { return a.value > b.value; }
  friend bool operator>=(const Counted& a, const Counted& b) { return a.value >= b.value; }

  friend Counted sqrt(const Counted& a) { return result(std::sqrt(a.value)); }
  friend Counted sin(const Counted& a) { return result(std::sin(a.value)); }
  friend Counted cos(const Counted& a) { return result(std::cos(a.value)); }
  friend Counted atan2(const Counted& y, const Counted& x) {
    return result(std::atan2(y.value, x.value));
  }
  friend Counted abs(const Counted& a) { return Counted(std::abs(a.value)); }
  friend Counted floor(const Counted& a) { return Counted(std::floor(a.value)); }
  friend double to_double(const Counted& a) { return a.value; }
};

}  // namespace dockloop

template <>
struct std::numeric_limits<dockloop::Counted> : std::numeric_limits<double> {};

template <>
struct Eigen::NumTraits<dockloop::Counted> : Eigen::GenericNumTraits<dockloop::Counted> {
  using Real = dockloop::Counted;
  using NonInteger = dockloop::Counted;
  using Nested = dockloop::Counted;
  using Literal = double;
  enum { IsComplex = 0, IsInteger = 0, IsSigned = 1, RequireInitialization = 0 };
};

#include "benchmarks/closed_mechanism.hpp"
#include "loops/closed_form_body.hpp"
#include "loops/leg_geometry_body.hpp"
#include "loops/leg_platforms_body.hpp"
#include "loops/loop_equations_body.hpp"
#include "loops/loop_position_body.hpp"
#include "loops/loop_reduction_body.hpp"
#include "mechanism/mechanism_dynamics_body.hpp"
#include "tree/tree_body.hpp"

namespace dockloop {

struct Phase {
  std::string name;
  OperationCount count;
};

/// A mechanism at a state in which no coordinate, velocity or joint force is special.
class CountedEvaluation {
 public:
  CountedEvaluation(const std::string& file, bool base_moves)
      : mechanism(read_closed_mechanism(file)), data(mechanism), exact(mechanism) {
    const auto next = [this](double bound) {  // a fixed sequence without round numbers
      phase_ += 1.0;
      return bound * std::sin(1.7 * phase_ * phase_ + 0.4);
    };
    for (int i : mechanism.plan.ind_bodies) {
      const Body& body = mechanism.model.bodies[i];
      if (body.joint != JointType::kFree) {
        exact.tree.q[body.q_index] += next(0.03);
        continue;
      }
      for (int j = 0; j < 3; ++j) exact.tree.q[body.q_index + j] += next(0.03);
      const Vec4<double> turn =
          quat_exp<double>(Vec3<double>(0.11 + next(0.02), -0.07 + next(0.02), 0.05 + next(0.02)));
      exact.tree.q.segment<4>(body.q_index + 3) =
          quat_multiply<double>(turn, exact.tree.q.segment<4>(body.q_index + 3));
    }
    for (int i : mechanism.plan.ind_v) exact.tree.v[i] = 0.02 + next(0.1);
    for (int i = 0; i < mechanism.model.nv; ++i) exact.tau[i] = 0.3 + next(4.0);
    exact_base.gravity = mechanism.model.gravity;
    if (base_moves) {
      for (Vec3<double>* x : {&exact_base.w, &exact_base.alpha, &exact_base.a}) {
        *x = Vec3<double>(0.2 + next(0.1), -0.3 + next(0.1), 0.1 + next(0.05));
      }
    }
    if (!calc_position(mechanism, exact, Need::kState).ok())
      throw ModelError(file + " cannot be closed");
    calc_velocity(mechanism, exact_base, exact);
    calc_acceleration(mechanism, exact_base, exact);
    calc_reactions(mechanism, exact_base, kBase, exact);
    // The same for the counting scalar.
    data.tree.v = exact.tree.v.cast<Counted>();
    data.tau = exact.tau.cast<Counted>();
    base = {exact_base.w.cast<Counted>(), exact_base.alpha.cast<Counted>(),
            exact_base.a.cast<Counted>(), exact_base.gravity.cast<Counted>()};
  }

  /// The whole of it, through the interface that callers use.
  OperationCount count_whole() {
    start();
    Counted::count = {};
    calc_position(mechanism, data, Need::kState);
    calc_velocity(mechanism, base, data);
    calc_acceleration(mechanism, base, data);
    calc_reactions(mechanism, base, kBase, data);
    return Counted::count;
  }

  /// The same in phases: the bodies of those functions, step by step.
  std::vector<Phase> count_phases() {
    start();
    std::vector<Phase> phases;
    const auto run = [&](const char* name, auto work) {
      Counted::count = {};
      work();
      phases.push_back({name, Counted::count});
    };
    const MechanismModel& model = mechanism.model;
    const LoopPlan& plan = mechanism.plan;
    // Legs of platforms are closed with the loops, and summed up in the phases that name them.
    const std::vector<int>& bodies = plan.tree_bodies;
    TreeData<Counted>& tree = data.tree;
    data.found = Need::kState;
    run("closing the loops", [&] { calc_loop_position(model, plan, tree, data.loops); });
    run("velocity maps", [&] { calc_velocity_maps(mechanism.model, plan, data.loops); });
    run("tree positions", [&] { calc_tree_position(model, bodies, tree); });
    const bool is_free = plan.is_free_platform;
    run("tree and leg inertia", [&] {
      if (is_free) return calc_free_inertia(model, plan, data.loops, tree, data.A_ind);
      calc_body_inertia(model, bodies, tree);
      add_leg_masses(plan, data.loops, tree);
      calc_composite_inertia(model, bodies, tree, data.A_tree);
      add_leg_inertia(model, plan, tree, data.loops, data.A_tree);
    });
    run("reduction of the inertia", [&] {
      if (is_free) return;
      data.A = data.A_tree;
      reduce_inertia(plan, data.A, data.loops);
    });
    run("velocities", [&] { calc_velocity(mechanism, base, data); });
    run("bias and forces", [&] {
      const VecX<Counted>* none = nullptr;
      calc_tree_acceleration(model, bodies, base, none, tree);
      if (is_free) {
        return calc_free_forces(model, plan, base, data.tau, tree, data.loops, data.b_ind);
      }
      calc_body_forces(model, bodies, tree);
      add_leg_biases(model, plan, base, data.tau, tree, data.loops);
      calc_transmitted(model, bodies, tree);
      data.b = data.tau - tree.tau_required;
      calc_loop_bias(model, plan, tree, data.loops);
      reduce_forces(plan, data.b, data.loops);
    });
    run("solution", [&] {
      data.factor.compute(data.A_ind);
      data.a_ind = data.b_ind;
      data.factor.solveInPlace(data.a_ind);
    });
    run("dependent accelerations", [&] { calc_loop_acceleration(plan, data.vdot, data.loops); });
    run("linear momentum", [&] {
      if (!base_gravity_is_zero()) find_motion_sums(mechanism, data);
    });
    run("cut forces", [&] { calc_loop_forces(plan, data.vdot, data.loops); });
    const OperationCount cut_forces = phases.back().count;
    run("load on the base", [&] { calc_reactions(mechanism, base, kBase, data); });
    phases.back().count.all -= cut_forces.all;
    phases.back().count.trivial -= cut_forces.trivial;
    return phases;
  }

  Mechanism mechanism;
  MechanismData<Counted> data;
  BaseMotion<Counted> base;
  MechanismData<double> exact;  ///< the same state, evaluated
  BaseMotion<double> exact_base;

 private:
  /// Dependent coordinates so near to their solution that Newton closures make one iteration, and
  /// yet so far that no difference is zero by luck.
  void start() {
    data.tree.q = exact.tree.q.cast<Counted>();
    for (const LoopBlock& block : mechanism.plan.blocks) {
      for (int i : block.dep_bodies) {
        data.tree.q[mechanism.model.bodies[i].q_index].value += 1e-14;
      }
    }
  }
  bool base_gravity_is_zero() const { return exact_base.gravity.isZero(0.0); }
  double phase_ = 0.0;
};

}  // namespace dockloop
