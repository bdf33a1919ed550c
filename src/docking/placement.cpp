// Placement and backward free motion; see placement.hpp.
#include "docking/placement.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "docking/docking_model.hpp"
#include "math/rigid_body.hpp"

namespace dockloop {
namespace {

/// Distance along x of A at which the surfaces just touch, from a large distance. The gap changes
/// at most by the distance moved, so a step of the gap cannot pass a contact.
double find_touching_distance(const Scene& scene, const Mat3<double>& R_AP,
                              const Vec3<double>& lateral, const Pose<double>& G_in_A,
                              bool& touches) {
  constexpr double kTouching = 1e-10;  // [m]
  ContactWorkspace<double> work(scene.contact);
  double x = std::max(2.0 * scene.contact.bounding_radius, 1.0);  // an absorber has radius 0
  touches = true;
  for (int i = 0; i < 100000 && x >= -scene.contact.bounding_radius; ++i) {
    RelativeMotion<double> relative;
    relative.R = G_in_A.R.transpose() * R_AP;
    relative.p = G_in_A.R.transpose() * (Vec3<double>(x, lateral.y(), lateral.z()) - G_in_A.p);
    const double gap = find_gap(scene.contact, {}, relative, work);
    if (gap <= kTouching) return x;
    x -= gap;
  }
  touches = false;
  return 0.0;
}

/// Gap of the surfaces at the start, mechanism in home pose [m].
double find_start_gap(const Scene& scene, const Placement& placement, const Pose<double>& G_in_A) {
  std::array<Pose<double>, 2> interface;
  for (int i : {kChaser, kTarget}) {
    const VehicleParameters& p = placement.vehicle[i];
    const Vec3<double> from_target = p.position - placement.vehicle[kTarget].position;
    interface[i] = Pose<double>{quat_to_matrix<double>(p.attitude), from_target} *
                   Pose<double>{quat_to_matrix<double>(p.interface_attitude), p.interface_position};
  }
  const Pose<double> G_to_P = inverse(interface[kChaser] * G_in_A) * interface[kTarget];
  RelativeMotion<double> relative;
  relative.R = G_to_P.R;
  relative.p = G_to_P.p;
  ContactWorkspace<double> work(scene.contact);
  return find_gap(scene.contact, {}, relative, work);
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
  Pose<double> G_in_A = scene.mechanism.capture_in_body;
  if (scene.mechanism.capture_body != kBase) {
    Mechanism mechanism(scene.mechanism);
    MechanismData<double> data(mechanism);
    calc_home_position(mechanism, "mechanism", data);
    const int body = scene.mechanism.capture_body;
    G_in_A = Pose<double>{data.tree.R[body], data.tree.p[body]} * G_in_A;
  }
  G_in_A = scene.base_in_interface * G_in_A;
  Vec3<double> p_AP = at.lateral;
  p_AP.x() = scene.contact.empty()
                 ? 0.0
                 : find_touching_distance(scene, R_AP, at.lateral, G_in_A, placement.touches);
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
    const double gap = scene.contact.empty() ? 0.0 : find_start_gap(scene, placement, G_in_A);
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

}  // namespace dockloop
