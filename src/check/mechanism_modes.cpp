// Eigenvalues of the reduced equations at home; see mechanism_modes.hpp.
#include "check/mechanism_modes.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "mechanism/element_forces.hpp"
#include "mechanism/joint_forces.hpp"
#include "mechanism/mechanism_jacobian.hpp"

namespace dockloop {
namespace {

// Rounding moves an eigenvalue by about 1e-16 of the largest, and splits one that is double, as at
// critical damping or of a body that floats, by the root of that.
constexpr double kRoundingOfRates = 1e-12, kDouble = 1e-7;

/// Bristles about home, where they are unstressed and stick: their deflections follow the elements.
struct Bristles {
  std::vector<int> element;  ///< of each
  VecX<double> gain;         ///< deflection per motion of the element: 0 in an open brake
  VecX<double> home;         ///< coordinate of the element at home
};

Bristles find_bristles(const MechanismModel& model, const VecX<double>& q) {
  constexpr double kSlow = 1e-9;  // rate far below any at which a bristle slips
  ElementData<double> elements(model);
  Bristles bristles{list_bristle_elements(model.elements, model.failures), {}, {}};
  const int count = static_cast<int>(bristles.element.size());
  bristles.gain.setZero(count);
  bristles.home.setZero(count);
  VecX<double> v = VecX<double>::Zero(model.nv), tau = v;
  for (int b = 0; b < count; ++b) {
    const int e = bristles.element[static_cast<size_t>(b)];
    v.setZero();
    for (const ElementTerm& term : model.elements[static_cast<size_t>(e)].along) {
      v[model.bodies[term.body].v_index] = kSlow * term.ratio;
    }
    calc_element_forces<double>(model, q, v, 0.0, nullptr, {}, nullptr, elements, tau);
    bristles.home[b] = elements.coordinate[e];
    if (elements.rate[e] > 0.0) bristles.gain[b] = elements.z_rate[b] / elements.rate[e];
  }
  return bristles;
}

/// Joint forces of the file into data.tau: elements at the start of a run.
template <class S>
void put_joint_forces(const MechanismModel& model, const Bristles& bristles,
                      MechanismData<S>& data) {
  const VecX<S> command = VecX<S>::Zero(static_cast<int>(model.forces.size()));
  VecX<S> force = command;
  data.tau.setZero();
  calc_joint_forces(model, data.tree.q, data.tree.v, command, force, data.tau);
  VecX<S> z(bristles.gain.size());
  for (int b = 0; b < z.size(); ++b) {
    const int e = bristles.element[static_cast<size_t>(b)];
    const ForceElement& element = model.elements[static_cast<size_t>(e)];
    z[b] = S(bristles.gain[b]) *
           (find_coordinate<S>(model, element, data.tree.q) - S(bristles.home[b]));
  }
  ElementData<S> elements(model);
  calc_element_forces<S>(model, data.tree.q, data.tree.v, S(0), nullptr, {}, z.data(), elements,
                         data.tau);
}

/// Rates of the independent coordinates per unit independent velocity, ind_q x ind_v.
MatX<double> find_coordinate_map(const Mechanism& mechanism, const VecX<double>& q) {
  const LoopPlan& plan = mechanism.plan;
  MatX<double> map =
      MatX<double>::Zero(static_cast<int>(plan.ind_q.size()), static_cast<int>(plan.ind_v.size()));
  int row = 0, column = 0;
  for (int i : plan.ind_bodies) {
    const Body& body = mechanism.model.bodies[i];
    if (body.joint == JointType::kFree) {
      const Vec4<double> quat = q.segment<4>(body.q_index + 3);
      map.block<3, 3>(row, column) = quat_to_matrix<double>(quat);
      for (int k = 0; k < 3; ++k) {
        map.block<4, 1>(row + 3, column + 3 + k) =
            quat_rate<double>(quat, Vec3<double>(Vec3<double>::Unit(k)));
      }
    } else {
      map(row, column) = 1.0;
    }
    row += body.nq();
    column += body.nv();
  }
  return map;
}

}  // namespace

std::vector<Mode> find_modes(const Mechanism& mechanism) {
  const int n = static_cast<int>(mechanism.plan.ind_v.size());
  MechanismData<double> data(mechanism);
  BaseMotion<double> base;
  base.gravity = mechanism.model.gravity;
  std::vector<Mode> modes;
  if (n == 0 || !calc_position(mechanism, data).ok()) return modes;
  calc_velocity(mechanism, base, data);
  const Bristles bristles = find_bristles(mechanism.model, data.tree.q);
  put_joint_forces(mechanism.model, bristles, data);
  calc_acceleration(mechanism, base, data);
  JacobianData work(mechanism);
  AccelerationJacobian jacobian(mechanism);
  const auto put_loads = [&](MechanismData<Derivative>& dual) {
    put_joint_forces(mechanism.model, bristles, dual);
  };
  if (!calc_acceleration_jacobian(mechanism, base, data, put_loads, work, jacobian).ok()) {
    return modes;
  }
  MatX<double> system = MatX<double>::Zero(2 * n, 2 * n);
  system.topRightCorner(n, n).setIdentity();
  system.bottomLeftCorner(n, n) = jacobian.dq * find_coordinate_map(mechanism, data.tree.q);
  system.bottomRightCorner(n, n) = jacobian.dv;
  const Eigen::EigenSolver<MatX<double>> solver(system, false);
  const double largest = solver.eigenvalues().cwiseAbs().maxCoeff();
  for (const std::complex<double>& value : solver.eigenvalues()) {
    const double frequency = std::abs(value);
    const double growth = std::abs(value.real()) > kRoundingOfRates * largest ? value.real() : 0.0;
    if (frequency <= kDouble * largest) {
      modes.push_back({});
    } else if (std::abs(value.imag()) <= kDouble * frequency) {
      modes.push_back({frequency, growth, false});
    } else if (value.imag() > 0.0) {  // for both of the pair
      modes.push_back({frequency, growth, true});
    }
  }
  std::sort(modes.begin(), modes.end(),
            [](const Mode& a, const Mode& b) { return a.frequency < b.frequency; });
  return modes;
}

}  // namespace dockloop
