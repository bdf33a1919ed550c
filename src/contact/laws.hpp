// Force laws of one contact: elastic force with its potential, damping, two friction laws.
//
// Everything here is a scalar or tangential law of depth d [m, positive inside], its rate and the
// tangential velocity; geometry is in primitives.hpp. Each law states its energy, so that a
// simulation can account for every joule: force = gradient of a potential, plus a part whose
// power is a square.
#pragma once

#include <algorithm>
#include <cmath>

#include "math/law_number.hpp"
#include "math/one_sided_spring.hpp"
#include "math/types.hpp"

namespace dockloop {

/// Parameters of all contacts of a model. Defaults suit a 40 kg ring on soft legs.
/// Rule for the stiffness: k >= 4 m v^2/(rounding sum)^2 for the fastest contact that must be
/// right.
struct ContactLaw {
  double stiffness = 2e6;             ///< k of petals and edges [N/m]
  double node_stiffness = 2e6 / 12;   ///< k of one ring node on a ring face [N/m]
  double toe = 5e-5;                  ///< eps: parabolic start of the force [m]
  double damping = 4.0;               ///< lambda: force factor 1 + lambda d' [s/m]
  double regularisation = 1e-4;       ///< mu of the closest points [-]
  double friction_coefficient = 0.1;  ///< [-]
  double friction_speed = 1e-3;       ///< v_s of model 1 [m/s]
  int friction_model = 1;             ///< 1 regularised, 2 bristle
  double bristle_stiffness = 2e5;     ///< k_t [N/m]
  double bristle_damping = 1500.0;    ///< c, while sticking [N s/m]
  double bristle_relaxation = 200.0;  ///< eta, of bristle force above the friction limit [N s/m]
  double bristle_force_floor = 1.0;   ///< F0: keeps mu N away from zero [N]
};

/// The numbers of a contact law; `damping` may follow from a restitution.
inline constexpr LawNumber<ContactLaw> kContactNumbers[] = {
    {"stiffness", &ContactLaw::stiffness, "N/m", Rule::kPositive, false, "Stiffness of a contact"},
    {"node_stiffness", &ContactLaw::node_stiffness, "N/m", Rule::kPositive, false,
     "Stiffness of one node of a ring on the face of the other ring"},
    {"toe", &ContactLaw::toe, "m", Rule::kPositive, false,
     "Depth over which the stiffness of a contact builds up"},
    {"damping", &ContactLaw::damping, "s/m", Rule::kNotNegative, false,
     "Factor of the rate of depth on the elastic force"},
    {"regularisation", &ContactLaw::regularisation, "1", Rule::kPositive, false,
     "Regularisation of closest points"},
    {"friction_coefficient", &ContactLaw::friction_coefficient, "1", Rule::kNotNegative, false,
     "Coefficient of friction"},
    {"friction_speed", &ContactLaw::friction_speed, "m/s", Rule::kPositive, false,
     "Sliding speed at which regularised friction has 0.7 of its force"},
    {"bristle_stiffness", &ContactLaw::bristle_stiffness, "N/m", Rule::kPositive, false,
     "Stiffness of a bristle of friction"},
    {"bristle_damping", &ContactLaw::bristle_damping, "N.s/m", Rule::kNotNegative, false,
     "Damping of a bristle while it sticks"},
    {"bristle_relaxation", &ContactLaw::bristle_relaxation, "N.s/m", Rule::kPositive, false,
     "Relaxation of a bristle above the limit of friction"},
    {"bristle_force_floor", &ContactLaw::bristle_force_floor, "N", Rule::kPositive, false,
     "Least limit of friction in the decay of a bristle"},
};

/// Contact force: toe spring plus the barrier k w u^2/(1 - u)^2, u = (d - w)/w from half depth
/// w = rounding/2 on, without bound as d reaches `rounding` (where the cores meet).
template <class S>
Elastic<S> calc_contact_spring(const S& depth, const S& stiffness, const S& toe,
                               const S& rounding) {
  using std::log1p;
  Elastic<S> e = calc_toe_spring<S>(depth, stiffness, toe);
  const S w = rounding / S(2), u = (depth - w) / w;
  if (u > S(0)) {
    const S left = S(1) - u;
    e.force += stiffness * w * (u / left) * (u / left);
    e.energy += stiffness * w * w * (S(1) / left - left + S(2) * log1p(-u));
  }
  return e;
}

/// Tangential force on the second body [N], bristle rate [m/s], power turned into heat [W].
template <class S>
struct Friction {
  Vec3<S> force, bristle_rate;
  S power;
};

/// Regularised Coulomb friction -mu N v_t/sqrt(v_t^2 + v_s^2).
/// Limit: creeps when stuck, v = v_s T/sqrt((mu N)^2 - T^2) under a load T.
template <class S>
Friction<S> calc_regularised_friction(const ContactLaw& law, const S& normal_force,
                                      const Vec3<S>& v_t) {
  using std::sqrt;
  const S vs = S(law.friction_speed);
  const S drag = S(law.friction_coefficient) * normal_force / sqrt(v_t.squaredNorm() + vs * vs);
  return {v_t * -drag, Vec3<S>::Zero(), drag * v_t.squaredNorm()};
}

/// Elasto-plastic bristle (after Dupont, Hayward, Armstrong, Altpeter, IEEE TAC 47 (2002) 787,
/// here in three dimensions and with a varying normal force): spring force F_z = k_t z_t with
///     z' = v_t - (alpha |v_t|/max(mu N, F0) + max(0, |F_z| - mu N)/(eta |F_z|)) F_z - rest,
///     force = -(F_z + c_d v_t),
/// alpha = 0 below 0.9 mu N or when unloading; above mu N the cosine of the angle between F_z and
/// v_t, on a line 1. So the law stays continuous where the motion turns and the bristle begins to
/// unload: at a jump of the damping force steps would chatter.
/// z_t is the part of z in the tangent plane (unit normal n). As the normal turns, the part along n
/// (the "rest") relaxes at the rate k_t/eta, which in the limit is parallel transport of z.
/// Stored energy k_t |z|^2/2 with constant k_t: the power is a sum of squares for every N(t).
/// Limits: at most 1 ms (eta/k_t) late when N falls; the bristle force left at the moment of
/// opening is dropped; no torque about the normal.
template <class S>
Friction<S> calc_bristle_friction(const ContactLaw& law, const S& normal_force, const Vec3<S>& v_t,
                                  const Vec3<S>& n, const Vec3<S>& z) {
  using std::cos;
  using std::sqrt;
  const S k = S(law.bristle_stiffness), eta = S(law.bristle_relaxation);
  const S limit = S(law.friction_coefficient) * normal_force;
  const S z_n = n.dot(z);
  const Vec3<S> f_z = (z - n * z_n) * k;
  const S f = f_z.norm(), speed = v_t.norm();

  // Plastic share alpha: half-cosine between 0.9 and 1 of the limit, times cos(F_z, v_t).
  const S product = f_z.dot(v_t);
  S alpha = S(0);
  if (product > S(0) && f > S(0.9) * limit) {
    const S u = f < limit ? (f / limit - S(0.9)) / S(0.1) : S(1);
    alpha = product / (f * speed) * (S(1) - cos(S(EIGEN_PI) * u)) / S(2);
  }
  S slip = alpha * speed / std::max<S>(limit, S(law.bristle_force_floor));
  if (f > limit) slip += (f - limit) / (eta * f);

  // Damping, its force held below a tenth of the limit.
  const S cap = S(0.1) * limit, c = S(law.bristle_damping);
  const S drag =
      cap > S(0) ? c * (S(1) - alpha) * cap / sqrt(cap * cap + c * c * speed * speed) : S(0);
  return {-(f_z + v_t * drag), v_t - f_z * slip - n * (z_n * k / eta),
          slip * f * f + drag * speed * speed + k * k * z_n * z_n / eta};
}

/// Restitution e of one impact for c = lambda v_in: the root of c (1 + e) = ln((1 + c)/(1 - e c)).
/// It holds for every elastic force and mass: with the depth rate u as variable, m u du =
/// -F_el(d)(1 + lambda u) dd, and the integral of F_el inwards equals the integral
/// outwards.
double find_restitution(double c);

/// lambda [s/m] for which an impact at `speed` [m/s] has `restitution` (0 < restitution <= 1).
/// @throws ModelError for values outside.
double find_damping_for_restitution(double restitution, double speed);

}  // namespace dockloop
