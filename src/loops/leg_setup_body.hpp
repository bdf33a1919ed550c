// What a platform on legs knows before the first evaluation: constants of legs and gears, and the
// joints whose motion is found in every evaluation.
#pragma once

#include "loops/closed_form_body.hpp"
#include "loops/leg_store_body.hpp"

namespace dockloop {

namespace {

/// Mass, first moment, inertia about an origin.
template <class N>
struct BodyMoments {
  N mass = N(0);
  Vec3<N> first = Vec3<N>::Zero();
  Mat3<N> inertia = Mat3<N>::Zero();
};

/// Of a body, about the origin of axes in which it has this pose.
template <class N>
BodyMoments<N> find_moments(const Body& body, const Pose<N>& pose) {
  const Vec3<N> c = pose.R * cast<N>(body.com) + pose.p;
  const N mass(body.mass);
  return {mass, mass * c,
          pose.R * cast<N>(body.inertia) * pose.R.transpose() + find_point_inertia(mass, c)};
}

/// A rotation matrix to the digits of its numbers. @param R  one to rounding of doubles
template <class N>
Mat3<N> find_rotation(const Mat3<double>& R) {
  Mat3<N> m = cast<N>(R);
  if constexpr (!std::is_same_v<N, double>) {
    for (int i = 0; i < 2; ++i) {  // twice as many digits each time
      m = (N(0.5) * m * (N(3) * Mat3<N>::Identity() - m.transpose() * m)).eval();
    }
  }
  return m;
}

/// Inertia about the axis of a joint that turns.
inline double find_axial_inertia(const Body& body) {
  return body.axis.dot(body.inertia * body.axis);
}

/// Constants of a leg (legs::Parameter).
template <class N>
using LegConstants = std::array<N, legs::kParameters>;

/// With the gears that its bodies carry.
template <class N>
LegConstants<N> find_leg_constants(const MechanismModel& model, const LegPlatform& platform,
                                   const LegPlace& place) {
  const ClosedForm& form = place.form;
  LegConstants<N> made;
  const auto put = [&](int row, const N& x) { made[static_cast<size_t>(row)] = x; };
  const auto put_vector = [&](int row, const Vec3<N>& x) {
    for (int i = 0; i < 3; ++i) put(row + i, x[i]);
  };
  const auto put_moments = [&](int row, const BodyMoments<N>& of) {
    const Vec6<N> cells = get_components(of.inertia);
    put(row, of.mass);
    put_vector(row + 1, of.first);
    for (int i = 0; i < 6; ++i) put(row + 4 + i, cells[i]);
  };
  Mat3<double> axes = form.in_parent.R;
  Vec3<double> elbow(form.shape.l1, 0.0, form.shape.height), tip = form.shape.tip;
  int axis = form.kind == LegKind::kR2P1R3 ? 1 : 2;  // of the first joint
  if (form.kind == LegKind::kR2P1R3) elbow.setZero();
  if (form.kind == LegKind::kR1R2R3Perpendicular) {  // its second joint must turn about z
    axes << form.in_parent.R.col(2), form.in_parent.R.col(0), form.in_parent.R.col(1);
    elbow = {form.shape.height, form.shape.l1, 0.0};
    tip = {0.0, form.shape.l2, 0.0};
    axis = 0;
  }
  const Pose<N> K{find_rotation<N>(axes), cast<N>(form.in_parent.p)};
  for (int i = 0; i < 3; ++i) put_vector(legs::kAxesK + 3 * i, K.R.col(i));
  put_vector(legs::kCentre, K.p);
  put_vector(legs::kCentreK, K.R.transpose() * K.p);
  put_vector(legs::kRing, cast<N>(place.ring));
  put_vector(legs::kTip, cast<N>(tip));
  put(legs::kElbow, N(form.branch.elbow));
  put(legs::kFlip, N(form.branch.flip));
  put(legs::kCrank, N(form.shape.l1));
  put(legs::kCrank + 1, N(form.shape.height));
  // The three bodies at canonical coordinates zero, axes K; the outer two about the elbow.
  Pose<N> pose = inverse(K);
  BodyMoments<N> moments[3];
  N spin(0), reflected(0);
  for (size_t i = 0; i < 3; ++i) {
    const JointMap& joint = form.joint[i];
    const Body& body = model.bodies[joint.body];
    pose = pose * Pose<N>{cast<N>(body.placement.R), cast<N>(body.placement.p)};
    // theta = sign q + zero = 0
    if (body.joint == JointType::kRevolute) {
      pose.R = pose.R * axis_rotation<N>(cast<N>(body.axis), N(joint.c), N(-joint.sign * joint.s));
    }
    moments[i] =
        find_moments<N>(body, {pose.R, i == 0 ? pose.p : Vec3<N>(pose.p - cast<N>(elbow))});
    for (const LegGear& gear : platform.gears) {
      if (gear.carrier != joint.body) continue;
      const Body& rotor = model.bodies[gear.body];
      const Pose<N> at = pose * Pose<N>{cast<N>(rotor.placement.R), cast<N>(rotor.placement.p)};
      const BodyMoments<N> own = find_moments<N>(rotor, {at.R, Vec3<N>(at.p - cast<N>(elbow))});
      moments[i].mass += own.mass;
      moments[i].first += own.first;
      moments[i].inertia += own.inertia;
      const N ratio = N(gear.terms[0].ratio) * (at.R * cast<N>(rotor.axis))[0];
      spin += N(find_axial_inertia(rotor)) * ratio;
      reflected += N(find_axial_inertia(rotor)) * ratio * ratio;
    }
  }
  put_moments(legs::kCross, moments[0]);
  put_moments(legs::kTube, moments[1]);
  put_moments(legs::kRod, moments[2]);
  elbow[axis] = 0.0;
  put(legs::kTurned, moments[0].inertia(axis, axis) +
                         (moments[1].mass + moments[2].mass) * N(elbow.squaredNorm()));
  put(legs::kSpin, spin);
  put(legs::kSpin + 1, reflected);
  return made;
}

/// Is a slide leg one of legs::kAxialSlideLeg, but for rounding?
template <class N>
bool is_axial(const LegConstants<N>& of) {
  constexpr double kOffAxis = std::is_same_v<N, double> ? 1e-15 : 0.0;  // [m]
  const auto is_on_axis = [&](int row, const N& mass) {
    const N bound = N(kOffAxis) * mass;
    return abs(of[static_cast<size_t>(row)]) <= bound;
  };
  bool axial = of[legs::kCross] == N(0);
  for (int i = 1; i < 3; ++i) axial = axial && is_on_axis(legs::kTip + i, N(1));
  for (const int body : {legs::kTube, legs::kRod}) {
    const N &mass = of[body], inertia = of[body + 4] + of[body + 5] + of[body + 6];
    for (int i = 2; i < 4; ++i) axial = axial && is_on_axis(body + i, mass);
    for (int i = 7; i < 10; ++i) axial = axial && is_on_axis(body + i, inertia);
  }
  return axial;
}

/// Does a force element act on the joint of this body?
inline bool has_element(const MechanismModel& model, int body) {
  for (const ForceElement& element : model.elements) {
    for (const ElementTerm& term : element.along) {
      if (term.body == body) return true;
    }
  }
  return false;
}

/// Does a reported gear turn with this joint?
template <class S>
bool has_gear(const PlatformData<S>& at, size_t leg, int joint) {
  for (const GearData<S>& gear : at.gears) {
    for (const auto& term : gear.terms) {
      if (gear.is_reported && term.leg == leg && term.joint == joint) return true;
    }
  }
  return false;
}

template <class S>
void list_reported_joints(const MechanismModel& model, PlatformData<S>& at) {
  for (GearData<S>& gear : at.gears) {
    gear.is_reported = has_element(model, gear.body);
    for (const JointForce& law : model.forces) {
      gear.is_reported = gear.is_reported || law.body == gear.body;
    }
  }
  for (size_t k = 0; k < at.legs.size(); ++k) {
    for (int i = 0; i < 3; ++i) {
      const int body = at.legs[k].body[i];
      ReportedJoint joint{k, i, model.bodies[body].joint == JointType::kPrismatic, false};
      bool forced = has_element(model, body) || has_gear(at, k, i);
      joint.needs_angle = forced && !joint.slides;
      for (const JointForce& law : model.forces) {
        if (law.body != body) continue;
        forced = true;
        joint.needs_angle = joint.needs_angle || (!joint.slides && law.is_stated);
      }
      if (!joint.slides && !forced) continue;
      at.angles[i] = at.angles[i] || joint.needs_angle;
      at.reported.push_back(joint);
    }
  }
}

/// @param legs  of the platform
template <class S>
GearData<S> make_gear(const MechanismModel& model, const LegPlatform& platform, const LegGear& gear,
                      const std::vector<LegPlace>& legs) {
  using N = typename LegStore<S>::Constant;
  const Body& body = model.bodies[gear.body];
  GearData<S> made;
  made.body = gear.body;
  made.carrier = gear.carrier;
  made.block = gear.block;
  made.q = body.q_index;
  made.v = body.v_index;
  made.constant = gear.constant;
  for (const CouplingTerm& term : gear.terms) {
    for (size_t k = 0; k < legs.size(); ++k) {
      for (int i = 0; i < 3; ++i) {
        if (legs[k].body[i] == term.body) made.terms.push_back({k, i, term.ratio});
      }
    }
  }
  made.on_root = gear.carrier == platform.root;
  made.inertia = S(find_axial_inertia(body));
  made.axis = cast<S>(Vec3<N>(cast<N>(body.placement.R) * cast<N>(body.axis)));
  if (!made.on_root) {
    const LegPlace& leg = legs[made.terms[0].leg];
    const Body& rod = model.bodies[leg.body[2]];
    Vec3<double> slide = leg.sign[2] * rod.axis;  // axes of the carrier
    if (gear.carrier != leg.body[2]) slide = rod.placement.R * slide;
    made.axis = Vec3<S>(S(slide.dot(body.placement.R * body.axis)), S(0), S(0));
  }
  return made;
}

/// Which couplings name which gears. A coupling names its own gear and earlier ones.
template <class S>
void list_gear_users(const MechanismModel& model, const LoopPlan& plan,
                     std::vector<GearData<S>>& gears) {
  const auto find_factor = [&](const GearData<S>& user, int body) {
    return find_coupling_factor(model.loops[plan.blocks[user.block].loops[0]], body);
  };
  for (size_t i = 0; i < gears.size(); ++i) {
    gears[i].factor = find_factor(gears[i], gears[i].body);
    for (size_t j = gears.size(); --j > i;) {
      const double factor = find_factor(gears[j], gears[i].body);
      if (factor != 0.0) gears[i].users.push_back({j, factor});
    }
  }
}

/// A gear on the root takes its part in the inertia of the joints that turn it.
template <class S>
void add_to_train(const Body& body, const GearData<S>& gear, GearTrain<S>& train) {
  using N = typename LegStore<S>::Constant;
  const Pose<N> pose{cast<N>(body.placement.R), cast<N>(body.placement.p)};
  const BodyMoments<N> moments = find_moments<N>(body, pose);
  train.mass += S(moments.mass);
  train.first_moment += cast<S>(moments.first);
  train.frozen += cast<S>(moments.inertia);
  std::vector<S> ratio(train.joints.size(), S(0));
  for (const auto& term : gear.terms) {
    const auto same = [&](const auto& joint) {
      return joint.leg == term.leg && joint.joint == term.joint;
    };
    const auto found = std::find_if(train.joints.begin(), train.joints.end(), same);
    if (found == train.joints.end()) {
      train.joints.push_back({term.leg, term.joint});
      ratio.push_back(S(term.ratio));
    } else {
      ratio[static_cast<size_t>(found - train.joints.begin())] += S(term.ratio);
    }
  }
  train.inertia.resize(ratio.size());
  for (size_t i = 0; i < ratio.size(); ++i) {
    train.inertia[i].resize(ratio.size(), S(0));
    for (size_t j = 0; j < ratio.size(); ++j) {
      train.inertia[i][j] += gear.inertia * ratio[i] * ratio[j];
    }
    train.joints[i].momentum += gear.inertia * ratio[i] * gear.axis;
  }
}

}  // namespace

template <class S>
PlatformData<S>::PlatformData(const MechanismModel& model, const LoopPlan& plan,
                              const LegPlatform& platform) {
  using N = typename LegStore<S>::Constant;
  std::vector<std::pair<LegPlace, LegConstants<N>>> found;
  for (int b : platform.blocks) {
    LegPlace place;
    place.block = b;
    place.form = *plan.blocks[b].form();
    place.ring = model.loops[plan.blocks[b].loops[0]].point_on_closing;
    for (int i = 0; i < 3; ++i) {
      const Body& body = model.bodies[place.form.joint[i].body];
      place.body.push_back(place.form.joint[i].body);
      place.q[i] = body.q_index;
      place.v[i] = body.v_index;
      place.sign[i] = place.form.joint[i].sign;
      mass += S(body.mass);
    }
    const LegConstants<N> constants = find_leg_constants<N>(model, platform, place);
    place.type = get_leg_type(place.form.kind);
    if (place.type == legs::kSlideLeg && is_axial(constants)) place.type = legs::kAxialSlideLeg;
    found.emplace_back(place, constants);
  }
  // Legs of one type stand side by side.
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first.type < b.first.type; });
  for (auto& [place, constants] : found) {
    store.add(place);
    for (int i = 0; i < legs::kParameters; ++i) {
      store.put(place, i, constants[static_cast<size_t>(i)]);
    }
    legs.push_back(place);
  }
  store.finish();
  for (const LegGear& gear : platform.gears) {
    gears.push_back(make_gear<S>(model, platform, gear, legs));
    if (gears.back().on_root) add_to_train(model.bodies[gear.body], gears.back(), train);
    gear_bodies.push_back(gear.body);
    mass += S(model.bodies[gear.body].mass);
  }
  list_gear_users(model, plan, gears);
  force.resize(legs.size());
  list_reported_joints(model, *this);
  if (!platform.is_free) pose.resize(platform.path.size());
  J.setZero(6, static_cast<int>(platform.low.size()));
  if (platform.is_free) J.setIdentity();
  sums.fill(S(0));
  bias.fill(S(0));
  motion = {};
}

}  // namespace dockloop
