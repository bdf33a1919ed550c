// One evaluation of a mechanism as an integrator asks for it, at states that are not all the same.
//
// A few states along a short motion about home are evaluated in turn, so that neither branch
// prediction nor a closure that starts from the last solution can learn one of them by heart.
#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "benchmarks/closed_mechanism.hpp"
#include "math/rotation.hpp"
#include "mechanism/joint_forces.hpp"
#include "mechanism/kernels.hpp"

namespace dockloop {

struct NamedKernel {
  std::string name;
  std::shared_ptr<MechanismKernel> kernel;
};

/// The generated code that applies to a mechanism.
/// @param library  with it; may be empty
inline std::vector<NamedKernel> find_kernels(const Mechanism& mechanism,
                                             const std::string& library) {
  std::vector<NamedKernel> found;
  if (library.empty()) return found;
  const auto generated = std::make_shared<const KernelLibrary>(library);
  for (const KernelScope scope : {KernelScope::kDocking, KernelScope::kAny}) {
    if (generated->hash() != find_kernel_hash(mechanism, scope)) continue;
    found.push_back({"generated kernel", std::make_shared<GeneratedKernel>(mechanism, generated)});
    break;
  }
  return found;
}

/// What to measure, from an argument `FILE.json[,KERNEL.so]`.
struct Subject {
  explicit Subject(const std::string& argument)
      : file(argument.substr(0, argument.find(','))),
        kernel_file(file.size() < argument.size() ? argument.substr(file.size() + 1) : "") {}
  std::string file, kernel_file;
};

class MechanismEvaluation {
 public:
  /// @param newton_only  close loops by iteration, by no closed form
  /// @throws ModelError if the mechanism cannot be read or closed
  explicit MechanismEvaluation(const std::string& file, bool newton_only = false)
      : mechanism(read_closed_mechanism(file, newton_only)), data(mechanism) {
    base.gravity = mechanism.model.gravity;
    command_.setZero(static_cast<int>(mechanism.model.forces.size()));
    force_ = command_;
    const VecX<double> home =
        Eigen::Map<const VecX<double>>(mechanism.model.home_q.data(), mechanism.model.nq);
    for (int k = 0; k < kStates; ++k) {
      const double phase = 0.3 * k;
      State state{home, VecX<double>::Zero(mechanism.model.nv)};
      for (int i : mechanism.plan.ind_bodies) put_state(i, phase, state);
      states_.push_back(state);
    }
    for (int k = 0; k < kStates; ++k) {
      put_next_state();
      if (!calc_accelerations()) throw ModelError(file + " cannot be closed near home");
    }
    accept();
  }

  /// The present pose is what continuation starts from.
  void accept() { keep_reference(mechanism, data); }

  /// Evaluate by a kernel from now on. @return whether it takes all of the states
  bool use(const std::shared_ptr<MechanismKernel>& kernel) {
    data.generated = kernel;
    bool applies = true;
    for (int k = 0; k < kStates; ++k) {
      put_next_state();
      calc_accelerations();
      applies = applies && data.found == Need::kRates;
    }
    return applies;
  }

  /// Independent coordinates and velocities of the next state.
  void put_next_state() {
    const State& state = states_[next_];
    next_ = (next_ + 1) % kStates;
    for (int i : mechanism.plan.ind_q) data.tree.q[i] = state.q[i];
    for (int i : mechanism.plan.ind_v) data.tree.v[i] = state.v[i];
  }

  /// Everything up to the independent accelerations. @return whether all loops are closed
  bool calc_accelerations() {
    if (!calc_position(mechanism, data, Need::kRates).ok()) return false;
    calc_velocity(mechanism, base, data);
    calc_forces();
    calc_acceleration(mechanism, base, data);
    return true;
  }

  void calc_forces() {
    data.tau.setZero();
    calc_joint_forces(mechanism.model, data.tree.q, data.tree.v, command_, force_, data.tau);
  }

  static constexpr int kStates = 16;
  Mechanism mechanism;
  MechanismData<double> data;
  BaseMotion<double> base;

 private:
  struct State {
    VecX<double> q, v;
  };

  /// Body i moved from home by up to 3 cm or 3 hundredths of a radian, at up to 0.1 of the units.
  void put_state(int i, double phase, State& state) const {
    const Body& body = mechanism.model.bodies[i];
    const auto wave = [&](int j) { return std::sin(phase + 1.7 * (i + 1) * (j + 1)); };
    for (int j = 0; j < body.nv(); ++j) state.v[body.v_index + j] = 0.1 * wave(j + 7);
    if (body.joint != JointType::kFree) {
      state.q[body.q_index] += 0.03 * wave(0);
      return;
    }
    for (int j = 0; j < 3; ++j) state.q[body.q_index + j] += 0.03 * wave(j);
    const Vec4<double> turn =
        quat_exp<double>(0.03 * Vec3<double>(1.0 + wave(3), 1.0 + wave(4), 1.0 + wave(5)));
    state.q.segment<4>(body.q_index + 3) =
        quat_multiply<double>(turn, state.q.segment<4>(body.q_index + 3));
  }

  std::vector<State> states_;
  size_t next_ = 0;
  VecX<double> command_, force_;
};

}  // namespace dockloop
