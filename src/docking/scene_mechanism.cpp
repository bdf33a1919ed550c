// See scene_mechanism.hpp.
#include "docking/scene_mechanism.hpp"

#include "docking/frame_origin.hpp"
#include "mechanism/massless_legs.hpp"

namespace dockloop {

Mechanism make_scene_mechanism(const Scene& scene) {
  const VehicleParameters& chaser = scene.vehicle[kChaser];
  const Pose<double> base_in_chaser =
      Pose<double>{quat_to_matrix<double>(chaser.interface_attitude), chaser.interface_position} *
      scene.base_in_interface;
  const MechanismModel described =
      scene.level == kMasslessLegs ? make_legs_massless(scene.mechanism).model : scene.mechanism;
  const bool moves = scene.motion[kChaser] != Motion::kFixed;
  const Pose<double> chaser_pose{quat_to_matrix<double>(chaser.attitude),
                                 chaser.position - find_frame_origin(scene, scene.vehicle)};
  Mechanism mechanism(moves ? attach_vehicle(described, {}, base_in_chaser, scene.parts[kChaser])
                            : fix_base(described, chaser_pose * base_in_chaser));
  if (moves) mechanism.vehicle = 0;
  return mechanism;
}

}  // namespace dockloop
