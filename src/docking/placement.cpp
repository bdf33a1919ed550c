// Placement and backward free motion; see placement.hpp.
#include "docking/placement.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "docking/docking_model.hpp"
#include "math/rigid_body.hpp"

namespace dockloop {
namespace {

/// G and the other bodies with active cores in A, mechanism in home pose.
std::vector<Pose<double>> find_active_poses(const Scene& scene) {
  const MechanismModel& model = scene.mechanism;
  std::vector<Pose<double>> poses{model.capture_in_body};
  if (model.capture_body != kBase || scene.contact.body_count() > 1) {
    Mechanism mechanism(model);
    MechanismData<double> data(mechanism);
    calc_home_position(mechanism, "mechanism", data);
    const auto find_pose = [&](int body) {
      return Pose<double>{data.tree.R[body], data.tree.p[body]};
    };
    if (model.capture_body != kBase) poses[0] = find_pose(model.capture_body) * poses[0];
    for (int i = 1; i < scene.contact.body_count(); ++i) {
      poses.push_back(find_pose(model.contact_bodies[i - 1]));
    }
  }
  for (Pose<double>& pose : poses) pose = scene.base_in_interface * pose;
  return poses;
}

/// P relative to these bodies, at rest. @param R, p  pose of P in A
HardwareMotion<double> find_motion(const std::vector<Pose<double>>& active, const Mat3<double>& R,
                                   const Vec3<double>& p) {
  const auto find = [&](const Pose<double>& body) {
    RelativeMotion<double> relative;
    relative.R = body.R.transpose() * R;
    relative.p = body.R.transpose() * (p - body.p);
    return relative;
  };
  HardwareMotion<double> motion = find(active[0]);
  for (size_t i = 1; i < active.size(); ++i) motion.others.push_back(find(active[i]));
  return motion;
}

/// Distance along x of A at which the surfaces just touch, from a large distance. The gap changes
/// at most by the distance moved, so a step of the gap cannot pass a contact.
double find_touching_distance(const Scene& scene, const Mat3<double>& R_AP,
                              const Vec3<double>& lateral, const std::vector<Pose<double>>& active,
                              bool& touches) {
  constexpr double kTouching = 1e-10;  // [m]
  ContactWorkspace<double> work(scene.contact);
  const double radius = find_bounding_radius(scene.contact, find_motion(active, R_AP, lateral));
  double x = std::max(2.0 * radius, 1.0);  // an absorber has radius 0
  touches = true;
  for (int i = 0; i < 100000 && x >= -radius; ++i) {
    const Vec3<double> p(x, lateral.y(), lateral.z());
    const double gap = find_gap(scene.contact, {}, find_motion(active, R_AP, p), work);
    if (gap <= kTouching) return x;
    x -= gap;
  }
  touches = false;
  return 0.0;
}

/// Gap of the surfaces at the start, mechanism in home pose [m].
double find_start_gap(const Scene& scene, const Placement& placement,
                      const std::vector<Pose<double>>& active) {
  std::array<Pose<double>, 2> interface;
  for (int i : {kChaser, kTarget}) {
    const VehicleParameters& p = placement.vehicle[i];
    const Vec3<double> from_target = p.position - placement.vehicle[kTarget].position;
    interface[i] = Pose<double>{quat_to_matrix<double>(p.attitude), from_target} *
                   Pose<double>{quat_to_matrix<double>(p.interface_attitude), p.interface_position};
  }
  const Pose<double> P = inverse(interface[kChaser]) * interface[kTarget];
  ContactWorkspace<double> work(scene.contact);
  return find_gap(scene.contact, {}, find_motion(active, P.R, P.p), work);
}

/// Motion of a rigid body without loads.
struct FreeBody {
  double mass = 0.0;
  Vec3<double> com =
      Vec3<double>::Zero();  ///< of the moving body, from the vehicle's centre of mass, body axes
  Mat3<double> inertia = Mat3<double>::Zero();

  /// State a time `duration` earlier. Attitude by RK4 in small steps, translation exactly.
  void take_back(double duration, VehicleParameters& p) const {
    Vec4<double> q = p.attitude;
    Vec3<double> w = p.angular_velocity;
    const Vec3<double> centre = p.position + quat_to_matrix<double>(q) * com;
    const Vec3<double> velocity =
        p.velocity + quat_to_matrix<double>(q) * Vec3<double>(w.cross(com));
    turn_rigid_body(inertia, Vec3<double>::Zero(), -duration, 2000, q, w);
    p.attitude = q;
    p.angular_velocity = w;
    p.position = centre - duration * velocity - quat_to_matrix<double>(q) * com;
    p.velocity = velocity - quat_to_matrix<double>(q) * Vec3<double>(w.cross(com));
  }
};

/// Vehicle with the mechanism frozen in home pose, unless the stated mass includes the mechanism.
FreeBody make_body_with_mechanism(const Scene& scene, int i) {
  const VehicleParameters& p = scene.vehicle[i];
  FreeBody body{p.mass, Vec3<double>::Zero(), make_symmetric(p.inertia)};
  if (i == kTarget || p.mass_includes_mechanism == 2 || scene.mechanism.bodies.empty()) return body;
  const VehicleBody frozen = find_frozen_body(Mechanism(scene.mechanism));
  const Pose<double> B =
      Pose<double>{quat_to_matrix<double>(p.interface_attitude), p.interface_position} *
      scene.base_in_interface;
  const Vec3<double> c = B.R * frozen.com + B.p;
  body.mass = p.mass + frozen.mass;
  body.com = frozen.mass / body.mass * c;
  body.inertia += find_point_inertia(p.mass, body.com) + B.R * frozen.inertia * B.R.transpose() +
                  find_point_inertia<double>(frozen.mass, c - body.com);
  return body;
}

/// The same with its parts, coordinates at zero.
FreeBody make_free_body(const Scene& scene, int i) {
  const FreeBody body = make_body_with_mechanism(scene, i);
  const VehicleBody parts = find_rigid_parts(scene.parts[i]);
  if (!(parts.mass > 0.0)) return body;
  const VehicleBody whole = join({body.mass, body.com, body.inertia}, parts);
  return {whole.mass, whole.com, whole.inertia};
}

}  // namespace

Placement find_placement(const Scene& scene) {
  const ContactConditions& at = scene.conditions;
  if (!at.given || !scene.has_target) {
    throw ModelError("scene '" + scene.name +
                     "' has no conditions at first contact: set initial.at = \"first_contact\"");
  }
  if (scene.motion[kChaser] == Motion::kFixed) {
    throw ModelError("scene '" + scene.name +
                     "': conditions at first contact need a chaser that moves; set chaser.motion");
  }
  Placement placement;
  placement.vehicle = scene.vehicle;
  VehicleParameters& chaser = placement.vehicle[kChaser];
  VehicleParameters& target = placement.vehicle[kTarget];

  // P relative to A, axes of A: swing by the tilt, twist by the roll.
  const Vec4<double> q_AP = quat_multiply<double>(
      quat_exp<double>(at.tilt), quat_exp<double>(Vec3<double>(at.roll, 0.0, 0.0)));
  const Mat3<double> R_AP = quat_to_matrix<double>(q_AP);
  const std::vector<Pose<double>> active = find_active_poses(scene);
  Vec3<double> p_AP = at.lateral;
  p_AP.x() = scene.contact.empty()
                 ? 0.0
                 : find_touching_distance(scene, R_AP, at.lateral, active, placement.touches);
  const Vec3<double> v_AP(-at.closing_speed, at.lateral_velocity.y(), at.lateral_velocity.z());

  // Chaser from target, through A and P.
  const Mat3<double> R_ND = quat_to_matrix<double>(target.attitude);
  const Vec3<double> w_D = R_ND * target.angular_velocity;
  const Vec3<double> arm_P = R_ND * target.interface_position;
  const Mat3<double> R_NA =
      R_ND * quat_to_matrix<double>(target.interface_attitude) * R_AP.transpose();
  const Vec3<double> p_A = arm_P - R_NA * p_AP;  // from the target's CoM
  const Vec3<double> w_A = w_D - R_NA * at.angular_velocity;
  const Vec3<double> v_A = w_D.cross(arm_P) - R_NA * v_AP - w_A.cross(Vec3<double>(R_NA * p_AP));
  const Mat3<double> R_NC = R_NA * quat_to_matrix<double>(chaser.interface_attitude).transpose();
  const Vec3<double> arm_A = R_NC * chaser.interface_position;
  chaser.attitude = quat_from_matrix<double>(R_NC);
  chaser.angular_velocity = R_NC.transpose() * w_A;
  chaser.position = target.position + (p_A - arm_A);
  chaser.velocity = target.velocity + (v_A - w_A.cross(arm_A));

  placement.time_of_contact = at.approach_time;
  if (at.approach_time > 0.0) {
    make_free_body(scene, kChaser).take_back(at.approach_time, chaser);
    if (scene.motion[kTarget] != Motion::kFixed) {
      make_free_body(scene, kTarget).take_back(at.approach_time, target);
    }
    const double gap = scene.contact.empty() ? 0.0 : find_start_gap(scene, placement, active);
    if (gap < 0.0) {
      char text[400];
      std::snprintf(text, sizeof text,
                    "scene '%s': no free motion of %.6g s leads to these conditions at first "
                    "contact, because the surfaces overlap by %.3g mm at the start; shorten "
                    "initial.approach_time, or change offsets, tilt or their rates",
                    scene.name.c_str(), at.approach_time, -1e3 * gap);
      throw ModelError(text);
    }
  }
  return placement;
}

Misplacement find_misplacement(const Scene& scene, const std::array<VehicleParameters, 2>& now) {
  constexpr double kLeast = 1e-4;  // of the distance at the start, and of a radian
  Misplacement found;
  if (!scene.conditions.given || !scene.has_target || scene.motion[kChaser] == Motion::kFixed) {
    return found;
  }
  for (int i : {kChaser, kTarget}) {
    const VehicleParameters &p = now[i], &stated = scene.vehicle[i];
    if (p.position != stated.position || p.attitude != stated.attitude ||
        p.velocity != stated.velocity || p.angular_velocity != stated.angular_velocity) {
      return found;
    }
    const auto note = [&](const char* name, bool is_changed) {
      if (!is_changed) return;
      found.names += (found.names.empty() ? "" : ", ") + std::string(get_vehicle_name(i)) + name;
    };
    note(".mass", p.mass != stated.mass);
    note(".inertia", p.inertia != stated.inertia);
    note(".interface_position", p.interface_position != stated.interface_position);
    note(".interface_attitude", p.interface_attitude != stated.interface_attitude);
  }
  if (found.names.empty()) return found;
  Scene changed = scene;
  changed.vehicle = now;
  const auto find_start = [](const std::array<VehicleParameters, 2>& vehicles) {
    std::array<Pose<double>, 2> interface;
    for (int i : {kChaser, kTarget}) {
      const VehicleParameters& p = vehicles[i];
      interface[i] =
          Pose<double>{quat_to_matrix<double>(p.attitude), p.position} *
          Pose<double>{quat_to_matrix<double>(p.interface_attitude), p.interface_position};
    }
    return inverse(interface[kChaser]) * interface[kTarget];
  };
  try {
    // The states of the scene are those at the start already, so placed once more they differ.
    const Pose<double> is = find_start(now), wanted = find_start(find_placement(changed).vehicle);
    const Pose<double> was = find_start(scene.vehicle),
                       again = find_start(find_placement(scene).vehicle);
    found.distance = (is.p - wanted.p - (was.p - again.p)).norm();
    const double turned = (is.R - wanted.R - (was.R - again.R)).norm();
    if (found.distance <= kLeast * is.p.norm() && turned <= kLeast) found.names.clear();
  } catch (const ModelError&) {
    found.distance = std::numeric_limits<double>::infinity();
  }
  return found;
}

}  // namespace dockloop
