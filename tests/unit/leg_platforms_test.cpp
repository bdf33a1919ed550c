// Platforms on legs, whose legs are eliminated at their tips, against Newton iteration on the whole
// tree.
// 1. everything that an evaluation finds: coordinates, rates, accelerations, reactions, joint
// loads,
//    momentum, energy: legs of three kinds and all of them together, on a base at rest, on a driven
//    base under gravity, on a free vehicle, with a chain of joints between root and platform, on a
//    root that moves on the base, with a platform on a platform, with loads on bodies of legs,
//    without mass, with gears: rotors on legs, shafts on the root;
// 2. the same bits with two, four and eight lanes;
// 3. derivatives (dual numbers) against differences, 32 digits against double;
// 4. near a singular pose legs follow the branch that continues the motion, and what cannot be
// reached
//    is refused with its name and margin;
// 5. three to sixty legs; angles are right all around, and go on counting turns.
#include "loops/leg_platforms.hpp"

#include <gtest/gtest.h>

#include "mechanism/mechanism_jacobian.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

enum class Root { kQuiescent, kDriven, kFree };

struct LegCase {
  const char* name;
  Root root = Root::kQuiescent;
  std::vector<LegKind> legs;
  std::vector<JointType> path = {JointType::kFree};  ///< from root body to platform
  bool on_carriage = false;                          ///< the legs hang on a body that slides
  bool stacked = false;                              ///< a second platform on legs on the first
  bool loaded = false;                               ///< loads on bodies of legs
  bool massless = false;                             ///< legs without mass
  bool geared = false;                               ///< rotors on legs, shafts on the root
};

/// A joint of a leg in its canonical axes (closed_form.hpp) and where it stands at home.
struct LegStep {
  JointType type;
  Vec3<double> axis, point;  ///< point: on the body before, at its coordinate 0
  double home;
};

std::vector<LegStep> find_steps(LegKind kind, const Vec3<double>& elbow, double elbow_side) {
  const auto x = Vec3<double>::UnitX(), y = Vec3<double>::UnitY(), z = Vec3<double>::UnitZ();
  const Vec3<double> o = Vec3<double>::Zero();
  const JointType turn = JointType::kRevolute;
  if (kind == LegKind::kR2P1R3) {
    return {{turn, y, o, 0.2}, {turn, z, o, 0.3}, {JointType::kPrismatic, x, o, 0.1}};
  }
  if (kind == LegKind::kR1R2R3) {
    return {{turn, z, o, 0.3}, {turn, z, elbow, 1.1 * elbow_side}, {turn, y, o, -0.3}};
  }
  return {{turn, z, o, 0.3}, {turn, y, elbow, 0.4}, {turn, z, o, 0.8 * elbow_side}};
}

/// Bodies from `root` outwards, joined by these joints; the last one is a ring.
int add_path(const std::vector<JointType>& joints, int root, TestRandom& random,
             MechanismModel& model) {
  int parent = root;
  for (const JointType joint : joints) {
    Body body;
    body.name = "path_" + std::to_string(model.bodies.size());
    body.parent = parent;
    body.joint = joint;
    body.axis = make_unit(random);
    body.placement = {rotation_of(random.vector(0.3)), random.vector(0.2)};
    body.mass = random.uniform(5.0, 30.0);
    body.com = random.vector(0.1);
    body.inertia = make_inertia(random, body.mass, 0.4);
    parent = static_cast<int>(model.bodies.size());
    model.bodies.push_back(body);
    if (joint == JointType::kFree) {
      for (const double q : {0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0}) model.home_q.push_back(q);
    } else {
      model.home_q.push_back(0.1);
    }
  }
  return parent;
}

/// Legs between two bodies, these kinds by turns: body axes, zeros and signs of joints, dimensions
/// and elbow sides at random, springs on first and last joints.
void add_legs(const std::vector<LegKind>& kinds, int root, int ring, size_t count, bool has_mass,
              TestRandom& random, MechanismModel& model) {
  number_coordinates(model);
  const std::vector<Pose<double>> home = find_poses(model, model.home_q);
  Pose<double> ring_in_root = home[static_cast<size_t>(ring)];
  if (root != kBase) ring_in_root = inverse(home[static_cast<size_t>(root)]) * ring_in_root;
  for (size_t k = 0; k < count; ++k) {
    const LegKind kind = kinds[k % kinds.size()];
    const double side = random.uniform(-1.0, 1.0) < 0.0 ? -1.0 : 1.0;
    const Vec3<double> elbow(random.uniform(0.25, 0.4), 0.0, random.uniform(-0.1, 0.1));
    Vec3<double> tip(random.uniform(0.4, 0.6), 0.03, -0.05);
    if (kind == LegKind::kR1R2R3Perpendicular) tip.tail<2>().setZero();
    Pose<double> before{rotation_of(random.vector(2.0)), Vec3<double>::Zero()};  // canonical axes
    Pose<double> at = before;
    int parent = root;
    Loop loop;
    loop.name = "leg" + std::to_string(model.loops.size() + 1);
    loop.root = root;
    for (const LegStep& step : find_steps(kind, elbow, side)) {
      const Mat3<double> axes = rotation_of(random.vector(2.0));
      const bool turns = step.type == JointType::kRevolute;
      const double sign = random.uniform(-1.0, 1.0) < 0.0 && turns ? -1.0 : 1.0;
      const double zero = turns ? random.uniform(-2.0, 2.0) : 0.0;
      Body body;
      body.name = loop.name + "_" + std::to_string(model.bodies.size());
      body.parent = parent;
      body.joint = step.type;
      body.placement = before * Pose<double>{rotation_of(zero * step.axis) * axes, step.point};
      body.axis = sign * (axes.transpose() * step.axis);
      body.mass = has_mass ? random.uniform(0.2, 3.0) : 0.0;
      body.com = random.vector(0.2);
      if (has_mass) body.inertia = make_inertia(random, body.mass, 0.2);
      parent = static_cast<int>(model.bodies.size());
      model.bodies.push_back(body);
      loop.dependent.push_back(parent);
      model.home_q.push_back(sign * (step.home - zero));
      before = {axes.transpose(), Vec3<double>::Zero()};
      at.p += at.R * step.point;
      if (turns) at.R = at.R * rotation_of(step.home * step.axis);
      if (!turns) at.p += at.R * (step.home * step.axis);
    }
    loop.first = loop.dependent[0];
    loop.terminal = parent;
    loop.closing = ring;
    loop.point_on_terminal = before.R * tip;
    loop.point_on_closing = random.vector(0.5);
    // The leg stands where its tip is on the ring.
    model.bodies[static_cast<size_t>(loop.first)].placement.p =
        ring_in_root.R * loop.point_on_closing + ring_in_root.p - at.R * tip - at.p;
    model.loops.push_back(loop);
    for (const int joint : {0, 2}) {
      JointForce law;
      law.body = loop.dependent[static_cast<size_t>(joint)];
      law.stiffness = 100.0;
      model.forces.push_back(law);
    }
  }
  number_coordinates(model);
}

/// A body that looks the same at every angle about its axis, turned by other joints.
int add_gear(const std::string& name, int carrier, const Pose<double>& placement,
             const std::vector<CouplingTerm>& terms, TestRandom& random, MechanismModel& model) {
  Body body;
  body.name = name;
  body.parent = carrier;
  body.joint = JointType::kRevolute;
  body.axis = make_unit(random);
  body.placement = placement;
  body.mass = random.uniform(0.1, 2.0);
  body.com = random.uniform(-0.1, 0.1) * body.axis;
  const Mat3<double> along = body.axis * body.axis.transpose();
  body.inertia = random.uniform(1e-4, 1e-3) * along +
                 random.uniform(1e-4, 1e-3) * (Mat3<double>::Identity() - along);
  model.bodies.push_back(body);
  Loop loop;
  loop.name = name + "_coupling";
  loop.cut = CutType::kCoupling;
  loop.first = loop.terminal = static_cast<int>(model.bodies.size()) - 1;
  loop.root = carrier;
  loop.terms = terms;
  loop.offset = random.uniform(-1.0, 1.0);
  loop.dependent = {loop.first};
  model.loops.push_back(loop);
  double home = loop.offset;
  number_coordinates(model);
  for (const CouplingTerm& term : terms) {
    home += term.ratio * model.home_q[static_cast<size_t>(model.bodies[term.body].q_index)];
  }
  model.home_q.push_back(home);
  number_coordinates(model);
  JointForce law;
  law.body = loop.first;
  law.stiffness = 0.1;
  model.forces.push_back(law);
  return loop.first;
}

/// A rotation that brings one unit vector onto another one that is not opposite to it.
Mat3<double> find_turn(const Vec3<double>& from, const Vec3<double>& to) {
  const Vec3<double> axis = from.cross(to);
  const Vec4<double> q(1.0 + from.dot(to), axis[0], axis[1], axis[2]);
  return quat_to_matrix<double>(q.normalized());
}

/// Rotors on tubes and rods of slide legs; shafts on the root that turn with joints of two legs,
/// with rotors, and with another shaft.
void add_gears(TestRandom& random, MechanismModel& model) {
  const std::vector<Loop> legs = model.loops;
  const auto put = [&](const std::string& name, int carrier, Pose<double> placement,
                       const std::vector<CouplingTerm>& terms) {
    return add_gear(name, carrier, placement, terms, random, model);
  };
  const auto pick = [&] { return random.uniform(-60.0, 60.0); };
  int last = -1;
  for (size_t k = 0; k < legs.size(); ++k) {
    const std::string number = std::to_string(k + 1);
    const int rod = legs[k].dependent[2];
    if (model.bodies[rod].joint == JointType::kPrismatic) {
      const bool on_tube = k % 2 == 0;
      Vec3<double> slide = model.bodies[rod].axis;
      if (on_tube) slide = (model.bodies[rod].placement.R * slide).eval();
      const int rotor = put("rotor" + number, on_tube ? legs[k].dependent[1] : rod,
                            {Mat3<double>::Identity(), random.vector(0.1)}, {{rod, pick()}});
      Body& body = model.bodies[static_cast<size_t>(rotor)];
      body.placement.R = find_turn(body.axis, k % 3 == 0 ? Vec3<double>(-slide) : slide);
      last = rotor;
    }
    const int other = legs[(k + 1) % legs.size()].dependent[k % 3];
    std::vector<CouplingTerm> terms = {{legs[k].dependent[(k + 2) % 3], pick() / 10.0},
                                       {other, pick() / 10.0}};
    if (last >= 0) terms.push_back({last, random.uniform(-1.0, 1.0)});
    last = put("shaft" + number, legs[k].root,
               {rotation_of(random.vector(2.0)), random.vector(0.5)}, terms);
  }
}

MechanismModel make_model(const LegCase& at, TestRandom& random, size_t count = 6) {
  MechanismModel model;
  model.name = "ring_on_legs";
  int root = kBase;
  if (at.on_carriage) root = add_path({JointType::kPrismatic}, kBase, random, model);
  const int ring = add_path(at.path, root, random, model);
  add_legs(at.legs, root, ring, count, !at.massless, random, model);
  model.capture_body = ring;
  if (at.stacked) {
    const int second = add_path({JointType::kFree}, ring, random, model);
    add_legs(at.legs, ring, second, count, !at.massless, random, model);
    model.capture_body = second;
  }
  if (at.geared) add_gears(random, model);
  model.home_given = true;
  number_coordinates(model);
  check_mechanism(model);
  if (at.root != Root::kFree) return model;
  VehicleBody vehicle{900.0, {0.1, -0.2, 0.3}, make_inertia(random, 900.0, 1.0)};
  return attach_vehicle(model, vehicle, {rotation_of(Vec3<double>(0.3, -0.2, 0.5)), {1, 0.2, 0.1}});
}

Mechanism make_mechanism(const LegCase& at, TestRandom& random, size_t count = 6) {
  Mechanism mechanism(make_model(at, random, count));
  if (at.root == Root::kFree) mechanism.vehicle = 0;
  close_home(mechanism, at.name);
  return mechanism;
}

/// The same mechanism, its loops closed by iteration and eliminated from the inertia of the tree.
Mechanism make_oracle(const Mechanism& mechanism) {
  Mechanism oracle(mechanism.model, true);
  oracle.vehicle = mechanism.vehicle;
  return oracle;
}

/// Independent states, loads and motion of the base at random. @param far  from home
void put_random_state(const Mechanism& mechanism, const LegCase& at, TestRandom& random,
                      MechanismData<double>& data, BaseMotion<double>& base, double far = 0.2) {
  const MechanismModel& model = mechanism.model;
  data.tree.q = Eigen::Map<const VecX<double>>(model.home_q.data(), model.nq);
  for (int i : mechanism.plan.ind_bodies) {
    const Body& body = model.bodies[i];
    if (body.joint != JointType::kFree) {
      data.tree.q[body.q_index] += random.uniform(-0.1, 0.1) * far;
      continue;
    }
    const bool is_vehicle = i == mechanism.vehicle;
    data.tree.q.segment<3>(body.q_index) = random.vector(is_vehicle ? 3.0 : 0.05 * far);
    const Vec3<double> turn = random.vector(is_vehicle ? 1.0 : 0.1 * far);
    data.tree.q.segment<4>(body.q_index + 3) << 1.0, turn;  // of any norm
  }
  for (int i : mechanism.plan.ind_v) data.tree.v[i] = random.uniform(-0.5, 0.5);
  for (int i = 0; i < model.nv; ++i) data.tau[i] = random.uniform(-100.0, 100.0);
  for (int i = 0; i < static_cast<int>(model.bodies.size()); ++i) {
    const auto& legs = mechanism.plan.leg_bodies;
    const bool is_leg = std::find(legs.begin(), legs.end(), i) != legs.end();
    if (!is_leg || at.loaded) data.tree.external[i] = {random.vector(200.0), random.vector(50.0)};
  }
  base = BaseMotion<double>();
  if (at.root == Root::kQuiescent) return;
  base.gravity = random.vector(9.0);
  if (at.root == Root::kFree) return;
  base.w = random.vector(0.5);
  base.alpha = random.vector(0.5);
  base.a = random.vector(2.0);
}

template <class S>
void copy_inputs(const MechanismData<double>& from, MechanismData<S>& to) {
  to.tree.q = from.tree.q.cast<S>();
  to.tree.v = from.tree.v.cast<S>();
  to.tau = from.tau.cast<S>();
  for (size_t i = 0; i < from.tree.external.size(); ++i) {
    to.tree.external[i] = {from.tree.external[i].f.cast<S>(), from.tree.external[i].t.cast<S>()};
  }
}

template <class S>
void evaluate(const Mechanism& mechanism, const BaseMotion<S>& base, MechanismData<S>& data,
              Need need) {
  ASSERT_TRUE(calc_position(mechanism, data, need).ok());
  calc_velocity(mechanism, base, data);
  calc_acceleration(mechanism, base, data);
  calc_reactions(mechanism, base, mechanism.vehicle, data);
}

/// Cut force of a loop, axes of the base.
Vec3<double> find_cut_force(const Mechanism& mechanism, int k, const MechanismData<double>& data) {
  Vec3<double> force;
  for (int j = 0; j < 3; ++j) force[j] = get_cut_force(mechanism.plan, data.loops, k, j);
  const int lca = mechanism.plan.paths[k].lca;
  return lca == kBase ? force : Vec3<double>(data.tree.R[lca] * force);
}

class Legs : public ::testing::TestWithParam<LegCase> {};

TEST_P(Legs, agree_with_newton_iteration_on_the_whole_tree) {
  TestRandom random(7);
  const LegCase& at = GetParam();
  const Mechanism mechanism = make_mechanism(at, random), oracle = make_oracle(mechanism);
  ASSERT_EQ(mechanism.plan.platforms.size(), at.stacked ? 2u : 1u);
  ASSERT_TRUE(oracle.plan.platforms.empty());
  size_t gears = 0;
  for (const Loop& loop : mechanism.model.loops) gears += loop.cut == CutType::kCoupling;
  EXPECT_EQ(mechanism.plan.platforms[0].gears.size(), gears);
  MechanismData<double> state(mechanism), whole(mechanism), other(oracle);
  Residual motion, reaction;
  for (int n = 0; n < 30; ++n) {
    BaseMotion<double> base;
    put_random_state(mechanism, at, random, state, base);
    copy_inputs(state, whole);
    copy_inputs(state, other);
    evaluate(mechanism, base, state, Need::kState);
    evaluate(mechanism, base, whole, Need::kEverything);
    evaluate(oracle, base, other, Need::kEverything);
    const std::string where = "state " + std::to_string(n);
    const auto add = [&](Residual& worst, const auto& found, const auto& wanted, const char* what) {
      worst.add(find_relative_error(found, wanted), where + ", " + what);
    };
    VecX<double> expected(mechanism.plan.ind_v.size()), actual(expected);
    for (int i = 0; i < expected.size(); ++i) {
      expected[i] = other.vdot[mechanism.plan.ind_v[i]];
      actual[i] = state.vdot[mechanism.plan.ind_v[i]];
      EXPECT_EQ(actual[i], whole.vdot[mechanism.plan.ind_v[i]]);
    }
    add(motion, actual, expected, "accelerations");
    add(motion, state.A_ind, other.A_ind, "inertia");
    add(motion, whole.vdot, other.vdot, "all accelerations");
    add(motion, whole.tree.v, other.tree.v, "all rates");
    motion.add((whole.tree.q - other.tree.q).cwiseAbs().maxCoeff(), where + ", coordinates");
    add(motion, whole.tree.A, other.tree.A, "inertia of the tree");
    for (size_t i = 0; i < mechanism.model.bodies.size(); ++i) {
      add(motion, whole.tree.R[i], other.tree.R[i], "R");
      add(motion, whole.tree.p[i], other.tree.p[i], "p");
      add(motion, whole.tree.w[i], other.tree.w[i], "w");
      add(motion, whole.tree.u[i], other.tree.u[i], "u");
    }
    for (const JointForce& law : mechanism.model.forces) {
      const Body& body = mechanism.model.bodies[law.body];
      motion.add(state.tree.q[body.q_index] - other.tree.q[body.q_index], where + ", q");
      motion.add(state.tree.v[body.v_index] - other.tree.v[body.v_index], where + ", v");
    }
    motion.add(find_closure_residual(mechanism, state), where + ", gap");
    EXPECT_EQ(find_singularity_margin(mechanism, state), find_singularity_margin(mechanism, whole));
    add(reaction, state.on_base.f, other.on_base.f, "force on the base");
    add(reaction, state.on_base.t, other.on_base.t, "moment on the base");
    add(reaction, whole.on_base.f, other.on_base.f, "force on the base, everything");
    for (size_t k = 0; k < mechanism.model.loops.size(); ++k) {
      const int loop = static_cast<int>(k);
      add(reaction, find_cut_force(mechanism, loop, state), find_cut_force(oracle, loop, other),
          "cut force");
    }
    calc_joint_loads(mechanism, whole);
    calc_joint_loads(oracle, other);
    for (size_t i = 0; i < mechanism.model.bodies.size(); ++i) {
      // The bearing of a shaft at rest carries nothing: less than 1 N or 1 N m counts as that.
      const Wrench<double>&found = whole.joint_load[i], &wanted = other.joint_load[i];
      reaction.add((found.f - wanted.f).norm() / std::max(wanted.f.norm(), 1.0), where + ", force");
      reaction.add((found.t - wanted.t).norm() / std::max(wanted.t.norm(), 1.0),
                   where + ", moment");
    }
    if (at.root == Root::kDriven) continue;
    const LegSums<double> sums = find_motion_sums(mechanism, state);
    const LegSums<double> wanted = find_motion_sums(oracle, other);
    add(motion, sums.momentum.f, wanted.momentum.f, "momentum");
    add(motion, sums.momentum.t, wanted.momentum.t, "angular momentum");
    add(motion, sums.first_moment, wanted.first_moment, "first moment");
    motion.add(sums.mass / wanted.mass - 1.0, where + ", mass");
    const double energy = find_mechanism_energy(mechanism, state);
    motion.add(energy / find_mechanism_energy(oracle, other) - 1.0, where + ", energy");
  }
  EXPECT_RESIDUAL_BELOW(motion, 2e-12);
  EXPECT_RESIDUAL_BELOW(reaction, 2e-11);
}

const std::vector<LegKind> kSlides = {LegKind::kR2P1R3};
const std::vector<LegKind> kCranks = {LegKind::kR1R2R3};
const std::vector<LegKind> kSquare = {LegKind::kR1R2R3Perpendicular};
const std::vector<LegKind> kMixed = {LegKind::kR1R2R3, LegKind::kR2P1R3,
                                     LegKind::kR1R2R3Perpendicular};
const JointType kHinge = JointType::kRevolute, kSlide = JointType::kPrismatic;

LegCase make_case(const char* name, Root root, const std::vector<LegKind>& legs,
                  const std::vector<JointType>& path = {JointType::kFree}) {
  LegCase made;
  made.name = name;
  made.root = root;
  made.legs = legs;
  made.path = path;
  return made;
}

std::vector<LegCase> make_cases() {
  std::vector<LegCase> cases = {
      make_case("resting_slides", Root::kQuiescent, kSlides),
      make_case("driven_slides", Root::kDriven, kSlides),
      make_case("free_slides", Root::kFree, kSlides),
      make_case("resting_cranks", Root::kQuiescent, kCranks),
      make_case("driven_cranks", Root::kDriven, kCranks),
      make_case("free_cranks", Root::kFree, kCranks),
      make_case("resting_square", Root::kQuiescent, kSquare),
      make_case("driven_square", Root::kDriven, kSquare),
      make_case("free_square", Root::kFree, kSquare),
      make_case("resting_mixed", Root::kQuiescent, kMixed),
      make_case("driven_mixed", Root::kDriven, kMixed),
      make_case("free_mixed", Root::kFree, kMixed),
      make_case("driven_gimbal", Root::kDriven, kMixed, {kHinge, kHinge}),
      make_case("free_gimbal", Root::kFree, kMixed, {kHinge, kHinge}),
      make_case("free_slide_and_gimbal", Root::kFree, kMixed, {kSlide, kHinge, kHinge}),
      make_case("free_ring_on_gimbal", Root::kFree, kMixed, {kHinge, JointType::kFree}),
      make_case("driven_carriage", Root::kDriven, kMixed),
      make_case("free_carriage_and_gimbal", Root::kFree, kMixed, {kHinge, kSlide, kHinge}),
      make_case("driven_stacked", Root::kDriven, kMixed),
      make_case("free_stacked", Root::kFree, kMixed),
      make_case("driven_loaded", Root::kDriven, kMixed),
      make_case("free_loaded", Root::kFree, kMixed, {kHinge, kHinge}),
      make_case("driven_massless", Root::kDriven, kMixed),
      make_case("free_massless", Root::kFree, kMixed),
      make_case("resting_geared_slides", Root::kQuiescent, kSlides),
      make_case("driven_geared", Root::kDriven, kMixed),
      make_case("free_geared", Root::kFree, kMixed),
      make_case("free_geared_loaded", Root::kFree, kMixed),
      make_case("driven_geared_carriage_and_gimbal", Root::kDriven, kMixed, {kHinge, kHinge})};
  for (LegCase& at : cases) {
    const std::string name = at.name;
    const auto has = [&](const char* part) { return name.find(part) != std::string::npos; };
    at.on_carriage = has("carriage");
    at.stacked = has("stacked");
    at.loaded = has("loaded");
    at.massless = has("massless");
    at.geared = has("geared");
  }
  return cases;
}

INSTANTIATE_TEST_SUITE_P(roots, Legs, ::testing::ValuesIn(make_cases()),
                         [](const ::testing::TestParamInfo<LegCase>& at) {
                           return std::string(at.param.name);
                         });

TEST_P(Legs, return_the_same_bits_in_any_number_of_lanes) {
  TestRandom random(7);
  const LegCase& at = GetParam();
  const Mechanism mechanism = make_mechanism(at, random);
  std::vector<MechanismData<double>> data(3, MechanismData<double>(mechanism));
  for (int i = 0; i < 3; ++i) {
    for (PlatformData<double>& platform : data[i].loops.platform) platform.store.use_lanes(2 << i);
  }
  for (int n = 0; n < 5; ++n) {
    BaseMotion<double> base;
    put_random_state(mechanism, at, random, data[0], base);
    for (MechanismData<double>& each : data) {
      if (&each != &data[0]) copy_inputs(data[0], each);
    }
    for (MechanismData<double>& each : data) {
      evaluate(mechanism, base, each, Need::kState);
      EXPECT_EQ(each.vdot, data[0].vdot);
      EXPECT_EQ(each.A_ind, data[0].A_ind);
      EXPECT_EQ(each.on_base.f, data[0].on_base.f);
      EXPECT_EQ(each.on_base.t, data[0].on_base.t);
      keep_reference(mechanism, each);
      EXPECT_EQ(each.loops.reference.q, data[0].loops.reference.q);
    }
  }
}

TEST_P(Legs, have_the_derivatives_of_their_differences) {
  TestRandom random(7);
  const LegCase& at = GetParam();
  const Mechanism mechanism = make_mechanism(at, random);
  MechanismData<double> data(mechanism), moved(mechanism);
  BaseMotion<double> base;
  put_random_state(mechanism, at, random, data, base);
  evaluate(mechanism, base, data, Need::kState);
  AccelerationJacobian jacobian(mechanism);
  JacobianData work(mechanism);
  ASSERT_TRUE(calc_acceleration_jacobian(mechanism, base, data, work, jacobian).ok());
  const std::vector<int>&ind_q = mechanism.plan.ind_q, &ind_v = mechanism.plan.ind_v;
  Residual worst;
  const auto find_difference = [&](auto shift, double width = 1e-5) {
    VecX<double> slope = VecX<double>::Zero(static_cast<int>(ind_v.size()));
    const double weight[] = {-1.0 / 60, 9.0 / 60, -45.0 / 60, 45.0 / 60, -9.0 / 60, 1.0 / 60};
    const int place[] = {-3, -2, -1, 1, 2, 3};
    for (int k = 0; k < 6; ++k) {
      copy_inputs(data, moved);
      shift(moved, place[k] * width);
      evaluate(mechanism, base, moved, Need::kRates);
      for (int i = 0; i < slope.size(); ++i) slope[i] += weight[k] / width * moved.vdot[ind_v[i]];
    }
    return slope;
  };
  for (int j = 0; j < static_cast<int>(ind_q.size()); ++j) {
    const VecX<double> slope =
        find_difference([&](MechanismData<double>& m, double step) { m.tree.q[ind_q[j]] += step; });
    // Where a vehicle stands changes nothing.
    const double scale = std::max(1.0, slope.norm());
    worst.add((jacobian.dq.col(j) - slope).norm() / scale, "q " + std::to_string(j));
  }
  for (int j = 0; j < static_cast<int>(ind_v.size()); ++j) {
    const VecX<double> slope =
        find_difference([&](MechanismData<double>& m, double step) { m.tree.v[ind_v[j]] += step; });
    worst.add(find_relative_error(jacobian.dv.col(j), slope), "v " + std::to_string(j));
  }
  for (const LoopBlock& block : mechanism.plan.blocks) {
    for (int v : block.dep) {
      const VecX<double> slope = find_difference(  // accelerations are linear in forces
          [&](MechanismData<double>& m, double step) { m.tau[v] += step; }, 1e-2);
      worst.add(find_relative_error(jacobian.dtau.col(v), slope), "tau " + std::to_string(v));
    }
  }
  EXPECT_RESIDUAL_BELOW(worst, 1e-6);
}

TEST_P(Legs, agree_with_32_digits) {
  TestRandom random(7);
  const LegCase& at = GetParam();
  const Mechanism mechanism = make_mechanism(at, random);
  MechanismData<double> data(mechanism);
  MechanismData<Extended> exact(mechanism);
  Residual worst;
  for (int n = 0; n < 3; ++n) {
    BaseMotion<double> base;
    put_random_state(mechanism, at, random, data, base);
    copy_inputs(data, exact);
    const BaseMotion<Extended> exact_base{base.w.cast<Extended>(), base.alpha.cast<Extended>(),
                                          base.a.cast<Extended>(), base.gravity.cast<Extended>()};
    evaluate(mechanism, base, data, Need::kState);
    evaluate(mechanism, exact_base, exact, Need::kState);
    const std::string where = "state " + std::to_string(n);
    for (int i : mechanism.plan.ind_v) {
      worst.add((data.vdot[i] - to_double(exact.vdot[i])) / data.vdot.norm(), where + ", vdot");
    }
    worst.add(find_relative_error(data.on_base.f, exact.on_base.f), where + ", on_base");
  }
  EXPECT_RESIDUAL_BELOW(worst, 1e-12);
}

MechanismModel read_model(const std::string& path) {
  std::ifstream file(path);
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  return read_mechanism(text, path);
}

TEST(LegPlatforms, are_the_legs_and_gears_of_the_shipped_mechanisms) {
  struct Shipped {
    const char* name;
    size_t legs, gears, tree_bodies;
  };
  for (const Shipped& at : {Shipped{"hexapod_bench", 6, 0, 1}, Shipped{"idss_hexapod", 6, 0, 1},
                            Shipped{"hexapod", 6, 6, 1}, Shipped{"apda", 6, 16, 1},
                            Shipped{"apda_cranks", 6, 16, 1}, Shipped{"probe_drogue", 4, 4, 4}}) {
    Mechanism mechanism(
        read_model(std::string(DOCKLOOP_MODELS) + "/mechanisms/" + at.name + ".json"));
    close_home(mechanism, at.name);
    ASSERT_EQ(mechanism.plan.platforms.size(), 1u) << at.name;
    EXPECT_EQ(mechanism.plan.platforms[0].blocks.size(), at.legs) << at.name;
    EXPECT_EQ(mechanism.plan.platforms[0].gears.size(), at.gears) << at.name;
    EXPECT_EQ(mechanism.plan.tree_bodies.size(), at.tree_bodies) << at.name;
  }
}

// A rotor that does not look the same at every angle, one that stands askew, and one that something
// else uses keep their leg in the general reduction.
TEST(LegPlatforms, take_only_round_gears_that_nothing_else_uses) {
  LegCase at = make_case("gears", Root::kFree, kSlides);
  at.geared = true;
  TestRandom random(7);
  const Mechanism mechanism = make_mechanism(at, random);
  ASSERT_EQ(mechanism.plan.platforms[0].blocks.size(), 6u);
  const auto count_legs = [&](const char* name, auto change) {
    MechanismModel model = mechanism.model;
    for (Body& body : model.bodies) {
      if (body.name == name) change(body);
    }
    const Mechanism changed(model);
    return changed.plan.platforms.empty() ? 0 : changed.plan.platforms[0].blocks.size();
  };
  EXPECT_EQ(count_legs("rotor6", [](Body& body) { body.mass *= 2.0; }), 6u);
  const auto make_uneven = [](Body& body) { body.inertia(0, 0) *= 1.001; };
  const auto make_eccentric = [](Body& body) {
    body.com += 1e-3 * body.axis.cross(Vec3<double>(0.3, -0.5, 0.7));
  };
  const auto put_askew = [](Body& body) {
    body.placement.R = (body.placement.R * rotation_of(Vec3<double>(1e-3, 2e-3, -1e-3))).eval();
  };
  // Shafts 5 and 6 turn with rotor 6, and shaft 6 with legs 1 and 6: both legs are lost.
  EXPECT_LT(count_legs("rotor6", make_uneven), 6u);
  EXPECT_LT(count_legs("rotor6", make_eccentric), 6u);
  EXPECT_LT(count_legs("rotor6", put_askew), 6u);
  EXPECT_LT(count_legs("shaft6", make_uneven), 6u);
  EXPECT_EQ(count_legs("shaft6", put_askew), 6u);
}

TEST(LegPlatforms, leave_legs_that_share_their_bodies_to_the_general_reduction) {
  const Mechanism planar(read_mechanism(read_test_file("planar_two_loop.json"), "planar"));
  EXPECT_TRUE(planar.plan.platforms.empty());
  // Cranks that their drives turn, and rods on top: legs of the ring share the cranks.
  const Mechanism nested(read_mechanism(read_test_file("crank_nested.json"), "nested"));
  for (const LoopBlock& block : nested.plan.blocks) {
    if (!block.is_leg) continue;
    for (int body : block.dep_bodies) {
      for (const LoopBlock& other : nested.plan.blocks) {
        const auto& low = other.low;
        const int v = nested.model.bodies[static_cast<size_t>(body)].v_index;
        EXPECT_EQ(std::find(low.begin(), low.end(), v), low.end());
      }
    }
  }
}

TEST(LegPlatforms, hold_any_number_of_legs) {
  for (const size_t count : {3, 7, 8, 9, 24, 60}) {
    TestRandom random(11);
    const LegCase at = make_case("many", Root::kDriven, kSlides);
    const Mechanism mechanism = make_mechanism(at, random, count), oracle = make_oracle(mechanism);
    MechanismData<double> data(mechanism), other(oracle);
    BaseMotion<double> base;
    put_random_state(mechanism, at, random, data, base);
    copy_inputs(data, other);
    evaluate(mechanism, base, data, Need::kState);
    evaluate(oracle, base, other, Need::kEverything);
    EXPECT_LE(find_relative_error(data.vdot.head<6>(), other.vdot.head<6>()), 1e-12) << count;
    EXPECT_LE(find_relative_error(data.on_base.f, other.on_base.f), 1e-12) << count;
  }
}

TEST(LegPlatforms, refuse_what_cannot_be_reached_with_its_name_and_margin) {
  for (const LegKind kind : kMixed) {
    TestRandom random(3);
    const LegCase at = make_case("one leg", Root::kQuiescent, {kind});
    const Mechanism mechanism = make_mechanism(at, random, 1);
    MechanismData<double> data(mechanism);
    const ClosedForm& form = *mechanism.plan.blocks[0].form();
    const LegShape& shape = form.shape;
    const Body& ring = mechanism.model.bodies[0];
    const auto reach = [&](double x, double y, double z) {  // the tip to there, canonical axes
      const Vec3<double> tip = form.in_parent.p + form.in_parent.R * Vec3<double>(x, y, z);
      data.tree.q.segment<3>(0) = ring.placement.R.transpose() * (tip - ring.placement.p) -
                                  mechanism.model.loops[0].point_on_closing;
      return calc_position(mechanism, data, Need::kState);
    };
    if (kind == LegKind::kR2P1R3) {  // the leg along the first axis of its universal joint
      EXPECT_EQ(reach(0.0, 0.5, std::abs(shape.tip.z()) + 1e-11).code, StatusCode::kLoopSingular);
      EXPECT_EQ(reach(0.0, 0.5, 0.0).code, StatusCode::kOutOfReach);
    } else {
      const bool parallel = kind == LegKind::kR1R2R3;
      const double stretched = shape.l1 + (parallel ? shape.tip.norm() : shape.l2);
      const double short_by = parallel ? 0.999 : 0.99;
      EXPECT_TRUE(reach(0.95 * stretched, 0.0, shape.height).ok());
      EXPECT_TRUE(reach(short_by * stretched, 0.0, shape.height).ok());
      const Status refused = reach(1.0001 * stretched, 0.0, shape.height);
      EXPECT_EQ(refused.code, StatusCode::kOutOfReach);
      EXPECT_EQ(refused.index, 0);
    }
    data.tree.q[0] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_FALSE(calc_position(mechanism, data, Need::kState).ok());
  }
}

TEST(LegPlatforms, count_the_turns_of_joints_with_a_force_that_depends_on_them) {
  TestRandom random(5);
  const LegCase at = make_case("turns", Root::kQuiescent, kCranks);
  const Mechanism mechanism = make_mechanism(at, random);
  const MechanismModel& model = mechanism.model;
  MechanismData<double> data(mechanism);
  ASSERT_TRUE(calc_position(mechanism, data, Need::kState).ok());
  const int q = model.bodies[static_cast<size_t>(model.loops[4].first)].q_index;
  const double home = data.tree.q[q], turn = 2.0 * 3.14159265358979323846;
  data.tree.q[q] = home + turn + 0.3;  // where the search starts
  ASSERT_TRUE(calc_position(mechanism, data, Need::kState).ok());
  EXPECT_NEAR(data.tree.q[q], home + turn, 1e-14);
  keep_reference(mechanism, data);
  data.loops.reference.q[q] = home - 2.0 * turn;
  ASSERT_TRUE(calc_position(mechanism, data, Need::kState).ok());
  EXPECT_NEAR(data.tree.q[q], home - 2.0 * turn, 1e-14);
}

TEST(LegPlatforms, find_angles_to_rounding_all_around) {
  for (const int widest : {2, 4, 8}) {
    const legs::LegFunctions& functions = legs::find_leg_functions(widest);
    Residual worst;
    for (int n = -2000; n <= 2000; ++n) {
      legs::LegGroup group{};
      group.legs = kGroup;
      const double step = 3.14159265358979323846 / 2000.0, angle = n * step;
      for (int lane = 0; lane < kGroup; ++lane) {
        group.work[legs::kTurns + 2][lane] = std::cos(angle + 0.1 * lane * step);
        group.work[legs::kTurns + 3][lane] = std::sin(angle + 0.1 * lane * step);
      }
      functions.calc_angles(&group, 1, 1);
      for (int lane = 0; lane < kGroup; ++lane) {
        const double expected =
            std::atan2(group.work[legs::kTurns + 3][lane], group.work[legs::kTurns + 2][lane]);
        worst.add(group.work[legs::kAngles + 1][lane] - expected, std::to_string(expected));
      }
    }
    EXPECT_RESIDUAL_BELOW(worst, 1e-15);
  }
}

}  // namespace
}  // namespace dockloop
