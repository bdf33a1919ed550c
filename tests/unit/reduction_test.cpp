// The reduction against a method that shares nothing with it, on random mechanisms.
// 1. accelerations, cut forces and load on the base equal those of one dense system in all tree
//    coordinates with multipliers (KKT); its loop equations come from positions alone, by numerical
//    differentiation in Extended;
// 2. the reduced inertia is symmetric, positive definite and gives the kinetic energy;
// 3. cut forces do no work; the load on the base is the rate of momentum, gravity and external
//    loads taken off;
// 4. Extended agrees with double to rounding.
//
// A random mechanism is a ring on one to six legs, each a universal joint, a slide and a cut ball
// joint with lateral offsets. Legs are rooted on the base, on a turning carriage or on the cylinder
// of the leg before (a dependent body); they close on the ring or on an arm of the ring. Half of
// the mechanisms float on a vehicle; the base of the others is moved.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

using V = Vec3<double>;
using L = Extended;

Body make_body(TestRandom& random, const std::string& name, int parent, JointType joint,
               double mass, double size) {
  Body body;
  body.name = name;
  body.parent = parent;
  body.joint = joint;
  body.axis = make_unit(random);
  body.placement = {rotation_of(random.vector(1.0)), random.vector(size)};
  body.mass = mass;
  body.com = random.vector(0.3 * size);
  body.inertia = make_inertia(random, mass, 0.3 * size);
  return body;
}

struct RandomMechanism {
  MechanismModel model;
  int leg_count = 0;
  bool floating = false;
};

RandomMechanism make_random(TestRandom& random, int legs, bool floating) {
  RandomMechanism result;
  result.leg_count = legs;
  result.floating = floating;
  MechanismModel model;
  model.name = "random";
  model.bodies.push_back(make_body(
      random, "carriage", kBase,
      random.uniform(0, 1) < 0.5 ? JointType::kRevolute : JointType::kPrismatic, 5.0, 0.3));
  Body ring = make_body(random, "ring", kBase, JointType::kFree, 20.0, 0.3);
  ring.placement.p.x() += 1.2;
  model.bodies.push_back(ring);
  model.bodies.push_back(make_body(random, "arm", 1, JointType::kRevolute, 1.0, 0.2));
  int cylinder_before = -1;
  for (int k = 0; k < legs; ++k) {
    const double choice = random.uniform(0, 1);
    const int root = choice < 0.4                          ? kBase
                     : choice < 0.8 || cylinder_before < 0 ? 0
                                                           : cylinder_before;
    const std::string name = "leg" + std::to_string(k + 1);
    Body cross = make_body(random, name + "_cross", root, JointType::kRevolute, 0.1, 0.3);
    Body cylinder = make_body(random, name + "_cylinder", 0, JointType::kRevolute, 1.5, 0.2);
    Body rod = make_body(random, name + "_rod", 0, JointType::kPrismatic, 0.8, 0.2);
    const int first = static_cast<int>(model.bodies.size());
    // Orthogonal axes in bodies of arbitrary axes.
    cylinder.parent = first;
    cylinder.placement.p.setZero();
    const V a1 = cross.axis;
    const V a2 = (V(cylinder.placement.R * cylinder.axis).cross(a1)).normalized();
    cylinder.axis = (cylinder.placement.R.transpose() * a2).normalized();
    rod.parent = first + 1;
    rod.axis = (rod.placement.R.transpose() * (cylinder.placement.R.transpose() * a1.cross(a2)))
                   .normalized();
    for (const Body& body : {cross, cylinder, rod}) model.bodies.push_back(body);
    Loop loop;
    loop.name = name;
    loop.root = root;
    loop.first = first;
    loop.terminal = first + 2;
    loop.closing = random.uniform(0, 1) < 0.7 ? 1 : 2;
    loop.point_on_terminal = random.vector(0.1);
    loop.point_on_closing = random.vector(0.4);
    loop.dependent = {first, first + 1, first + 2};
    cylinder_before = first + 1;
    model.loops.push_back(loop);
  }
  number_coordinates(model);
  if (floating) {
    VehicleBody vehicle;
    vehicle.mass = 300;
    vehicle.com = random.vector(0.1);
    vehicle.inertia = make_inertia(random, 300, 1.0);
    model = attach_vehicle(model, vehicle, {rotation_of(random.vector(1.0)), random.vector(1.0)});
  }
  result.model = model;
  return result;
}

/// A state with all loops closed and away from singular. @return false to try another
bool set_random_state(TestRandom& random, const Mechanism& mechanism, MechanismData<double>& data) {
  for (int i : mechanism.plan.ind_bodies) {
    const Body& body = mechanism.model.bodies[i];
    if (body.joint == JointType::kFree) {
      data.tree.q.segment<3>(body.q_index) = random.vector(0.3);
      data.tree.q.segment<4>(body.q_index + 3) = quat_exp<double>(random.vector(0.7));
    } else {
      data.tree.q[body.q_index] = random.uniform(-0.4, 0.4);
    }
  }
  for (int i : mechanism.plan.ind_v) data.tree.v[i] = random.uniform(-0.5, 0.5);
  return calc_position(mechanism, data).ok() && find_singularity_margin(mechanism, data) > 0.3;
}

BaseMotion<double> make_base_motion(TestRandom& random, bool floating) {
  BaseMotion<double> base;
  if (!floating) {
    base.w = random.vector(0.3);
    base.alpha = random.vector(0.3);
    base.a = random.vector(1.0);
  }
  base.gravity = random.vector(3.0);
  return base;
}

template <class S>
BaseMotion<S> cast_base(const BaseMotion<double>& base) {
  return {base.w.cast<S>(), base.alpha.cast<S>(), base.a.cast<S>(), base.gravity.cast<S>()};
}

void put_random_loads(TestRandom& random, MechanismData<double>& data) {
  for (int j = 0; j < data.tau.size(); ++j) data.tau[j] = random.uniform(-5, 5);
  for (Wrench<double>& load : data.tree.external) {
    load.f = random.vector(5.0);
    load.t = random.vector(2.0);
  }
}

// ---- loop equations from positions alone ----

/// Coordinates after the velocities v have acted for a time t, each joint for itself. For a free
/// joint: constant velocity and angular velocity in its own axes, as a series (t is small).
VecX<L> flow(const MechanismModel& model, const VecX<L>& q, const VecX<L>& v, L t) {
  VecX<L> moved = q;
  for (const Body& body : model.bodies) {
    if (body.joint != JointType::kFree) {
      moved[body.q_index] += v[body.v_index] * t;
      continue;
    }
    const Vec3<L> u = v.segment<3>(body.v_index), w = v.segment<3>(body.v_index + 3);
    const Vec4<L> quat = q.segment<4>(body.q_index + 3);
    Vec3<L> sum = Vec3<L>::Zero(), term = u * t;
    for (int n = 2; n < 14; ++n) {
      sum += term;
      term = (w.cross(term) * (t / L(n))).eval();
    }
    moved.segment<3>(body.q_index) += quat_to_matrix<L>(quat) * sum;
    // Exponential map with all digits of Extended.
    const L angle = w.norm() * t;
    Vec4<L> turn(1, 0, 0, 0);
    if (angle != 0) {
      const Vec3<L> axis = w / w.norm() * sin(angle / 2);
      turn << cos(angle / 2), axis[0], axis[1], axis[2];
    }
    moved.segment<4>(body.q_index + 3) = quat_multiply<L>(quat, turn);
  }
  return moved;
}

/// Gap of every loop, base axes, from coordinates of the open tree.
VecX<L> find_gaps(const MechanismModel& model, const VecX<L>& q, TreeData<L>& tree) {
  tree.q = q;
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    calc_joint_pose(model, static_cast<int>(i), tree);
  }
  calc_tree_position(model, tree.all, tree);
  VecX<L> gaps(3 * static_cast<int>(model.loops.size()));
  for (size_t k = 0; k < model.loops.size(); ++k) {
    const Loop& loop = model.loops[k];
    const auto locate = [&](int body, const V& point) {
      const Vec3<L> x = point.cast<L>();
      return body == kBase ? x : Vec3<L>(tree.R[body] * x + tree.p[body]);
    };
    gaps.segment<3>(3 * static_cast<int>(k)) =
        locate(loop.terminal, loop.point_on_terminal) - locate(loop.closing, loop.point_on_closing);
  }
  return gaps;
}

struct NumericalLoops {
  MatX<L> G;      ///< gap rate = G v
  VecX<L> gamma;  ///< gap acceleration at zero joint accelerations
};

NumericalLoops differentiate(const MechanismModel& model, const VecX<L>& q, const VecX<L>& v) {
  // Central differences of sixth order; step sized for 64 bits of mantissa.
  const L h = 4e-3L;
  const L first[3] = {3.0L / 4, -3.0L / 20, 1.0L / 60};
  const L second[3] = {3.0L / 2, -3.0L / 20, 1.0L / 90};
  TreeData<L> tree(model);
  const int rows = 3 * static_cast<int>(model.loops.size());
  NumericalLoops result;
  result.G.setZero(rows, model.nv);
  for (int j = 0; j < model.nv; ++j) {
    const VecX<L> unit = VecX<L>::Unit(model.nv, j);
    for (int s = 1; s <= 3; ++s) {
      result.G.col(j) += first[s - 1] / h *
                         (find_gaps(model, flow(model, q, unit, L(s) * h), tree) -
                          find_gaps(model, flow(model, q, unit, -L(s) * h), tree));
    }
  }
  result.gamma = -49.0L / 18 / (h * h) * find_gaps(model, q, tree);
  for (int s = 1; s <= 3; ++s) {
    result.gamma += second[s - 1] / (h * h) *
                    (find_gaps(model, flow(model, q, v, L(s) * h), tree) +
                     find_gaps(model, flow(model, q, v, -L(s) * h), tree));
  }
  return result;
}

/// Axes in which the cut force of loop k is stated (its lowest common ancestor), in base axes.
template <class S>
Mat3<S> find_lca_axes(const Mechanism& mechanism, size_t k, const TreeData<S>& tree) {
  const int lca = mechanism.plan.paths[k].lca;
  return lca == kBase ? Mat3<S>(Mat3<S>::Identity()) : tree.R[lca];
}

Vec3<double> find_cut_force(const Mechanism& mechanism, size_t k,
                            const MechanismData<double>& data) {
  const int block = mechanism.plan.block_of_loop[k];  // one loop each
  return find_lca_axes(mechanism, k, data.tree) * data.loops.block[block].lambda.head<3>();
}

/// Calls test(mechanism, data, base) on random mechanisms, states and loads.
template <class Test>
int for_random_mechanisms(unsigned seed, int count, Test test) {
  TestRandom random(seed);
  int done = 0;
  for (int trial = 0; done < count && trial < 100 * count; ++trial) {
    const bool floating = trial / 6 % 2 == 1;
    const Mechanism mechanism(make_random(random, 1 + trial % 6, floating).model);
    MechanismData<double> data(mechanism);
    if (!set_random_state(random, mechanism, data)) continue;
    const BaseMotion<double> base = make_base_motion(random, floating);
    put_random_loads(random, data);
    calc_velocity(mechanism, base, data);
    calc_acceleration(mechanism, base, data);
    calc_reactions(mechanism, base, kBase, data);
    test(mechanism, data, base);
    ++done;
  }
  return done;
}

TEST(Reduction, agrees_with_a_dense_system_with_multipliers) {
  Residual accelerations, cut_forces, base_load, rates;
  int nested = 0, rooted_on_moving = 0;
  const int count = for_random_mechanisms(
      21, 200,
      [&](const Mechanism& mechanism, const MechanismData<double>& data,
          const BaseMotion<double>& base) {
        const MechanismModel& model = mechanism.model;
        const int nv = model.nv, m = 3 * static_cast<int>(model.loops.size());
        const std::string where =
            std::to_string(m / 3) + " legs, " + std::to_string(nv) + " velocities";
        for (const Loop& loop : model.loops) {
          const std::string root = loop.root == kBase ? "base" : model.bodies[loop.root].name;
          nested += root.find("cylinder") != std::string::npos;
          rooted_on_moving += root == "carriage";
        }
        const VecX<L> q = data.tree.q.cast<L>(), v = data.tree.v.cast<L>();
        const NumericalLoops loops = differentiate(model, q, v);
        rates.add(static_cast<double>((loops.G * v).cwiseAbs().maxCoeff()), where);

        // Inertia and right-hand side of the open tree.
        TreeData<L> tree(model);
        find_gaps(model, q, tree);
        tree.v = v;
        for (size_t i = 0; i < model.bodies.size(); ++i) {
          tree.external[i] = {data.tree.external[i].f.cast<L>(), data.tree.external[i].t.cast<L>()};
        }
        const BaseMotion<L> base_L = cast_base<L>(base);
        calc_tree_inertia(model, tree);
        calc_tree_velocity<L>(model, tree.all, base_L.w, tree);
        const VecX<L>* none = nullptr;
        calc_tree_acceleration<L>(model, tree.all, base_L, none, tree);
        calc_tree_forces(model, tree);
        MatX<L> kkt = MatX<L>::Zero(nv + m, nv + m);
        kkt.topLeftCorner(nv, nv) = tree.A;
        kkt.topRightCorner(nv, m) = -loops.G.transpose();
        kkt.bottomLeftCorner(m, nv) = loops.G;
        VecX<L> rhs(nv + m);
        rhs << data.tau.cast<L>() - tree.tau_required, -loops.gamma;
        const VecX<L> x = kkt.fullPivLu().solve(rhs);

        accelerations.add(find_relative_error(data.vdot, x.head(nv)), where);
        VecX<double> lambda(m);
        for (size_t k = 0; k < model.loops.size(); ++k) {
          lambda.segment<3>(3 * static_cast<int>(k)) = find_cut_force(mechanism, k, data);
        }
        cut_forces.add(find_relative_error(lambda, x.tail(m)), where);

        // Load on the base: what the children of the base transmit to it, cut forces added by hand.
        const VecX<L> vdot = x.head(nv);
        const auto add_force = [&](int body, const V& point, const Vec3<L>& f, Wrench<L>& on_base) {
          if (body == kBase) {
            const Vec3<L> arm = point.cast<L>();
            on_base.f += f;
            on_base.t += arm.cross(f);
          } else {
            tree.external[body].f += f;
            tree.external[body].t += Vec3<L>(tree.R[body] * point.cast<L>()).cross(f);
          }
        };
        Wrench<L> on_base;
        for (size_t k = 0; k < model.loops.size(); ++k) {
          const Loop& loop = model.loops[k];
          const Vec3<L> f = x.segment<3>(nv + 3 * static_cast<int>(k));
          add_force(loop.terminal, loop.point_on_terminal, f, on_base);
          add_force(loop.closing, loop.point_on_closing, -f, on_base);
        }
        calc_tree_acceleration<L>(model, tree.all, base_L, &vdot, tree);
        calc_tree_forces(model, tree);
        for (size_t i = 0; i < model.bodies.size(); ++i) {
          if (model.bodies[i].parent != kBase) continue;
          on_base.f -= tree.transmitted[i].f;
          on_base.t -= tree.transmitted[i].t + tree.p[i].cross(tree.transmitted[i].f);
        }
        if (mechanism.model.bodies[0].name == "vehicle") return;  // floats: nothing on the base
        base_load.add(find_relative_error(data.on_base.f, on_base.f), where);
        base_load.add(find_relative_error(data.on_base.t, on_base.t), where);
      });
  EXPECT_EQ(count, 200);
  EXPECT_GT(nested, 30);
  EXPECT_GT(rooted_on_moving, 100);
  EXPECT_RESIDUAL_BELOW(rates, 1.3e-14);          // measured 1.3e-15
  EXPECT_RESIDUAL_BELOW(accelerations, 1.5e-13);  // measured 1.5e-14
  EXPECT_RESIDUAL_BELOW(cut_forces, 3.2e-13);     // measured 3.2e-14
  EXPECT_RESIDUAL_BELOW(base_load, 1.1e-13);      // measured 1.1e-14
}

TEST(Reduction, gives_a_symmetric_positive_inertia_with_the_right_kinetic_energy) {
  Residual asymmetry, energy;
  const int count = for_random_mechanisms(
      22, 200,
      [&](const Mechanism& mechanism, const MechanismData<double>& data,
          const BaseMotion<double>&) {
        const MatX<double>& A = data.A_ind;
        asymmetry.add((A - A.transpose()).cwiseAbs().maxCoeff() / A.cwiseAbs().maxCoeff());
        EXPECT_EQ(data.factor.info(), Eigen::Success);
        VecX<double> v(A.rows());
        for (int i = 0; i < A.rows(); ++i) v[i] = data.tree.v[mechanism.plan.ind_v[i]];
        const VecX<double> full = data.tree.A * data.tree.v, reduced = A * v;
        energy.add(reduced.dot(v) / full.dot(data.tree.v) - 1.0);
      });
  EXPECT_EQ(count, 200);
  EXPECT_RESIDUAL_BELOW(asymmetry, 1e-15);  // measured 0
  EXPECT_RESIDUAL_BELOW(energy, 4.4e-15);   // measured 4.4e-16
}

TEST(Reduction, has_cut_forces_that_do_no_work) {
  Residual work;
  for_random_mechanisms(
      23, 200,
      [&](const Mechanism& mechanism, const MechanismData<double>& data,
          const BaseMotion<double>& base) {
        const TreeData<double>& tree = data.tree;
        for (size_t k = 0; k < mechanism.model.loops.size(); ++k) {
          const Loop& loop = mechanism.model.loops[k];
          const auto velocity = [&](int body, const V& point) {
            return body == kBase ? V(base.w.cross(point))
                                 : V(tree.u[body] + tree.w[body].cross(V(tree.R[body] * point)));
          };
          const V force = find_cut_force(mechanism, k, data);
          const V on_terminal = velocity(loop.terminal, loop.point_on_terminal);
          const V on_closing = velocity(loop.closing, loop.point_on_closing);
          work.add(force.dot(on_terminal - on_closing) / (force.norm() * on_terminal.norm()));
        }
      });
  EXPECT_RESIDUAL_BELOW(work, 2.6e-14);  // measured 2.6e-15
}

/// Momentum of all bodies, linear and about the base origin.
Wrench<L> find_total_momentum(const MechanismModel& model, const TreeData<L>& tree) {
  Wrench<L> sum;
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    const Vec3<L> p = L(model.bodies[i].mass) * tree.u[i] + tree.w[i].cross(tree.h_body[i]);
    sum.f += p;
    sum.t += tree.p[i].cross(p) + tree.I_body[i] * tree.w[i] + tree.h_body[i].cross(tree.u[i]);
  }
  return sum;
}

TEST(Reduction, loads_the_base_with_the_rate_of_momentum) {
  Residual worst;
  TestRandom random(24);
  int done = 0;
  for (int trial = 0; done < 60; ++trial) {
    ASSERT_LT(trial, 6000);
    const Mechanism mechanism(make_random(random, 1 + trial % 6, false).model);
    const MechanismModel& model = mechanism.model;
    MechanismData<double> start(mechanism);
    if (!set_random_state(random, mechanism, start)) continue;
    ++done;
    put_random_loads(random, start);
    BaseMotion<double> base;  // at rest
    base.gravity = random.vector(3.0);
    calc_velocity(mechanism, base, start);
    calc_acceleration(mechanism, base, start);
    calc_reactions(mechanism, base, kBase, start);
    // External and gravity loads about the base origin.
    Wrench<double> applied;
    for (size_t i = 0; i < model.bodies.size(); ++i) {
      const Wrench<double>& load = start.tree.external[i];
      applied.f += load.f + model.bodies[i].mass * base.gravity;
      applied.t +=
          load.t + start.tree.p[i].cross(load.f) +
          (start.tree.h_body[i] + model.bodies[i].mass * start.tree.p[i]).cross(base.gravity);
    }
    // Momentum a little before and after, along the motion.
    MechanismData<L> data(mechanism);
    data.tree.q = start.tree.q.cast<L>();
    data.tree.v = start.tree.v.cast<L>();
    data.tau = start.tau.cast<L>();
    for (size_t i = 0; i < model.bodies.size(); ++i) {
      data.tree.external[i] = {start.tree.external[i].f.cast<L>(),
                               start.tree.external[i].t.cast<L>()};
    }
    const std::vector<L> y0 = get_reduced_state(mechanism, data);
    const BaseMotion<L> base_L = cast_base<L>(base);
    const auto rates = [&](const L* y, L* ydot) {
      ASSERT_TRUE(
          calc_reduced_rates<L>(mechanism, base_L, [](MechanismData<L>&) {}, y, ydot, data).ok());
    };
    const L h = 5e-4L;
    const L weight[3] = {3.0L / 4, -3.0L / 20, 1.0L / 60};
    Wrench<L> rate;
    for (int s = 1; s <= 3; ++s) {
      for (int side : {-1, 1}) {
        std::vector<L> y = y0, ydot(y0.size());
        for (int n = 0; n < 4 * s; ++n) step_rk4<L>(rates, y, L(side) * h / 4);
        rates(y.data(), ydot.data());
        const Wrench<L> momentum = find_total_momentum(model, data.tree);
        rate.f += weight[s - 1] * L(side) / h * momentum.f;
        rate.t += weight[s - 1] * L(side) / h * momentum.t;
      }
    }
    const Vec3<double> f = applied.f - rate.f.cast<double>(), t = applied.t - rate.t.cast<double>();
    worst.add(find_relative_error(start.on_base.f, f), "force, trial " + std::to_string(trial));
    worst.add(find_relative_error(start.on_base.t, t), "moment, trial " + std::to_string(trial));
  }
  EXPECT_RESIDUAL_BELOW(worst, 1e-10);  // measured 9.4e-12, that of the differences
}

TEST(Reduction, leaves_nothing_for_the_base_of_a_floating_mechanism) {
  // What a vehicle with a free joint passes to the base is the force of that joint alone.
  Residual worst;
  for_random_mechanisms(
      25, 100,
      [&](const Mechanism& mechanism, const MechanismData<double>& data,
          const BaseMotion<double>&) {
        if (mechanism.model.bodies[0].name != "vehicle") return;
        const V joint_force = data.tree.R[0] * data.tau.head<3>();
        const V joint_moment =
            data.tree.R[0] * data.tau.segment<3>(3) + data.tree.p[0].cross(joint_force);
        worst.add((data.on_base.f + joint_force).norm() / joint_force.norm(), "force");
        worst.add((data.on_base.t + joint_moment).norm() / joint_moment.norm(), "moment");
      });
  EXPECT_RESIDUAL_BELOW(worst, 1.6e-12);  // measured 1.6e-13
}

TEST(Reduction, gives_in_double_what_it_gives_in_long_double) {
  Residual kinematics, dynamics;
  for_random_mechanisms(
      26, 200,
      [&](const Mechanism& mechanism, const MechanismData<double>& data,
          const BaseMotion<double>& base) {
        MechanismData<L> more(mechanism);
        for (int i : mechanism.plan.ind_q) more.tree.q[i] = data.tree.q[i];
        for (int i : mechanism.plan.ind_v) more.tree.v[i] = data.tree.v[i];
        more.tau = data.tau.cast<L>();
        for (size_t i = 0; i < mechanism.model.bodies.size(); ++i) {
          more.tree.external[i] = {data.tree.external[i].f.cast<L>(),
                                   data.tree.external[i].t.cast<L>()};
        }
        const BaseMotion<L> base_L = cast_base<L>(base);
        ASSERT_TRUE(calc_position(mechanism, more).ok());
        calc_velocity(mechanism, base_L, more);
        calc_acceleration(mechanism, base_L, more);
        calc_reactions(mechanism, base_L, kBase, more);
        for (int i = 0; i < mechanism.model.nq; ++i) {
          kinematics.add(find_angle_difference(data.tree.q[i], static_cast<double>(more.tree.q[i])),
                         "q");
        }
        kinematics.add(find_relative_error(data.tree.v, more.tree.v), "v");
        kinematics.add(find_relative_error(data.A_ind, more.A_ind), "inertia");
        dynamics.add(find_relative_error(data.vdot, more.vdot), "vdot");
        dynamics.add(find_relative_error(data.b_ind, more.b_ind), "right-hand side");
        for (size_t b = 0; b < mechanism.plan.blocks.size(); ++b) {
          dynamics.add(find_relative_error(data.loops.block[b].lambda, more.loops.block[b].lambda),
                       "cut");
        }
      });
  EXPECT_RESIDUAL_BELOW(kinematics, 2e-14);  // measured 2.0e-15
  EXPECT_RESIDUAL_BELOW(dynamics, 3e-13);    // measured 3.0e-14 (of an ill-conditioned case)
}

}  // namespace
}  // namespace dockloop
