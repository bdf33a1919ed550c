// Tree recursions; see tree.hpp for what is computed, about which point and in which axes.
#pragma once

#include "math/scalar.hpp"
#include "tree/tree.hpp"

namespace dockloop {

template <class S>
TreeData<S>::TreeData(const MechanismModel& model) {
  const size_t n = model.bodies.size();
  q.setZero(model.nq);
  v.setZero(model.nv);
  joint.resize(n);
  R.assign(n, Mat3<S>::Identity());
  for (auto* list : {&r, &p, &e, &h_body, &h_sum, &w, &u, &alpha, &a}) {
    list->assign(n, Vec3<S>::Zero());
  }
  I_body.assign(n, Mat3<S>::Zero());
  mode_rate_dot.assign(n, S(0));
  I_sum.assign(n, Mat3<S>::Zero());
  m_sum.assign(n, S(0));
  A.setZero(model.nv, model.nv);
  external.resize(n);
  transmitted.resize(n);
  for (size_t i = 0; i < n; ++i) all.push_back(static_cast<int>(i));
  tau_required.setZero(model.nv);
  for (size_t i = 0; i < model.home_q.size(); ++i) q[static_cast<int>(i)] = S(model.home_q[i]);
}

template <class S>
void calc_joint_pose(const MechanismModel& model, int i, const S& c, const S& s,
                     TreeData<S>& data) {
  const Body& body = model.bodies[i];
  const Mat3<S> R0 = cast<S>(body.placement.R);
  const Vec3<S> p0 = cast<S>(body.placement.p);
  const Vec3<S> axis = cast<S>(body.axis);
  Pose<S>& pose = data.joint[i];
  switch (body.joint) {
    case JointType::kRevolute:
      pose.R = R0 * axis_rotation<S>(axis, c, s);
      pose.p = p0;
      break;
    case JointType::kPrismatic:
      pose.R = R0;
      pose.p = p0 + R0 * (axis * data.q[body.q_index]);
      break;
    case JointType::kFree:
      pose.R = R0 * quat_to_matrix<S>(data.q.template segment<4>(body.q_index + 3));
      pose.p = p0 + R0 * data.q.template segment<3>(body.q_index);
      break;
    case JointType::kMode:
      pose = {R0, p0};
      break;
  }
}

template <class S>
void calc_joint_pose(const MechanismModel& model, int i, TreeData<S>& data) {
  using std::cos;
  using std::sin;
  const Body& body = model.bodies[i];
  S c(1), s(0);
  if (body.joint == JointType::kRevolute) {
    c = cos(data.q[body.q_index]);
    s = sin(data.q[body.q_index]);
  }
  calc_joint_pose(model, i, c, s, data);
}

template <class S>
void calc_tree_position(const MechanismModel& model, const std::vector<int>& bodies,
                        TreeData<S>& data) {
  for (int i : bodies) {
    const Body& body = model.bodies[i];
    const int up = body.parent;
    if (up == kBase) {
      data.R[i] = data.joint[i].R;
      data.r[i] = data.joint[i].p;
      data.p[i] = data.r[i];
    } else {
      data.R[i] = data.R[up] * data.joint[i].R;
      data.r[i] = data.R[up] * data.joint[i].p;
      data.p[i] = data.p[up] + data.r[i];
    }
    // A joint axis is the same vector in body axes and in joint axes.
    if (body.joint != JointType::kFree) data.e[i] = data.R[i] * cast<S>(body.axis);
  }
}

template <class S>
void calc_body_inertia(const MechanismModel& model, const std::vector<int>& bodies,
                       TreeData<S>& data) {
  // Bodies alone, about their own origins, in base axes.
  for (int i : bodies) {
    const Body& body = model.bodies[i];
    BodyInertia<S> own = find_body_inertia(body, data.R[i]);
    if (body.joint == JointType::kMode) own.h = data.e[i] * data.q[body.q_index];
    data.m_sum[i] = S(body.mass);
    data.h_sum[i] = data.h_body[i] = own.h;
    data.I_sum[i] = data.I_body[i] = own.I;
  }
}

template <class S>
void calc_composite_inertia(const MechanismModel& model, const std::vector<int>& bodies,
                            TreeData<S>& data, MatX<S>& A) {
  // Composite bodies, leaves to root.
  for (auto it = bodies.rbegin(); it != bodies.rend(); ++it) {
    const int i = *it;
    const int up = model.bodies[i].parent;
    if (up == kBase) continue;
    const Vec3<S>& r = data.r[i];
    const Vec3<S>& h = data.h_sum[i];
    const S m = data.m_sum[i];
    data.m_sum[up] += m;
    data.h_sum[up] += h + m * r;
    const Mat3<S> mixed = r * (h + S(0.5) * m * r).transpose();
    data.I_sum[up] +=
        data.I_sum[i] + S(2) * mixed.trace() * Mat3<S>::Identity() - mixed - mixed.transpose();
  }
  // Columns of A: momentum of the composite body under one unit joint velocity, seen by ancestors.
  for (int i : bodies) {
    const Body& body = model.bodies[i];
    for (int k = 0; k < body.nv(); ++k) A.col(body.v_index + k).setZero();
  }
  for (int i : bodies) {
    const Body& body = model.bodies[i];
    const bool is_free = body.joint == JointType::kFree;
    if (is_free) {  // own rows: the composite body in its own axes
      const Mat3<S>& R = data.R[i];
      const Vec3<S> h = R.transpose() * data.h_sum[i];
      const Mat3<S> coupling = skew<S>(h), turned = data.I_sum[i] * R;
      const int at = body.v_index;
      A.template block<3, 3>(at, at) = data.m_sum[i] * Mat3<S>::Identity();
      A.template block<3, 3>(at + 3, at) = coupling;
      A.template block<3, 3>(at, at + 3) = coupling.transpose();
      A.template block<3, 3>(at + 3, at + 3) = R.transpose() * turned;
      if (body.parent == kBase) continue;
    }
    for (int k = 0; k < body.nv(); ++k) {
      Vec3<S> angular, linear;
      get_joint_column(body, data.R[i], data.e[i], k, angular, linear);
      Vec3<S> f = data.m_sum[i] * linear + angular.cross(data.h_sum[i]);
      Vec3<S> t = data.h_sum[i].cross(linear) + data.I_sum[i] * angular;
      const int column = body.v_index + k;
      if (body.joint == JointType::kMode) {
        const Wrench<S> momentum = find_mode_momentum(body, data.R[i]);
        f = momentum.f;
        t = momentum.t;
      }
      if (is_free) t += data.r[i].cross(f);
      for (int j = is_free ? body.parent : i; j != kBase; j = model.bodies[j].parent) {
        const Body& ancestor = model.bodies[j];
        const int row = ancestor.v_index;
        switch (ancestor.joint) {
          case JointType::kRevolute:
            A(row, column) = data.e[j].dot(t);
            break;
          case JointType::kPrismatic:
            A(row, column) = data.e[j].dot(f);
            break;
          case JointType::kFree:
            A.col(column).template segment<3>(row).noalias() = data.R[j].transpose() * f;
            A.col(column).template segment<3>(row + 3).noalias() = data.R[j].transpose() * t;
            break;
          case JointType::kMode:
            A(row, column) = S(1);
            break;
        }
        t += data.r[j].cross(f);
      }
      // Rows below the diagonal from symmetry: ancestors have smaller indices.
      for (int row = 0; row < column; ++row) A(column, row) = A(row, column);
    }
  }
}

template <class S>
void calc_tree_inertia(const MechanismModel& model, TreeData<S>& data) {
  calc_body_inertia(model, data.all, data);
  calc_composite_inertia(model, data.all, data, data.A);
}

template <class S>
void calc_tree_velocity(const MechanismModel& model, const std::vector<int>& bodies,
                        const Vec3<S>& base_w, TreeData<S>& data) {
  for (int i : bodies) {
    const Body& body = model.bodies[i];
    const int up = body.parent;
    const Vec3<S> w_up = up == kBase ? base_w : data.w[up];
    data.w[i] = w_up;
    data.u[i] = w_up.cross(data.r[i]);
    if (up != kBase) data.u[i] += data.u[up];
    switch (body.joint) {
      case JointType::kRevolute:
        data.w[i] += data.e[i] * data.v[body.v_index];
        break;
      case JointType::kPrismatic:
        data.u[i] += data.e[i] * data.v[body.v_index];
        break;
      case JointType::kFree:
        data.u[i] += data.R[i] * data.v.template segment<3>(body.v_index);
        data.w[i] += data.R[i] * data.v.template segment<3>(body.v_index + 3);
        break;
      case JointType::kMode:
        break;
    }
  }
}

template <class S>
void calc_tree_acceleration(const MechanismModel& model, const std::vector<int>& bodies,
                            const BaseMotion<S>& base, const VecX<S>* vdot, TreeData<S>& data) {
  const Vec3<S> base_a = base.a - base.gravity;
  for (int i : bodies) {
    const Body& body = model.bodies[i];
    const int up = body.parent;
    const Vec3<S> w_up = up == kBase ? base.w : data.w[up];
    const Vec3<S> alpha_up = up == kBase ? base.alpha : data.alpha[up];
    const Vec3<S>& r = data.r[i];
    data.alpha[i] = alpha_up;
    data.a[i] = (up == kBase ? base_a : data.a[up]) + alpha_up.cross(r) + w_up.cross(w_up.cross(r));
    switch (body.joint) {
      case JointType::kRevolute: {
        data.alpha[i] += w_up.cross(data.e[i] * data.v[body.v_index]);
        if (vdot) data.alpha[i] += data.e[i] * (*vdot)[body.v_index];
        break;
      }
      case JointType::kPrismatic: {
        data.a[i] += S(2) * w_up.cross(data.e[i] * data.v[body.v_index]);
        if (vdot) data.a[i] += data.e[i] * (*vdot)[body.v_index];
        break;
      }
      case JointType::kFree: {
        // Relative velocities are held in body axes: their rates carry the body's own rotation.
        const Vec3<S> u_rel = data.R[i] * data.v.template segment<3>(body.v_index);
        const Vec3<S> w_rel = data.R[i] * data.v.template segment<3>(body.v_index + 3);
        data.a[i] += (S(2) * w_up + w_rel).cross(u_rel);
        data.alpha[i] += w_up.cross(w_rel);
        if (vdot) {
          data.a[i] += data.R[i] * vdot->template segment<3>(body.v_index);
          data.alpha[i] += data.R[i] * vdot->template segment<3>(body.v_index + 3);
        }
        break;
      }
      case JointType::kMode:
        data.mode_rate_dot[i] = vdot ? (*vdot)[body.v_index] : S(0);
        break;
    }
  }
}

template <class S>
void calc_body_forces(const MechanismModel& model, const std::vector<int>& bodies,
                      TreeData<S>& data) {
  // Newton and Euler for each body alone, about its own origin.
  for (int i : bodies) {
    const Vec3<S>& w = data.w[i];
    const Vec3<S>& h = data.h_body[i];
    Wrench<S>& load = data.transmitted[i];
    load.f = S(model.bodies[i].mass) * data.a[i] + data.alpha[i].cross(h) + w.cross(w.cross(h)) -
             data.external[i].f;
    load.t = data.I_body[i] * data.alpha[i] + w.cross(data.I_body[i] * w) + h.cross(data.a[i]) -
             data.external[i].t;
    const Body& body = model.bodies[i];
    if (body.joint != JointType::kMode) continue;
    // The first moment h = f q of the mode has the rate f qdot, its moment of momentum is t qdot.
    const Wrench<S> momentum = find_mode_momentum(body, data.R[i]);
    const S &rate = data.v[body.v_index], &rate_dot = data.mode_rate_dot[i];
    load.f += momentum.f * rate_dot + S(2) * rate * w.cross(momentum.f);
    load.t += momentum.t * rate_dot + rate * w.cross(momentum.t);
  }
}

template <class S>
void calc_transmitted(const MechanismModel& model, const std::vector<int>& bodies,
                      TreeData<S>& data) {
  // Leaves to root: what a body needs, its parent must pass on.
  for (auto it = bodies.rbegin(); it != bodies.rend(); ++it) {
    const int i = *it;
    const Body& body = model.bodies[i];
    const Wrench<S>& load = data.transmitted[i];
    switch (body.joint) {
      case JointType::kRevolute:
        data.tau_required[body.v_index] = data.e[i].dot(load.t);
        break;
      case JointType::kPrismatic:
        data.tau_required[body.v_index] = data.e[i].dot(load.f);
        break;
      case JointType::kFree:
        data.tau_required.template segment<3>(body.v_index) = data.R[i].transpose() * load.f;
        data.tau_required.template segment<3>(body.v_index + 3) = data.R[i].transpose() * load.t;
        break;
      case JointType::kMode: {
        const Wrench<S> momentum = find_mode_momentum(body, data.R[i]);
        data.tau_required[body.v_index] =
            momentum.f.dot(data.a[i]) + momentum.t.dot(data.alpha[i]) + data.mode_rate_dot[i];
        break;
      }
    }
    if (body.parent != kBase) {
      data.transmitted[body.parent].f += load.f;
      data.transmitted[body.parent].t += load.t + data.r[i].cross(load.f);
    }
  }
}

template <class S>
void calc_tree_forces(const MechanismModel& model, TreeData<S>& data) {
  calc_body_forces(model, data.all, data);
  calc_transmitted(model, data.all, data);
}

#define DOCK_INSTANTIATE(S)                                                                        \
  template struct TreeData<S>;                                                                     \
  template void calc_joint_pose<S>(const MechanismModel&, int, const S&, const S&, TreeData<S>&);  \
  template void calc_joint_pose<S>(const MechanismModel&, int, TreeData<S>&);                      \
  template void calc_tree_position<S>(const MechanismModel&, const std::vector<int>&,              \
                                      TreeData<S>&);                                               \
  template void calc_body_inertia<S>(const MechanismModel&, const std::vector<int>&,               \
                                     TreeData<S>&);                                                \
  template void calc_composite_inertia<S>(const MechanismModel&, const std::vector<int>&,          \
                                          TreeData<S>&, MatX<S>&);                                 \
  template void calc_tree_inertia<S>(const MechanismModel&, TreeData<S>&);                         \
  template void calc_tree_velocity<S>(const MechanismModel&, const std::vector<int>&,              \
                                      const Vec3<S>&, TreeData<S>&);                               \
  template void calc_tree_acceleration<S>(const MechanismModel&, const std::vector<int>&,          \
                                          const BaseMotion<S>&, const VecX<S>*, TreeData<S>&);     \
  template void calc_body_forces<S>(const MechanismModel&, const std::vector<int>&, TreeData<S>&); \
  template void calc_transmitted<S>(const MechanismModel&, const std::vector<int>&, TreeData<S>&); \
  template void calc_tree_forces<S>(const MechanismModel&, TreeData<S>&);

DOCK_INSTANTIATE_FOR_SCALARS(DOCK_INSTANTIATE)
#undef DOCK_INSTANTIATE

}  // namespace dockloop
