// The Runge-Kutta steps; see rigid_body.hpp.
#include "math/rigid_body.hpp"

#include "math/decompositions.hpp"
#include "math/rotation.hpp"

namespace dockloop {

void turn_rigid_body(const Mat3<double>& inertia, const Vec3<double>& torque, double h, int count,
                     Vec4<double>& q, Vec3<double>& w) {
  const double dt = h / count;
  const Mat3<double> inverse = invert(inertia);
  const auto wdot = [&](const Vec3<double>& rate) {
    return inverse * (torque + (inertia * rate).cross(rate));
  };
  for (int i = 0; i < count; ++i) {
    const Vec3<double> k1 = wdot(w), w2 = w + 0.5 * dt * k1;
    const Vec4<double> l1 = quat_rate<double>(q, w), q2 = q + 0.5 * dt * l1;
    const Vec3<double> k2 = wdot(w2), w3 = w + 0.5 * dt * k2;
    const Vec4<double> l2 = quat_rate<double>(q2, w2), q3 = q + 0.5 * dt * l2;
    const Vec3<double> k3 = wdot(w3), w4 = w + dt * k3;
    const Vec4<double> l3 = quat_rate<double>(q3, w3), q4 = q + dt * l3;
    const Vec3<double> k4 = wdot(w4);
    const Vec4<double> l4 = quat_rate<double>(q4, w4);
    w += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
    q = (q + dt / 6.0 * (l1 + 2.0 * l2 + 2.0 * l3 + l4)).normalized();
  }
}

}  // namespace dockloop
