// Seeds and derivatives of the dual numbers of a docking; see docking_jacobian.hpp.
#include "docking/docking_jacobian.hpp"

#include <algorithm>
#include <utility>

#include "mechanism/mechanism_jacobian.hpp"

namespace dockloop {

DockingPass::DockingPass(const DockingModel& model)
    : y(static_cast<size_t>(model.layout.size), Derivative(0)), ydot(y), data(model) {
  loads.command.setZero(count_commands(model.mechanism.model));
}

void start_docking_pass(const DockingModel& model, const Loads& loads, double t, const double* y,
                        DockingPass& pass) {
  pass.t = t;
  for (int i : {kChaser, kTarget}) {
    copy_constants(loads.force[i], pass.loads.force[i]);
    copy_constants(loads.torque[i], pass.loads.torque[i]);
  }
  copy_constants(loads.gravity, pass.loads.gravity);
  copy_constants(loads.command, pass.loads.command);
  std::copy(y, y + model.layout.size, pass.y.begin());
}

void seed_displacement(const DockingModel& model, const double* y, int direction, int lane,
                       std::vector<Derivative>& seeded) {
  const auto put = [&](int first, const auto& rate) {
    for (int i = 0; i < rate.size(); ++i) seeded[first + i].d[lane] = rate[i];
  };
  int q = model.layout.mechanism_q;
  for (int i : model.mechanism_bodies) {
    const Body& body = model.mechanism.model.bodies[i];
    if (direction >= body.nv()) {
      direction -= body.nv();
      q += body.nq();
      continue;
    }
    if (body.joint != JointType::kFree) {
      seeded[q].d[lane] = 1.0;
      return;
    }
    const Vec4<double> quat(y[q + 3], y[q + 4], y[q + 5], y[q + 6]);
    if (direction < 3) {
      put(q, Vec3<double>(quat_to_matrix<double>(quat).col(direction)));
    } else {
      put(q + 3, quat_rate<double>(quat, Vec3<double>(Vec3<double>::Unit(direction - 3))));
    }
    return;
  }
}

Status calc_docking_pass(const DockingModel& model, const DiscreteState& discrete,
                         const ContactMemory& memory, const DockingData<double>& at,
                         DockingPass& pass) {
  pass.data.locked = at.locked;
  copy_pose(at.mechanism, pass.data.mechanism);
  return calc_docking(model, discrete, memory, pass.loads, pass.t, pass.y.data(), pass.ydot.data(),
                      pass.data);
}

Status calc_docking_jacobian(const DockingModel& model, const DiscreteState& discrete,
                             const ContactMemory& memory, const DockingData<double>& at,
                             const Loads& loads, double t, const double* y, DockingPass& pass,
                             MatX<double>& jacobian, bool with_contact_bristles) {
  const StateLayout& layout = model.layout;
  const int bristles_end = layout.bristles + (with_contact_bristles ? layout.bristle_count : 0);
  start_docking_pass(model, loads, t, y, pass);
  jacobian.setZero();
  // Two ranges of columns: poses and momenta, then bristles.
  for (const auto& [begin, end] :
       {std::pair{0, layout.sums}, std::pair{layout.element_bristles, bristles_end}}) {
    for (int first = begin; first < end; first += kLanes) {
      const int count = std::min(kLanes, end - first);
      for (int lane = 0; lane < count; ++lane) pass.y[first + lane].d[lane] = 1.0;
      const Status status = calc_docking_pass(model, discrete, memory, at, pass);
      if (!status.ok()) return status;
      for (int lane = 0; lane < count; ++lane) {
        for (int i = 0; i < layout.size; ++i) jacobian(i, first + lane) = pass.ydot[i].d[lane];
        pass.y[first + lane].d[lane] = 0.0;
      }
    }
  }
  return {};
}

}  // namespace dockloop
