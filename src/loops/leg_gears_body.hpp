// Gears: bodies that turn with joints of legs (LegGear), for any scalar. LEGS.md derives the
// formulas.
//
// The inertia of a gear is the same at every angle. Frozen it is a part of its carrier; what turns
// is a momentum along a fixed axis. Gears on tube or rod are constants of their leg (legs::kSpin).
// The functions below add the gears on the root to the sums over legs, and find what the couplings
// of all gears transmit.
#pragma once

#include "loops/leg_store_body.hpp"
#include "loops/loops.hpp"

namespace dockloop {
namespace {

/// Rates of the joints of one leg per twist of the platform.
template <class S>
Eigen::Matrix<S, 3, 6> find_rates_per_twist(const PlatformData<S>& at, const LegPlace& leg) {
  Mat3<S> axes, rows;  // E in C; inverse of the loop matrix, rows as columns
  for (int i = 0; i < 9; ++i) {
    axes(i % 3, i / 3) = at.store.work(leg, legs::kAxesC + i);
    rows(i % 3, i / 3) = at.store.work(leg, legs::kInverse + i);
  }
  const Vec3<S> ring = cast<S>(leg.ring);
  Eigen::Matrix<S, 3, 6> rates;
  for (int i = 0; i < 3; ++i) {
    const Vec3<S> force = S(leg.sign[i]) * (axes * rows.col(i)), moment = ring.cross(force);
    rates.row(i) << force.transpose(), moment.transpose();
  }
  return rates;
}

/// Sum over the terms of a gear. @param get  value of a joint of a leg
template <class S, class Get>
S find_gear_sum(const PlatformData<S>& at, const GearData<S>& gear, const Get& get) {
  S sum(0);
  for (const auto& term : gear.terms) sum += S(term.ratio) * get(at.legs[term.leg], term.joint);
  return sum;
}

/// @pre coordinates of the joints of its legs
template <class S>
void put_gear_coordinate(const PlatformData<S>& at, const GearData<S>& gear, TreeData<S>& tree) {
  tree.q[gear.q] = S(gear.constant) + find_gear_sum(at, gear, [&](const LegPlace& leg, int i) {
                     return tree.q[leg.q[i]];
                   });
}

template <class S>
S find_gear_rate(const PlatformData<S>& at, const GearData<S>& gear) {
  return find_gear_sum(at, gear, [&](const LegPlace& leg, int i) {
    return S(S(leg.sign[i]) * at.store.work(leg, legs::kRate + i));
  });
}

/// Acceleration of a joint of a leg while the twist of the platform rests. @pre calc_bias
template <class S>
S find_free_acceleration(const PlatformData<S>& at, const LegPlace& leg, int i) {
  S sum(0);
  for (int j = 0; j < 3; ++j) {
    sum += at.store.work(leg, legs::kInverse + 3 * i + j) * at.store.work(leg, legs::kTipFree + j);
  }
  return S(leg.sign[i]) * sum;
}

template <class S>
S find_free_acceleration(const PlatformData<S>& at, const GearData<S>& gear) {
  return find_gear_sum(
      at, gear, [&](const LegPlace& leg, int i) { return find_free_acceleration(at, leg, i); });
}

/// Rates of gears on the root per twist of C. @pre positions of the legs
template <class S>
void calc_gear_rows(PlatformData<S>& at) {
  for (GearData<S>& gear : at.gears) {
    if (gear.on_root) gear.row.setZero();
  }
  for (size_t k = 0; k < at.legs.size(); ++k) {
    Eigen::Matrix<S, 3, 6> rates;
    bool is_found = false;
    for (GearData<S>& gear : at.gears) {
      for (const auto& term : gear.terms) {
        if (!gear.on_root || term.leg != k) continue;
        if (!is_found) rates = find_rates_per_twist(at, at.legs[k]);
        is_found = true;
        gear.row += S(term.ratio) * rates.row(term.joint).transpose();
      }
    }
  }
}

/// What a gear on the root adds to the sums over legs. @param moving  also what R carries
template <class S>
void add_gear_inertia(const GearData<S>& gear, bool moving, S* sums) {
  const Vec3<S> v = gear.row.template head<3>(), w = gear.row.template tail<3>();
  const auto add_symmetric = [&](int at, const S& factor, const Vec3<S>& x) {
    const S cells[] = {x[0] * x[0], x[1] * x[1], x[2] * x[2],
                       x[0] * x[1], x[0] * x[2], x[1] * x[2]};
    for (int i = 0; i < 6; ++i) sums[at + i] += factor * cells[i];
  };
  add_symmetric(legs::kSumA, gear.inertia, v);
  add_symmetric(legs::kSumD, gear.inertia, w);
  for (int i = 0; i < 9; ++i) sums[legs::kSumK + i] += gear.inertia * w[i % 3] * v[i / 3];
  if (!moving) return;
  const Vec6<S> cells = get_components(gear.frozen);
  for (int i = 0; i < 3; ++i) sums[legs::kSumH + i] += gear.first_moment[i];
  for (int i = 0; i < 6; ++i) sums[legs::kSumJ + i] += cells[i];
  const Vec3<S> momentum = gear.inertia * gear.axis;  // per rate
  for (int i = 0; i < 9; ++i) {
    sums[legs::kSumAV + i] += momentum[i / 3] * v[i % 3];
    sums[legs::kSumAW + i] += momentum[i / 3] * w[i % 3];
  }
}

/// Positions of the legs and all sums of the platform.
template <class S>
bool calc_position_sums(PlatformData<S>& at, bool moving, double least) {
  if (!at.store.calc_position(at.motion, moving, least, at.sums.data())) return false;
  if (at.gears.empty()) return true;
  calc_gear_rows(at);
  for (const GearData<S>& gear : at.gears) {
    if (gear.on_root) add_gear_inertia(gear, moving, at.sums.data());
  }
  return true;
}

/// What moves a gear on a root that does not accelerate, about the origin of R, R.
/// @param w  angular velocity of R, R. @param rate, acceleration  of the gear
template <class S>
Wrench<S> find_gear_load(const GearData<S>& gear, const Vec3<S>& w, const S& rate,
                         const S& acceleration) {
  const Vec3<S> momentum = gear.inertia * gear.axis;
  const Vec3<S> turned = w.cross(gear.frozen * w) + rate * w.cross(momentum);
  return {w.cross(w.cross(gear.first_moment)), turned + acceleration * momentum};
}

/// Loads of the gears on the root at zero joint accelerations, into the sums of bias.
template <class S>
void add_gear_biases(bool moving, PlatformData<S>& at) {
  for (const GearData<S>& gear : at.gears) {
    if (!gear.on_root) continue;
    const S free = find_free_acceleration(at, gear);
    const S torque = gear.inertia * free;
    as_vector(&at.bias[legs::kSumTipForce]) += torque * gear.row.template head<3>();
    as_vector(&at.bias[legs::kSumTipMoment]) += torque * gear.row.template tail<3>();
    if (!moving) continue;
    const Wrench<S> load =
        find_gear_load<S>(gear, as_vector(at.motion.root), find_gear_rate(at, gear), free);
    as_vector(&at.bias[legs::kSumRootForce]) += load.f;
    as_vector(&at.bias[legs::kSumRootMoment]) += load.t;
  }
}

/// A torque on the joint of a gear, onto the joints of legs that turn the gear.
template <class S>
void press_legs(const GearData<S>& gear, const S& torque, PlatformData<S>& at) {
  for (const auto& term : gear.terms) {
    const LegPlace& leg = at.legs[term.leg];
    at.store.work(leg, legs::kForce + term.joint) += S(leg.sign[term.joint] * term.ratio) * torque;
  }
}

/// Acceleration of a gear on the root. @pre calc_bias; motion.dot_v, dot_w
template <class S>
S find_gear_acceleration(const PlatformData<S>& at, const GearData<S>& gear) {
  return find_free_acceleration(at, gear) +
         gear.row.template head<3>().dot(as_vector(at.motion.dot_v)) +
         gear.row.template tail<3>().dot(as_vector(at.motion.dot_w));
}

/// Loads of legs and gears at the accelerations of at.motion; the legs feel the gears on the root.
template <class S>
void calc_load_sums(PlatformData<S>& at, std::array<S, legs::kLoadSums>& sums) {
  const Vec3<S> a = as_vector(at.motion.root_a), alpha = as_vector(at.motion.root_alpha);
  for (size_t k = 0; k < at.legs.size() && !at.gears.empty(); ++k) {
    for (int i = 0; i < 3; ++i) at.force[k][i] = at.store.work(at.legs[k], legs::kForce + i);
  }
  for (const GearData<S>& gear : at.gears) {
    if (!gear.on_root) continue;
    const S torque = gear.inertia * (find_gear_acceleration(at, gear) + gear.axis.dot(alpha));
    press_legs(gear, S(-torque), at);
  }
  at.store.calc_loads(at.motion, sums.data());
  for (size_t k = 0; k < at.legs.size() && !at.gears.empty(); ++k) {
    for (int i = 0; i < 3; ++i) at.store.work(at.legs[k], legs::kForce + i) = at.force[k][i];
  }
  for (const GearData<S>& gear : at.gears) {
    if (!gear.on_root) continue;
    const Wrench<S> load =
        find_gear_load<S>(gear, as_vector(at.motion.root), find_gear_rate(at, gear),
                          find_gear_acceleration(at, gear));
    as_vector(&sums[legs::kSumLoad]) += load.f + gear.mass * a + alpha.cross(gear.first_moment);
    as_vector(&sums[legs::kSumLoadMoment]) +=
        load.t + gear.frozen * alpha + gear.first_moment.cross(a);
  }
}

/// Forces of the couplings of gears, last first: a gear also turns those that name it.
/// @pre calc_load_sums
template <class S>
void calc_gear_forces(const MechanismModel& model, const LoopPlan& plan, const PlatformData<S>& at,
                      LoopData<S>& loops) {
  for (auto gear = at.gears.rbegin(); gear != at.gears.rend(); ++gear) {
    const S along =
        gear->on_root ? S(gear->axis.dot(as_vector(at.motion.root_alpha)))
                      : S(gear->axis[0] * at.store.work(at.legs[gear->terms[0].leg], legs::kAlong));
    const S turning = find_gear_sum(at, *gear, [&](const LegPlace& leg, int i) {
      return S(S(leg.sign[i]) * at.store.work(leg, legs::kJoint + i));
    });
    S torque = gear->inertia * (turning + along) - gear->torque;
    for (auto other = at.gears.rbegin(); other != gear; ++other) {
      const Loop& loop = model.loops[plan.blocks[other->block].loops[0]];
      torque -= S(find_coupling_factor(loop, gear->body)) * loops.block[other->block].lambda[0];
    }
    const Loop& own = model.loops[plan.blocks[gear->block].loops[0]];
    loops.block[gear->block].lambda[0] = torque / S(find_coupling_factor(own, gear->body));
  }
}

}  // namespace
}  // namespace dockloop
