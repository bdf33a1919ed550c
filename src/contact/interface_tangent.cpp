// Sums over closed pairs and latches; see interface_tangent.hpp.
#include "contact/interface_tangent.hpp"

#include <algorithm>
#include <cmath>

namespace dockloop {
namespace {

/// Slope of calc_toe_spring().
double find_toe_slope(double depth, double stiffness, double toe) {
  return depth <= 0.0 ? 0.0 : stiffness * std::min(1.0, depth / toe);
}

/// Slope of calc_contact_spring().
double find_contact_slope(double depth, double stiffness, double toe, double rounding) {
  const double w = rounding / 2.0, u = (depth - w) / w, left = 1.0 - u;
  const double barrier = u > 0.0 ? 2.0 * stiffness * u / (left * left * left) : 0.0;
  return find_toe_slope(depth, stiffness, toe) + barrier;
}

/// A direction at a point, as a wrench about the origin from which `arm` leads there.
Vec6<double> make_line(const Vec3<double>& direction, const Vec3<double>& arm) {
  Vec6<double> line;
  line << direction, arm.cross(direction);
  return line;
}

/// A place of a closed pair.
struct Pressed {
  Vec3<double> n, at;  ///< not normalised; axes of G
  double depth;        ///< [m]
  int sign;            ///< of Place
};

/// Of a node, which is evaluated with others.
Pressed find_pressed_node(const ContactModel& model, int i, const RelativeMotion<double>& motion,
                          const ContactWorkspace<double>& work) {
  const ContactPair& pair = model.pairs[i];
  const Vec3<double>& way = work.way[i];
  const double root = way.norm();
  const Vec3<double> at =
      pair.first_on_passive
          ? Vec3<double>(motion.R * model.passive[pair.first].point + motion.p - way / 2.0)
          : Vec3<double>(model.active[pair.first].point + way / 2.0);
  return {way / root, at, pair.rounding - root, 1};
}

void add_place(const ContactModel& model, int i, const RelativeMotion<double>& motion,
               const Pressed& pressed, InterfaceTangent& tangent) {
  const ContactPair& pair = model.pairs[i];
  const ContactLaw& law = model.laws[pair.law];
  const auto [n, at, depth, sign] = pressed;
  const Vec3<double> arm = at - motion.p, v = motion.v + motion.w.cross(arm);
  const double k = law.stiffness;
  const double elastic = calc_contact_spring<double>(depth, k, law.toe, pair.rounding).force;
  const double phi = 1.0 - law.damping * n.dot(v);
  if (!(phi > 0.0)) return;  // the surfaces part faster than the force can push

  const Vec3<double> e = n.normalized(), v_t = v - e * e.dot(v);
  const double square = v_t.squaredNorm(), least = law.friction_speed * law.friction_speed;
  const double s = std::sqrt(square + least), mu = law.friction_coefficient;
  const double slope = phi * find_contact_slope(depth, k, law.toe, pair.rounding);
  const Vec6<double> a = sign * make_line(n - mu / s * v_t, at), b = make_line(n, arm);
  const Vec6<double> push = -slope * a, drag = -law.damping * elastic * a;
  tangent.stiffness.noalias() += push * b.transpose();
  tangent.damping.noalias() += drag * b.transpose();

  const double weight = sign * mu * elastic * phi / s;
  if (weight == 0.0) return;
  // Without slip any direction across serves.
  const Vec3<double> across = square > 1e-12 * least ? v_t : Vec3<double>(e.unitOrthogonal());
  const Vec3<double> t1 = across.normalized(), t2 = e.cross(t1);
  const Vec6<double> a1 = -weight * (1.0 - square / (s * s)) * make_line(t1, at);
  const Vec6<double> a2 = -weight * make_line(t2, at), b1 = make_line(t1, arm),
                     b2 = make_line(t2, arm);
  tangent.damping.noalias() += a1 * b1.transpose();
  tangent.damping.noalias() += a2 * b2.transpose();
}

void add_absorber(const AbsorberLaw& law, Acting acting, const RelativeMotion<double>& motion,
                  const ContactResult<double>& result, InterfaceTangent& tangent) {
  const bool acts = acting == Acting::kByState ? result.pressed > 0.0 : acting == Acting::kYes;
  if (!acts) return;
  const Vec6<double> a = make_line(Vec3<double>::UnitX(), motion.p);
  tangent.stiffness.col(0) -= law.stiffness * a;
  tangent.damping.col(0) -= law.damping * a;
}

/// Slopes of the force along x on the striker, by opening and by its rate.
struct LatchSlopes {
  double stiffness = 0.0, damping = 0.0;
};

LatchSlopes find_slopes(const LatchLaw& law, const LatchState& state, double t,
                        const LatchMotion& motion) {
  if (state.mode == LatchMode::kSpent) return {};
  if (state.mode == LatchMode::kOpen) {
    const double range = law.pawl_range - law.catch_distance;
    const double b = 1.0 - (motion.s[0] - law.catch_distance) / range;
    const double aside = find_length(motion.s[1], motion.s[2]) - law.window;
    if (b <= 0.0 || b >= 1.0 || aside >= law.window) return {};
    const double u = std::max(0.0, aside / law.window), fade = 1.0 - u * u;
    const double angle = static_cast<double>(EIGEN_PI) * b;
    return {-law.push_force * static_cast<double>(EIGEN_PI) / range * std::sin(2.0 * angle) * fade *
                fade,
            0.0};
  }
  double grip = 1.0;
  if (state.mode == LatchMode::kReleasing) {
    const double u = clamp_unit((t - state.release_time) / law.release_ramp);
    grip = 1.0 - calc_ramp(u, law.release_ramp).share;
  }
  const double phi = 1.0 + law.hold_damping * motion.rate[0], stretch = motion.s[0] - law.play;
  if (!(phi > 0.0)) return {};
  const double elastic = calc_toe_spring<double>(stretch, law.hold_stiffness, law.hold_toe).force;
  return {-grip * phi * find_toe_slope(stretch, law.hold_stiffness, law.hold_toe),
          -grip * law.hold_damping * elastic};
}

}  // namespace

void add_contact_tangent(const ContactModel& model, int body, const ContactMemory& memory,
                         const HardwareMotion<double>& motion, const ContactWorkspace<double>& work,
                         const ContactResult<double>& result, InterfaceTangent& tangent) {
  if (model.kind == ContactModel::Kind::kAbsorber) {
    add_absorber(model.absorber, memory.absorber, motion, result, tangent);
  }
  if (!model.has_surfaces() || result.active_count == 0) return;
  const ActiveBody& of = model.bodies[body];
  const RelativeMotion<double>& to = motion.of(body);
  auto place = std::find_if(work.touching.begin(), work.touching.end(),
                            [&](const Touching& each) { return each.pair >= of.first; });
  for (int i = of.first; i < of.first + of.count; ++i) {
    if (!work.closed[i]) continue;
    if (model.pairs[i].node_set >= 0) {
      add_place(model, i, to, find_pressed_node(model, i, to, work), tangent);
      continue;
    }
    for (; place != work.touching.end() && place->pair == i; ++place) {
      const double depth = model.pairs[i].rounding - place->root;
      add_place(model, i, to, {place->way / place->root, place->middle, depth, place->sign},
                tangent);
    }
  }
}

void add_latch_tangent(const LatchSet& set, const LatchState* state, double t,
                       const RelativeMotion<double>& motion, InterfaceTangent& tangent) {
  for (int i = 0; i < set.count(); ++i) {
    const Latch& latch = set.latch[i];
    const LatchMotion moving = find_latch_motion(set, i, motion);
    const LatchSlopes slopes = find_slopes(latch.law, state[i], t, moving);
    if (slopes.stiffness == 0.0 && slopes.damping == 0.0) continue;
    // Of the axis along which it holds, and where the force acts on P.
    const bool by_plane = latch.measure == LatchMeasure::kPassivePlane;
    const Vec3<double> x = by_plane ? Vec3<double>(motion.R.col(0)) : Vec3<double>::UnitX();
    const Vec3<double> at =
        by_plane ? latch.hook : Vec3<double>(motion.p + motion.R * latch.striker);
    const Vec6<double> a = make_line(x, at), b = make_line(x, at - motion.p);
    tangent.stiffness.noalias() += slopes.stiffness * a * b.transpose();
    tangent.damping.noalias() += slopes.damping * a * b.transpose();
  }
}

}  // namespace dockloop
