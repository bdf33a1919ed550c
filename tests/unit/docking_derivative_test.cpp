// Exact derivatives of the whole docking, by dual numbers.
// 1. rates, capture force, latch forces, relative motion and energy by states, loads and time are
//    those of central differences of sixth order in Extended: free drift, contact of every
//    kind of surface with either friction law, latches open, held and releasing, hooks and faces, a
//    rigid joint, absorber, thrust, gravity, a drive, Newton closures;
// 2. the Jacobian by states is what passes in mixed directions give;
// 3. where a length is zero (striker on the axis of its hook, nothing slides, pose of the neighbour
//    list) derivatives are finite and right;
// 4. segment on annulus: the derivative is that of the solution, wherever the search ends;
// 5. no call allocates memory.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <optional>

#include "docking/docking_jacobian.hpp"
#include "mechanism/mechanism_jacobian.hpp"
#include "unit/allocations.hpp"
#include "unit/random_docking.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using V = Vec3<double>;
using L = Extended;

constexpr int kTrials = 6;
constexpr double kApart = -0.05;       // [m] so far apart no surface and no latch is felt
constexpr double kSums = 8e-15;        // worst residual 8.0e-16
constexpr double kLatches = 1.5e-13;   // worst residual 1.5e-14 (releasing)
constexpr double kAtRest = 5e-13;      // worst residual 4.3e-14
constexpr double kSegments = 1.1e-12;  // worst residual 1.1e-13

/// Inputs of the rates in any scalar, by the names of DockingPass.
struct LongInputs {
  L t;
  std::vector<L> y;
  ExternalLoads<L> loads;
};

/// One number that may vary.
struct Column {
  enum What { kState, kForce, kTorque, kGravity, kCommand, kTime } what;
  std::string kind;  ///< of the same unit and size
  L step;            ///< of the differences
  int index, vehicle;
};

template <class Inputs>
auto& get(Inputs& inputs, const Column& column) {
  switch (column.what) {
    case Column::kForce:
      return inputs.loads.force[column.vehicle][column.index];
    case Column::kTorque:
      return inputs.loads.torque[column.vehicle][column.index];
    case Column::kGravity:
      return inputs.loads.gravity[column.index];
    case Column::kCommand:
      return inputs.loads.command[column.index];
    case Column::kTime:
      return inputs.t;
    case Column::kState:
      break;
  }
  return inputs.y[static_cast<size_t>(column.index)];
}

/// Everything that can vary; of the bristles those of closed pairs and of one open pair. Steps are
/// small compared with what a surface needs to change its force, and large compared with rounding.
std::vector<Column> list_columns(const Docking& docking) {
  const StateLayout& layout = docking.model.layout;
  std::vector<Column> columns;
  const auto add = [&](Column::What what, const std::string& kind, L step, int first, int count,
                       int vehicle = 0) {
    for (int i = 0; i < count; ++i) columns.push_back({what, kind, step, first + i, vehicle});
  };
  const auto add_states = [&](const std::string& kind, L step, int first, int count) {
    add(Column::kState, kind, step, first, count);
  };
  add_states("mechanism_q", 3e-7L, layout.mechanism_q, layout.mechanism_nq);
  add_states("mechanism_v", 1e-6L, layout.mechanism_v, layout.mechanism_nv);
  for (int i : {kChaser, kTarget}) {
    const std::string name = i == kChaser ? "chaser" : "target";
    if (layout.pose[i] >= 0) {
      const L mass = docking.scene.vehicle[i].mass;
      add_states(name + "_position", 3e-7L, layout.pose[i], 3);
      add_states(name + "_quaternion", 1e-7L, layout.pose[i] + 3, 4);
      add_states(name + "_momentum", 1e-6L * mass, layout.momentum[i], 3);
      add_states(name + "_angular_momentum", 1e-6L * mass, layout.momentum[i] + 3, 3);
    }
    add(Column::kForce, name + "_force", 1.0L, 0, 3, i);
    add(Column::kTorque, name + "_torque", 1.0L, 0, 3, i);
  }
  int open = 1;
  for (int pair = 0; 3 * pair < layout.bristle_count; ++pair) {
    const bool closed = docking.data.contact_work.closed[pair];
    if (closed || open-- > 0) add_states("bristle", 3e-9L, layout.bristles + 3 * pair, 3);
  }
  add_states("sums", 1.0L, layout.sums, layout.sum_count);
  add(Column::kGravity, "gravity", 0.1L, 0, 3);
  add(Column::kCommand, "command", 1.0L, 0, static_cast<int>(docking.loads.command.size()));
  add(Column::kTime, "time", 1e-3L, 0, 1);
  return columns;
}

/// Rates and what can be read next to them; equal parts have one kind.
template <class S>
struct Results {
  std::vector<S> value;
  std::vector<std::string> kind;
};

template <class S>
Results<S> collect(const Docking& docking, const std::vector<S>& ydot, const DockingData<S>& data) {
  const StateLayout& layout = docking.model.layout;
  Results<S> results;
  const auto add = [&](const std::string& kind, const auto& numbers, int first, int count) {
    for (int i = first; i < first + count; ++i) {
      results.value.push_back(numbers[i]);
      results.kind.push_back(kind);
    }
  };
  add("mechanism_q", ydot, layout.mechanism_q, layout.mechanism_nq);
  add("mechanism_v", ydot, layout.mechanism_v, layout.mechanism_nv);
  for (int i : {kChaser, kTarget}) {
    if (layout.pose[i] < 0) continue;
    const std::string name = i == kChaser ? "chaser" : "target";
    add(name + "_position", ydot, layout.pose[i], 3);
    add(name + "_quaternion", ydot, layout.pose[i] + 3, 4);
    add(name + "_momentum", ydot, layout.momentum[i], 3);
    add(name + "_angular_momentum", ydot, layout.momentum[i] + 3, 3);
  }
  for (int i = 0; i < layout.sum_count; ++i)
    add("sum" + std::to_string(i), ydot, layout.sums + i, 1);
  add("impulse", ydot, layout.impulse, 3);
  add("angular_impulse", ydot, layout.impulse + 3, 3);
  add("bristle", ydot, layout.bristles, layout.bristle_count);
  add("capture_force", data.on_passive.f, 0, 3);
  add("capture_moment", data.on_passive.t, 0, 3);
  add("latch_force", data.latch.force, 0, docking.model.latches.count());
  if (docking.model.acts_across()) {
    add("hook_force", data.hard_dock.hook_force, 0, docking.model.hard_dock.hooks.count());
    add("force_across", data.on_target.f, 0, 3);
    add("moment_across", data.on_target.t, 0, 3);
  }
  const RelativeMotion<S> x = find_relative(data.interface[kChaser], data.interface[kTarget]);
  add("relative_position", x.p, 0, 3);
  add("relative_velocity", x.v, 0, 3);
  const std::array<S, 2> energy{find_kinetic_energy(docking.model, data),
                                data.contact.energy + data.latch.energy + data.joints.energy +
                                    data.hard_dock.energy + data.forces.energy};
  add("kinetic_energy", energy, 0, 1);
  add("potential_energy", energy, 1, 1);
  return results;
}

/// Derivatives by dual numbers, result x column.
MatX<double> find_derivatives(const Docking& docking, const std::vector<Column>& columns) {
  DockingPass pass(docking.model);
  MatX<double> found;
  for (size_t first = 0; first < columns.size(); first += kLanes) {
    const size_t count = std::min<size_t>(kLanes, columns.size() - first);
    start_docking_pass(docking.model, docking.loads, docking.t, docking.y.data(), pass);
    for (size_t i = 0; i < count; ++i) get(pass, columns[first + i]).d[i] = 1.0;
    EXPECT_TRUE(
        calc_docking_pass(docking.model, docking.discrete, docking.memory, docking.data, pass)
            .ok());
    const Results<Derivative> results = collect(docking, pass.ydot, pass.data);
    found.conservativeResize(static_cast<int>(results.value.size()),
                             static_cast<int>(columns.size()));
    for (int r = 0; r < found.rows(); ++r) {
      for (size_t i = 0; i < count; ++i) {
        found(r, static_cast<int>(first + i)) = results.value[static_cast<size_t>(r)].d[i];
      }
    }
  }
  return found;
}

/// The same by differences. @param kinds   of the results
/// @param noise  per result: rounding of the differences, times the step
MatX<L> find_differences(const Docking& docking, const std::vector<Column>& columns,
                         std::vector<std::string>& kinds, VecX<L>& noise) {
  const L weight[3] = {3.0L / 4, -3.0L / 20, 1.0L / 60};
  DockingData<L> data(docking.model);
  data.locked = docking.data.locked;
  const LongInputs start{
      docking.t, {docking.y.begin(), docking.y.end()}, cast_loads<L>(docking.loads)};
  std::vector<L> ydot(start.y.size());
  const auto evaluate = [&](const LongInputs& inputs) {
    data.mechanism.tree.q = docking.data.mechanism.tree.q.cast<L>();
    EXPECT_TRUE(calc_docking<L>(docking.model, docking.discrete, docking.memory, inputs.loads,
                                inputs.t, inputs.y.data(), ydot.data(), data)
                    .ok());
    const Results<L> results = collect(docking, ydot, data);
    kinds = results.kind;
    return VecX<L>(
        Eigen::Map<const VecX<L>>(results.value.data(), static_cast<int>(results.value.size())));
  };
  noise = evaluate(start).cwiseAbs();
  MatX<L> slopes(noise.size(), static_cast<int>(columns.size()));
  for (size_t j = 0; j < columns.size(); ++j) {
    const L h = columns[j].step;
    VecX<L> slope = VecX<L>::Zero(noise.size());
    for (int s = 1; s <= 3; ++s) {
      LongInputs above = start, below = start;
      get(above, columns[j]) += s * h;
      get(below, columns[j]) -= s * h;
      slope += weight[s - 1] / h * (evaluate(above) - evaluate(below));
    }
    slopes.col(static_cast<int>(j)) = slope;
  }
  return slopes;
}

/// Largest difference per block of results and columns of one kind, over the largest number there,
/// or over a millionth of result / step where that is more: what does not depend on a column is
/// zero only to rounding in differences.
void compare(const std::vector<Column>& columns, const std::vector<std::string>& kinds,
             const MatX<double>& found, const MatX<L>& expected, const VecX<L>& size,
             const std::string& where, std::map<std::string, Residual>& worst) {
  struct Block {
    L difference = 0, scale = 0;
  };
  std::map<std::string, std::map<std::string, Block>> blocks;
  for (int r = 0; r < found.rows(); ++r) {
    for (int c = 0; c < found.cols(); ++c) {
      const Column& column = columns[static_cast<size_t>(c)];
      Block& block = blocks[column.kind][kinds[static_cast<size_t>(r)]];
      const L difference = abs(static_cast<L>(found(r, c)) - expected(r, c));
      block.difference = std::isfinite(found(r, c)) ? std::max(block.difference, difference)
                                                    : std::numeric_limits<L>::infinity();
      block.scale =
          std::max<L>({block.scale, abs(expected(r, c)), 1e-6 * (size[r] + 1e-9) / column.step});
    }
  }
  for (const auto& [column, results] : blocks) {
    for (const auto& [result, block] : results) {
      worst[column].add(static_cast<double>(block.difference / block.scale), result + " " + where);
    }
  }
}

Scene ring_on_immobile_base() {
  Scene scene = ring();
  scene.motion[kChaser] = Motion::kFixed;
  return scene;
}

/// A wheel whose mass is off its axis, turned by a drive: pose, momentum and work depend on time.
Scene ring_with_driven_wheel() {
  json document = json::parse(read_test_file("scene_ring.json"));
  document["mechanism"]["bodies"].push_back(
      {{"name", "wheel"},
       {"parent", "base"},
       {"joint", {{"type", "revolute"}, {"axis", {1, 0, 0}}, {"position", {-0.5, 0.1, 0}}}},
       {"mass", 30.0},
       {"com", {0.1, 0.3, 0}},
       {"inertia", {{2, 0, 0}, {0, 1, 0}, {0, 0, 1.5}}}});
  document["mechanism"]["couplings"] = {
      {{"name", "motor"}, {"dependent", "wheel"}, {"rate", 2.0}, {"offset", 0.3}}};
  return read_scene(document.dump(), "driven");
}

struct Case {
  const char* name;
  std::function<Scene()> scene;
  double depth, lateral, tilt;       ///< of the surfaces; bounds of offsets
  std::optional<PairKind> touching;  ///< a pair of this kind takes part in every trial
  int friction_model;
  std::function<void(Docking&, TestRandom&)> change;
  double tolerance;  ///< ten times what was measured
};

void PrintTo(const Case& at, std::ostream* out) { *out << at.name; }

const auto unchanged = [](Docking&, TestRandom&) {};

void put_bristles(Docking& docking, TestRandom& random) {
  for (int j = 0; j < docking.model.layout.bristle_count; ++j) {
    docking.y[docking.model.layout.bristles + j] = random.uniform(-1e-4, 1e-4);
  }
}

class DockingDerivatives : public ::testing::TestWithParam<Case> {};

/// A random state in which the surfaces touch as the case wants.
Docking draw(const Case& at, const Scene& scene, TestRandom& random) {
  return draw_docking(at.touching, [&] {
    Docking docking(scene, at.friction_model);
    docking.set_random_state(random, at.depth, at.lateral, at.tilt);
    return docking;
  });
}

TEST_P(DockingDerivatives, are_those_of_central_differences) {
  const Case& at = GetParam();
  const Scene scene = at.scene();
  TestRandom random(71);
  std::map<std::string, Residual> worst;
  bool loaded = false;
  for (int trial = 0; trial < kTrials; ++trial) {
    Docking docking = draw(at, scene, random);
    at.change(docking, random);
    docking.evaluate();
    loaded = loaded || docking.data.on_passive.f.norm() + docking.data.on_target.f.norm() > 0.0;
    const std::vector<Column> columns = list_columns(docking);
    std::vector<std::string> kinds;
    VecX<L> size;
    const MatX<L> expected = find_differences(docking, columns, kinds, size);
    compare(columns, kinds, find_derivatives(docking, columns), expected, size,
            "trial " + std::to_string(trial), worst);
  }
  EXPECT_EQ(loaded, at.depth > kApart) << "whether surfaces or latches push";
  for (const auto& [kind, residual] : worst) {
    EXPECT_RESIDUAL_BELOW(residual, at.tolerance) << ", by " << kind;
  }
}

void load(Docking& docking, TestRandom& random) { docking.set_random_loads(random); }

/// All latches in one mode, in the middle of a release ramp of 0.05 s.
template <LatchMode mode>
void set_latches(Docking& docking, TestRandom&) {
  docking.t = 7.02;
  for (int i = 0; i < docking.model.latches.count(); ++i) {
    docking.discrete.latch[static_cast<size_t>(i)] = {mode, 7.0 - 0.01 * i};
  }
}

constexpr PairKind kPointAnnulus = PairKind::kPointAnnulus,
                   kSegmentAnnulus = PairKind::kSegmentAnnulus, kPlatePlate = PairKind::kPlatePlate,
                   kPointPlate = PairKind::kPointPlate;
constexpr auto kNone = std::nullopt;

INSTANTIATE_TEST_SUITE_P(
    cases, DockingDerivatives,
    // The tolerances are ten times what was measured; 1.1e-10 is the worst (nodes on ring, capture
    // force by the target's quaternion, at an arm of 15 m). By kind of column over all cases: force
    // 2.1e-13, torque 1.8e-13, gravity 8.1e-16, command 1.2e-14, time 6.9e-12, mechanism 3.4e-11,
    // momentum 1.9e-11, bristle 3.7e-11, position 3.3e-11. Surfaces and latches are as stiff as
    // 1e6 N/m over a toe of 5e-5 m, which magnifies rounding of poses, here and in differences.
    ::testing::Values(
        Case{"free_flight", ring, kApart, 0.2, 0.12, kNone, 1, unchanged, 7e-12},
        Case{"loads_thrust_and_command", ring, kApart, 0.2, 0.12, kNone, 1, load, 1.1e-11},
        Case{"gravity_on_an_immobile_base", ring_on_immobile_base, 5e-4, 0.2, 0.12, kNone, 1, load,
             1.6e-11},
        Case{"nodes_on_ring", ring, 1e-3, 4e-3, 2e-3, kPointAnnulus, 1, unchanged, 1.1e-9},
        Case{"nodes_on_ring_with_bristles", ring, 1e-3, 4e-3, 2e-3, kPointAnnulus, 2, put_bristles,
             4.7e-10},
        Case{"edge_on_ring", ring, 2e-3, 0.2, 0.12, kSegmentAnnulus, 1, unchanged, 7.4e-12},
        Case{"edge_on_ring_with_bristles", ring, 2e-3, 0.2, 0.12, kSegmentAnnulus, 2, put_bristles,
             4.1e-11},
        Case{"petal_on_petal", ring, 2e-3, 0.2, 0.12, kPlatePlate, 1, unchanged, 7.1e-12},
        Case{"petal_on_petal_with_bristles", ring, 2e-3, 0.2, 0.12, kPlatePlate, 2, put_bristles,
             2.1e-11},
        Case{"node_on_petal", ring, 2e-3, 0.4, 0.3, kPointPlate, 1, unchanged, 2e-10},
        Case{"into_the_barrier", ring, 7e-3, 0.05, 0.05, kSegmentAnnulus, 1, unchanged, 5.5e-11},
        Case{"latches_open", ring_without_surfaces, -0.01, 0.0, 0.03, kNone, 1,
             set_latches<LatchMode::kOpen>, 3.7e-11},
        Case{"latches_held", ring_without_surfaces, -0.012, 0.0, 0.01, kNone, 1,
             set_latches<LatchMode::kHeld>, 3.1e-10},
        Case{"latches_releasing", ring_without_surfaces, -0.012, 0.0, 0.01, kNone, 1,
             set_latches<LatchMode::kReleasing>, 4e-10},
        Case{"hooks_and_faces", ring_with_hooks, -0.01, 0.0, 0.03, kNone, 1, dock, 1e-9},
        Case{"forces_between_the_vehicles", ring_with_forces, 0.3, 0.2, 0.12, kNone, 1, unchanged,
             5e-13},
        // The relative velocity of joined vehicles is a rounding error, and its derivatives are.
        Case{"rigid_joint", ring_with_hooks, -0.01, 0.0, 0.03, kNone, 1,
             [](Docking& docking, TestRandom& random) {
               static LockedMechanism locked;
               dock(docking, random);
               docking.set_random_loads(random);
               join(docking, locked);
             },
             4e-6},
        Case{"absorber", absorber, 2e-3, 0.0, 0.1, kNone, 1, load, 2.9e-10},
        Case{"hooks_of_fingers", fingers, 1e-3, 0.02, 0.02, PairKind::kSegmentRevolution, 1, load,
             1.5e-11},
        Case{"hooks_of_fingers_with_bristles", fingers, 1e-3, 0.02, 0.02,
             PairKind::kSegmentRevolution, 2, put_bristles, 1.5e-11},
        Case{"pad_of_a_finger", fingers, 1e-3, 0.05, 0.05, kPointPlate, 1, unchanged, 1.5e-11},
        Case{"disc_on_a_finger", fingers, 1e-3, 0.05, 0.05, PairKind::kPointRevolution, 1,
             unchanged, 1.7e-11},
        Case{"driven_wheel", ring_with_driven_wheel, 5e-4, 0.2, 0.12, kNone, 1,
             [](Docking& docking, TestRandom&) { docking.t = 1.7; }, 1e-10},
        Case{"newton_closures", ring, 5e-4, 0.2, 0.12, kNone, 1,
             [](Docking& docking, TestRandom&) { docking.close_by_newton(); }, 2.1e-11}),
    [](const ::testing::TestParamInfo<Case>& at) { return std::string(at.param.name); });

/// Every lane a random direction, in which everything varies.
void seed_everything(const Docking& docking, DockingPass& pass) {
  start_docking_pass(docking.model, docking.loads, docking.t, docking.y.data(), pass);
  TestRandom random(72);
  const auto seed = [&](auto& numbers) {
    for (Derivative& x : numbers) {
      for (double& d : x.d) d = random.uniform(-1, 1);
    }
  };
  seed(pass.y);
  for (int i : {kChaser, kTarget}) {
    seed(pass.loads.force[i]);
    seed(pass.loads.torque[i]);
  }
  seed(pass.loads.gravity);
  seed(pass.loads.command);
  pass.t.d[0] = 1.0;
}

MatX<double> get_rate_derivatives(const DockingPass& pass) {
  MatX<double> slopes(static_cast<int>(pass.ydot.size()), kLanes);
  for (int i = 0; i < slopes.rows(); ++i) {
    for (int lane = 0; lane < kLanes; ++lane) {
      slopes(i, lane) = pass.ydot[static_cast<size_t>(i)].d[lane];
    }
  }
  return slopes;
}

TEST(DockingJacobian, holds_what_passes_in_mixed_directions_give) {
  for (const int friction_model : {1, 2}) {
    TestRandom random(73);
    Docking docking(ring(), friction_model);
    docking.set_random_state(random, 1e-3);
    put_bristles(docking, random);
    docking.evaluate();
    const int n = docking.model.layout.size;
    DockingPass pass(docking.model);
    MatX<double> jacobian(n, n), directions(n, kLanes);
    ASSERT_TRUE(calc_docking_jacobian(docking.model, docking.discrete, docking.memory, docking.data,
                                      docking.loads, docking.t, docking.y.data(), pass, jacobian)
                    .ok());
    start_docking_pass(docking.model, docking.loads, docking.t, docking.y.data(), pass);
    for (int i = 0; i < n; ++i) {
      for (int lane = 0; lane < kLanes; ++lane) {
        directions(i, lane) = pass.y[static_cast<size_t>(i)].d[lane] = random.uniform(-1, 1);
      }
    }
    ASSERT_TRUE(
        calc_docking_pass(docking.model, docking.discrete, docking.memory, docking.data, pass)
            .ok());
    EXPECT_LE(find_relative_error(MatX<double>(jacobian * directions), get_rate_derivatives(pass)),
              scaled_tolerance(kSums))
        << "friction model " << friction_model;
  }
}

TEST(DockingPass, is_the_same_with_a_neighbour_list_made_at_this_very_pose) {
  // The distance from the reference pose is zero and has no derivative there.
  TestRandom random(74);
  Docking docking(ring());
  docking.set_random_state(random, 1e-3);
  docking.evaluate();
  DockingPass without(docking.model), with(docking.model);
  seed_everything(docking, without);
  ASSERT_TRUE(
      calc_docking_pass(docking.model, docking.discrete, docking.memory, docking.data, without)
          .ok());
  update_contact_memory(docking.model.contact, docking.data.relative, nullptr,
                        docking.data.contact_work, docking.memory);
  seed_everything(docking, with);
  ASSERT_TRUE(
      calc_docking_pass(docking.model, docking.discrete, docking.memory, docking.data, with).ok());
  EXPECT_TRUE(get_rate_derivatives(with).allFinite());
  EXPECT_EQ((get_rate_derivatives(with) - get_rate_derivatives(without)).norm(), 0.0);
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(DockingPass, allocates_nothing) {
  for (const int friction_model : {1, 2}) {
    TestRandom random(75);
    Docking docking(ring(), friction_model);
    docking.set_random_state(random, 1e-3);
    set_latches<LatchMode::kHeld>(docking, random);
    docking.evaluate();
    const int n = docking.model.layout.size;
    DockingPass pass(docking.model);
    MatX<double> jacobian(n, n);
    const long count = count_allocations([&] {
      calc_docking_jacobian(docking.model, docking.discrete, docking.memory, docking.data,
                            docking.loads, docking.t, docking.y.data(), pass, jacobian);
    });
    EXPECT_GT(jacobian.norm(), 0.0);
    EXPECT_EQ(count, 0) << "friction model " << friction_model;
  }
}
#endif

/// Dual numbers against differences for a function of up to eight numbers, VecX<S>(VecX<S>).
template <class F>
void compare_function(F f, const VecX<double>& x, L h, const std::string& where,
                      Residual& residual) {
  VecX<Derivative> seeded = x.cast<Derivative>();
  for (int i = 0; i < x.size(); ++i) seeded[i].d[i] = 1.0;
  const VecX<Derivative> y = f(seeded);
  MatX<double> found(y.size(), x.size());
  MatX<L> expected = MatX<L>::Zero(y.size(), x.size());
  const L weight[3] = {3.0L / 4, -3.0L / 20, 1.0L / 60};
  for (int i = 0; i < x.size(); ++i) {
    for (int j = 0; j < y.size(); ++j) found(j, i) = y[j].d[i];
    for (int s = 1; s <= 3; ++s) {
      VecX<L> above = x.cast<L>(), below = above;
      above[i] += s * h;
      below[i] -= s * h;
      expected.col(i) += weight[s - 1] / h * (f(above) - f(below));
    }
  }
  residual.add(find_relative_error(found, expected), where);
}

TEST(LatchDerivatives, are_right_on_the_axis_of_the_hook) {
  LatchSet set;
  set.latch.push_back({LatchLaw(), V(0, 0.6, 0), V(0, 0.6, 0), LatchMeasure::kActiveAxis});
  for (const LatchMode mode : {LatchMode::kOpen, LatchMode::kHeld, LatchMode::kReleasing}) {
    const LatchState state{mode, 2.0};
    const auto forces = [&](const auto& x) {
      using S = typename std::decay_t<decltype(x)>::Scalar;
      RelativeMotion<S> motion;
      motion.p = x.template segment<3>(0);
      motion.v = x.template segment<3>(3);
      LatchResult<S> result;
      calc_latches<S>(set, &state, x[6], motion, result);
      VecX<S> all(8);
      all << result.on_passive.f, result.on_passive.t, result.energy, result.power;
      return all;
    };
    VecX<double> x(7);
    x << 0.011, 0, 0, 0.02, 0.01, -0.03, 2.03;
    Residual residual;
    compare_function(forces, x, 1e-5L, "mode " + std::to_string(static_cast<int>(mode)), residual);
    EXPECT_RESIDUAL_BELOW(residual, kLatches);
  }
}

TEST(ContactDerivatives, are_right_where_nothing_slides) {
  for (const int friction_model : {1, 2}) {
    Docking docking(ring(), friction_model);
    const ContactModel& model = docking.model.contact;
    TestRandom random(76);
    ContactWorkspace<double> place(model);
    const RelativeMotion<double> touching = make_touching_motion(model, place, random, 1e-3);
    const ContactMemory memory;
    const auto forces = [&](const auto& x) {
      using S = typename std::decay_t<decltype(x)>::Scalar;
      RelativeMotion<S> motion = cast_motion<S>(touching);
      motion.p += x.template head<3>();
      motion.v = x.template segment<3>(3);
      motion.w = VecX<S>::Zero(3);
      std::vector<S> z(static_cast<size_t>(3 * model.pair_count()), S(0)), rate = z;
      ContactWorkspace<S> work(model);
      ContactResult<S> result;
      EXPECT_TRUE(calc_contact<S>(model, memory, motion, z.data(), rate.data(), work, result).ok());
      VecX<S> all(8);
      all << result.on_passive.f, result.on_passive.t, result.energy, result.friction_power;
      return all;
    };
    Residual residual;
    compare_function(forces, VecX<double>::Zero(6), 3e-7L, "at rest", residual);
    EXPECT_RESIDUAL_BELOW(residual, kAtRest) << ", friction model " << friction_model;
  }
}

TEST(SegmentOnAnnulusDerivatives, are_those_of_the_solution_wherever_the_search_ends) {
  const Annulus<double> ring{-0.01, 0.617, 0.647};
  TestRandom random(77);
  Residual residual;
  int at_an_end = 0, above_the_ring = 0, next_to_the_ring = 0;
  for (int n = 0; n < 600; ++n) {
    const double azimuth = random.uniform(0, 6.28);
    const V radial(0, std::cos(azimuth), std::sin(azimuth)), along(0, -radial[2], radial[1]);
    const V p0 = random.uniform(0.56, 0.66) * radial + V(random.uniform(0.0, 0.02), 0, 0);
    const V d = V(random.uniform(-0.1, 0.1), 0, 0) + random.uniform(-0.2, 0.2) * radial +
                random.uniform(-0.2, 0.2) * along;
    const auto points = [&](const auto& x) {
      using S = typename std::decay_t<decltype(x)>::Scalar;
      const Closest<S> c =
          find_segment_annulus<S>(x.template head<3>(), x.template tail<3>(),
                                  Annulus<S>{S(ring.x), S(ring.inner), S(ring.outer)}, S(1e-4));
      VecX<S> all(7);
      all << c.first, c.second, c.square;
      return all;
    };
    VecX<double> x(6);
    x << p0, d;
    const VecX<double> plain = points(x);
    const VecX<Derivative> dual = points(VecX<Derivative>(x.cast<Derivative>()));
    for (int i = 0; i < 7; ++i) EXPECT_EQ(dual[i].value, plain[i]) << "segment " << n;
    const double t = (plain.head<3>() - p0).norm() / d.norm();
    const double r = std::hypot(plain[1], plain[2]);
    const bool ends = t < 1e-9 || t > 1 - 1e-9, above = r > ring.inner && r < ring.outer;
    at_an_end += ends;
    above_the_ring += !ends && above;
    next_to_the_ring += !ends && !above;
    compare_function(points, x, 1e-6L, "segment " + std::to_string(n), residual);
  }
  EXPECT_GT(at_an_end, 30);
  EXPECT_GT(above_the_ring, 30);
  EXPECT_GT(next_to_the_ring, 30);
  EXPECT_RESIDUAL_BELOW(residual, kSegments);
}

}  // namespace
}  // namespace dockloop
