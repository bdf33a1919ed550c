// A mechanism evaluated twice, by the general code and by a kernel, at states near home in which no
// coordinate, rate or load is special; for the tests and the benchmark of kernels.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>

#include "benchmarks/closed_mechanism.hpp"
#include "math/rotation.hpp"
#include "mechanism/kernels.hpp"

namespace dockloop {

class KernelComparison {
 public:
  KernelComparison(const Mechanism& from, std::shared_ptr<MechanismKernel> kernel,
                   KernelScope in = KernelScope::kAny)
      : mechanism(from), general(from), special(from), bodies(from, in), scope(in) {
    if (!calc_position(mechanism, general).ok()) throw ModelError("cannot be closed at home");
    keep_reference(mechanism, general);
    special.loops.reference = general.loops.reference;
    special.generated = std::move(kernel);
  }

  /// State number `seed`: home, moved by up to `way` (m, rad), and rates and loads to it.
  void take_state(unsigned seed, double way = 0.03) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> part(-1.0, 1.0);
    const MechanismModel& model = mechanism.model;
    TreeData<double>& tree = general.tree;
    tree.q = general.loops.reference.q;
    for (int i : mechanism.plan.ind_bodies) {
      const Body& body = model.bodies[i];
      const int first = body.q_index, count = body.joint == JointType::kFree ? 3 : 1;
      for (int j = 0; j < count; ++j) tree.q[first + j] += way * part(random);
      if (body.joint != JointType::kFree) continue;
      const Vec4<double> turn = quat_exp<double>(
          Vec3<double>(way * part(random), way * part(random), way * part(random)));
      tree.q.segment<4>(first + 3) = quat_multiply<double>(turn, tree.q.segment<4>(first + 3));
    }
    for (int i : mechanism.plan.ind_v) tree.v[i] = 0.2 * part(random);
    general.tau.setZero();
    for (int i : bodies.forced) {
      for (int j = 0; j < model.bodies[i].nv(); ++j)
        general.tau[model.bodies[i].v_index + j] = 4.0 * part(random);
    }
    for (int i : bodies.loaded) {
      for (int j = 0; j < 3; ++j) tree.external[i].f[j] = 3.0 * part(random);
      for (int j = 0; j < 3; ++j) tree.external[i].t[j] = part(random);
    }
    for (Vec3<double>* x : {&base.w, &base.alpha, &base.a, &base.gravity}) {
      const bool moves = scope == KernelScope::kAny || x == &base.gravity;
      for (int j = 0; j < 3; ++j) (*x)[j] = moves ? part(random) : 0.0;
    }
    special.tree.q = tree.q;
    special.tree.v = tree.v;
    special.tau = general.tau;
    special.tree.external = tree.external;
  }

  /// Largest difference of what a kernel promises, relative to the largest entry of its kind.
  /// @throws ModelError if the state cannot be evaluated, or is not by the kernel
  double find_error() {
    for (MechanismData<double>* data : {&general, &special}) {
      if (!calc_position(mechanism, *data, Need::kRates).ok())
        throw ModelError("the state cannot be evaluated");
      calc_velocity(mechanism, base, *data);
      calc_acceleration(mechanism, base, *data);
    }
    if (special.found != Need::kRates) throw ModelError("the kernel does not apply");
    double worst = 0.0;
    const auto compare = [&](const auto& a, const auto& b) {
      const double size = a.template lpNorm<Eigen::Infinity>();
      const double apart = (a - b).template lpNorm<Eigen::Infinity>();
      if (!(apart <= 1e300)) throw ModelError("the kernel gives no number");
      if (apart > 0.0) worst = std::max(worst, apart / size);
    };
    const TreeData<double>&x = general.tree, &y = special.tree;
    for (int i : bodies.moving) {
      compare(x.R[i], y.R[i]);
      compare(x.p[i], y.p[i]);
      compare(x.r[i], y.r[i]);
      compare(x.w[i], y.w[i]);
      compare(x.u[i], y.u[i]);
    }
    for (int i : bodies.sprung) {
      const Body& body = mechanism.model.bodies[i];
      compare(x.q.segment(body.q_index, 1), y.q.segment(body.q_index, 1));
      compare(x.v.segment(body.v_index, 1), y.v.segment(body.v_index, 1));
    }
    if (mechanism.vehicle == kBase) compare(general.linear_momentum, special.linear_momentum);
    if (mechanism.vehicle != kBase) {
      compare(x.h_sum[0], y.h_sum[0]);
      worst = std::max(worst, std::abs(x.m_sum[0] - y.m_sum[0]) / x.m_sum[0]);
    }
    compare(general.A_ind, special.A_ind);
    const MatX<double> L = general.factor.matrixLLT().triangularView<Eigen::Lower>(),
                       M = special.factor.matrixLLT().triangularView<Eigen::Lower>();
    compare(L, M);
    VecX<double> a(mechanism.plan.ind_v.size()), b(a);
    for (int i = 0; i < a.size(); ++i) {
      a[i] = general.vdot[mechanism.plan.ind_v[i]];
      b[i] = special.vdot[mechanism.plan.ind_v[i]];
    }
    compare(a, b);
    return worst;
  }

  const Mechanism mechanism;
  MechanismData<double> general, special;
  BaseMotion<double> base;
  const KernelBodies bodies;
  const KernelScope scope;
};

}  // namespace dockloop
