// How the forces of contact and latches change with the relative motion: for linearly implicit
// steps. Taken from the last evaluation; closest points are not searched again.
//
// F' = K xi + C nu, with F the wrench on P about the origin of G, nu = (v, w) the change of the
// motion of P relative to G and xi that of its displacement, axes of G (RelativeMotion). Per closed
// pair, with n, e = n/|n|, point c, arm = c - p, d' = -n.v(c), N = F_el phi, phi = max(0, 1 +
// lambda d'), s = sqrt(v_t^2 + v_s^2):
//
//   K -= phi F_el' a b^T,  C -= lambda F_el a b^T,  C -= (mu N/s) (t1 t1^T v_s^2/s^2 + t2 t2^T)
//   a = (n - mu v_t/s; c x ...),  b = (n; arm x n),  t1 along v_t, t2 = e x t1
//
// What is small compared with that is left out: normals that turn, points that wander, the turn of
// F itself. Friction is that of model 1; bristles have no part in it.
#pragma once

#include "contact/contact_model.hpp"
#include "contact/latches.hpp"

namespace dockloop {

struct InterfaceTangent {
  Mat6<double> stiffness = Mat6<double>::Zero();  ///< K: by displacement [N/m], [N], [N m]
  Mat6<double> damping = Mat6<double>::Zero();    ///< C: by velocity
};

/// Of the pairs of one body with active cores, which takes the place of G. No allocation.
/// @pre calc_contact() at this motion, with this workspace and result
void add_contact_tangent(const ContactModel& model, int body, const ContactMemory& memory,
                         const HardwareMotion<double>& motion, const ContactWorkspace<double>& work,
                         const ContactResult<double>& result, InterfaceTangent& tangent);

/// Of held and releasing latches, and of pawls along their axis.
void add_latch_tangent(const LatchSet& set, const LatchState* state, double t,
                       const RelativeMotion<double>& motion, InterfaceTangent& tangent);

}  // namespace dockloop
