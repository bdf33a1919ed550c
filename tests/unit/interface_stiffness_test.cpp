// Frequency and damping rate of two vehicles on what joins them.
// 1. one spring-damper with lever arms, either vehicle immobile: the formulas of a textbook;
// 2. a slide in between: springs in series, each damper with its share of the motion; not touching:
//    the slide's spring alone; a slide without a spring: nothing;
// 3. the hexapod latched and pressed, with either friction law: the slow modes of the whole system,
//    linearised without condensation; not touching: the same, as a firm capture will have them;
// 4. any state gives a finite number, and no call allocates, throws or locks.
#include "docking/interface_stiffness.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "unit/minimal_scene.hpp"
#include "unit/random_docking.hpp"
#include "unit/traps.hpp"

namespace dockloop {
namespace {

using nlohmann::json;
using V = Vec3<double>;

constexpr double kTextbook = 5e-10;  // worst residual 4.6e-11: load of the spring times arm
constexpr double kSettled = 1.1e-5;  // worst residual 1.1e-6: end of the repetition
constexpr double kLinked = 5e-6;     // worst residual 5.0e-7: the link is a millionth as soft

/// A docking at rest that can be asked.
struct Held : Docking {
  explicit Held(const Scene& from, int friction_model = 1)
      : Docking(from, friction_model), work(model) {
    get_mechanism_state(model, data.mechanism.tree, y.data());
    TestRandom random(3);
    if (model.moves[kChaser]) put_pose(kChaser, {rotation_of(random.vector(0.4)), V(-4, 0.2, 0)});
  }
  /// P relative to G.
  void place(const V& position, const V& rotation = V::Zero()) {
    evaluate();
    put_pose(kTarget, Pose<double>{data.capture.R, data.capture.p} *
                          Pose<double>{rotation_of(rotation), position} *
                          inverse(model.interface_pose[kTarget]));
    evaluate();
    if (!model.contact.empty()) {
      update_contact_memory(model.contact, data.relative, nullptr, data.contact_work, memory);
    }
  }
  double find() {
    evaluate();
    return find_interface_frequency(model, discrete, memory, data, loads, t, y.data(), work);
  }
  InterfaceWorkspace work;
};

/// Springs and dampers in a row along x, interfaces off the lines through the centres of mass.
struct Row {
  Motion chaser = Motion::kFree, target = Motion::kFree;
  double slide_stiffness = -1, slide_damping = 0;  ///< [N/m], [N s/m]; stiffness < 0: no slide
  double stiffness = 3e4, damping = 900;           ///< of the absorber

  Scene scene() const {
    json document = json::parse(minimal_scene_text());
    document["chaser"]["interface_position"] = {4, 0.7, -0.4};
    document["chaser"]["inertia"] = {6e4, 13e4, 11e4, 2e3, -1e3, 4e3};
    document["target"]["interface_position"] = {-15, -2, 3};
    json& mechanism = document["mechanism"];
    mechanism["contact"]["stiffness"] = stiffness;
    mechanism["contact"]["damping"] = damping;
    if (slide_stiffness >= 0) {
      mechanism["bodies"] = {{{"name", "slide"},
                              {"parent", "base"},
                              {"joint", {{"type", "prismatic"}, {"axis", {1, 0, 0}}}},
                              {"mass", 1e-6}}};
      mechanism["capture"] = {{"body", "slide"}};
      mechanism["forces"] = {{{"type", "joint_spring_damper"},
                              {"joint", "slide"},
                              {"stiffness", slide_stiffness},
                              {"damping", slide_damping}}};
    }
    Scene result = read_scene(document.dump(), "row");
    result.motion = {chaser, target};
    return result;
  }
};

/// Acceleration of P relative to G, axes of G, per load on P there and its opposite on G: W.
Mat6<double> find_mobility(const Held& held) {
  Mat6<double> sum = Mat6<double>::Zero();
  for (int i : {kChaser, kTarget}) {
    if (!held.model.moves[i]) continue;
    const FrameMotion<double>& body = held.data.vehicle[i];
    const Mat3<double> R = body.R.transpose() * held.data.capture.R;
    const V arm = body.R.transpose() * (held.data.capture.p - body.p);
    const Mat3<double> inverse = make_symmetric(held.scene.vehicle[i].inertia).inverse();
    for (int j = 0; j < 6; ++j) {
      const V force = j < 3 ? V(R.col(j)) : V(V::Zero());
      const V moment = j < 3 ? V(arm.cross(force)) : V(R.col(j - 3));
      const V turn = inverse * moment;
      const V linear = force / held.scene.vehicle[i].mass + turn.cross(arm);
      sum.col(j).head<3>() += R.transpose() * linear;
      sum.col(j).tail<3>() += R.transpose() * turn;
    }
  }
  return sum;
}

TEST(InterfaceStiffness, one_spring_between_vehicles_has_the_frequency_of_a_textbook) {
  Row row;
  Residual difference;
  for (const Motion chaser : {Motion::kFree, Motion::kFixed}) {
    for (const Motion target : {Motion::kFree, Motion::kFixed, Motion::kDriven}) {
      row.chaser = chaser;
      row.target = target;
      Held held(row.scene());
      held.place(V(-1e-9, 0, 0));
      const double found = held.find();
      if (chaser == Motion::kFixed && target == Motion::kFixed) {
        EXPECT_EQ(found, 0.0);
        continue;
      }
      const double inverse_mass = find_mobility(held)(0, 0);
      difference.add(found / std::sqrt(row.stiffness * inverse_mass) - 1, "frequency");
      difference.add(held.work.damping_rate[5] / (row.damping * inverse_mass) - 1, "damping");
      EXPECT_LT(held.work.squared_frequency[4], 1e-6 * found * found);
    }
  }
  EXPECT_RESIDUAL_BELOW(difference, kTextbook);
}

TEST(InterfaceStiffness, a_damper_that_dominates_gives_its_rate) {
  Row row;
  row.damping = 1e5;
  Held held(row.scene());
  held.place(V(-1e-9, 0, 0));
  Residual difference;
  difference.add(held.find() / (row.damping * find_mobility(held)(0, 0)) - 1);
  EXPECT_RESIDUAL_BELOW(difference, kTextbook);
}

TEST(InterfaceStiffness, nothing_between_the_vehicles_gives_zero) {
  Held held(Row().scene());
  held.place(V(0.01, 0, 0));
  EXPECT_EQ(held.find(), 0.0);
}

TEST(InterfaceStiffness, springs_in_a_row_share_the_motion) {
  Row row;
  row.slide_stiffness = 7e3;
  Residual difference, linked;
  using Motions = std::pair<Motion, Motion>;
  for (const Motions& motion :
       {Motions{Motion::kFree, Motion::kFree}, Motions{Motion::kFixed, Motion::kFree},
        Motions{Motion::kFree, Motion::kFixed}}) {
    row.chaser = motion.first;
    row.target = motion.second;
    for (const double slide_damping : {0.0, 400.0, 4e5}) {
      row.slide_damping = slide_damping;
      Held held(row.scene());
      held.place(V(-1e-9, 0, 0));
      const double found = held.find(), inverse_mass = find_mobility(held)(0, 0);
      const std::complex<double> a(row.slide_stiffness, found * row.slide_damping),
          b(row.stiffness, found * row.damping), both = a * b / (a + b) * inverse_mass;
      difference.add(std::max(std::sqrt(both.real()), both.imag() / found) / found - 1, "largest");
      difference.add(held.work.squared_frequency[5] / both.real() - 1, "square");
      difference.add(held.work.damping_rate[5] * found / both.imag() - 1, "damping");
    }
    // Apart: what a rigid capture will feel. The slide then guides the vehicles, which are heavier
    // so, and what it cannot give across does not count.
    row.slide_damping = 0.0;
    Held held(row.scene());
    held.place(V(0.01, 0, 0));
    const double mass = find_mobility(held).inverse()(0, 0);
    linked.add(held.find() / std::sqrt(row.slide_stiffness / mass) - 1);
  }
  EXPECT_RESIDUAL_BELOW(difference, kSettled);
  EXPECT_RESIDUAL_BELOW(linked, kLinked);
}

TEST(InterfaceStiffness, a_slide_without_a_spring_transmits_nothing) {
  Row row;
  row.slide_stiffness = 0;
  Held held(row.scene());
  held.place(V(-1e-9, 0, 0));
  EXPECT_LT(held.find(), 1e-4);  // of about 1.2 rad/s if it were held
  held.place(V(0.01, 0, 0));
  EXPECT_EQ(held.find(), 0.0);
}

/// The shipped hexapod on two vehicles at rest, its latches closed.
Held hexapod(bool damped, int friction_model, double opening, double displacement = 0.0) {
  Scene scene = read_test_scene("scene_ring.json");
  if (!damped) {
    for (JointForce& force : scene.mechanism.forces) force.damping = 0.0;
    for (Latch& latch : scene.latches.latch) latch.law.hold_damping = 0.0;
    scene.contact.law.damping = 0.0;
    scene.contact.law.bristle_damping = 0.0;
  }
  Held held(scene, friction_model);
  TestRandom random(11);
  const V moved = random.vector(displacement), turned = random.vector(displacement);
  const Vec4<double> quat = quat_exp<double>(turned);
  for (int j = 0; j < 3; ++j) held.y[held.model.layout.mechanism_q + j] += moved[j];
  for (int j = 0; j < 4; ++j) held.y[held.model.layout.mechanism_q + 3 + j] = quat[j];
  for (LatchState& state : held.discrete.latch) state.mode = LatchMode::kHeld;
  held.place(V(opening, 0, 0));
  return held;
}

/// Magnitudes of the oscillating modes of the whole system in a range, ascending.
std::vector<double> find_whole_modes(Held& held, double from, double to) {
  DockingPass pass(held.model);
  MatX<double> jacobian(held.model.layout.size, held.model.layout.size);
  EXPECT_TRUE(calc_docking_jacobian(held.model, held.discrete, held.memory, held.data, held.loads,
                                    held.t, held.y.data(), pass, jacobian)
                  .ok());
  const Eigen::EigenSolver<MatX<double>> solver(jacobian, false);
  std::vector<double> modes;
  for (const std::complex<double>& value : solver.eigenvalues()) {
    const double frequency = std::abs(value);
    if (value.imag() > 0.0 && frequency > from && frequency < to) modes.push_back(frequency);
  }
  std::sort(modes.begin(), modes.end());
  return modes;
}

/// The vehicles on the legs have modes of 0.5 to 0.6 rad/s, the ring begins at 6.
constexpr double kSlowest = 0.3, kFastest = 3.0;
constexpr double kModes = 0.02;  // as specified; worst residual 9.8e-3 (pressed with 7.8 kN)

/// Compare the frequencies of the last call with modes of the whole system, the largest first.
void expect_modes(const Held& held, const std::vector<double>& whole, const std::string& what) {
  std::vector<double> found;
  for (const double square : held.work.squared_frequency) {
    if (square > kSlowest * kSlowest) found.push_back(std::sqrt(square));
  }
  ASSERT_EQ(found.size(), whole.size()) << what;
  Residual difference;
  for (size_t i = 0; i < found.size(); ++i) {
    difference.add(found[i] / whole[i] - 1, what + ", mode " + std::to_string(i));
  }
  EXPECT_RESIDUAL_BELOW(difference, kModes);
}

TEST(InterfaceStiffness, a_latched_hexapod_has_the_slow_modes_of_the_whole_system) {
  struct Case {
    std::string name;
    bool damped;
    int friction_model;
    double opening;  ///< [m]: beyond 5 mm latches pull, below 0 surfaces press
    double displacement;
    size_t count;
  };
  for (const Case& c : {Case{"latches pull", false, 1, 0.0053, 0.0, 1},
                        Case{"latches pull, dampers", true, 1, 0.0053, 0.0, 1},
                        Case{"pressed, bristles", false, 2, -1e-3, 0.0, 3},
                        Case{"pressed, bristles, dampers", true, 2, -1e-3, 0.0, 3},
                        Case{"pressed, regularised friction", true, 1, -1e-3, 0.0, 3},
                        Case{"ring displaced", true, 2, -2e-4, 0.03, 3}}) {
    Held held = hexapod(c.damped, c.friction_model, c.opening, c.displacement);
    const double found = held.find();
    const std::vector<double> whole = find_whole_modes(held, kSlowest, kFastest);
    ASSERT_EQ(whole.size(), c.count) << c.name;
    expect_modes(held, whole, c.name);
    EXPECT_NEAR(found / whole.back(), 1.0, kModes) << c.name;
  }
}

TEST(InterfaceStiffness, apart_a_mechanism_shows_what_a_firm_capture_will_feel) {
  Held pressed = hexapod(false, 2, -1e-4);
  const std::vector<double> whole = find_whole_modes(pressed, kSlowest, kFastest);
  Held loose = hexapod(false, 2, 0.002);  // latches closed, but within their play
  EXPECT_NEAR(loose.find() / whole.back(), 1.0, kModes);
  EXPECT_EQ(loose.data.on_passive.f.norm(), 0.0);
  expect_modes(loose, whole, "loose");
  Held far = hexapod(false, 2, 1.0);
  far.discrete = DiscreteState();
  EXPECT_GT(far.find(), 0.0);
  EXPECT_EQ(far.data.on_passive.f.norm(), 0.0);
}

TEST(InterfaceStiffness, any_state_gives_a_finite_number) {
  TestRandom random(5);
  int positive = 0;
  for (int friction_model : {1, 2}) {
    Held held(read_test_scene("scene_ring.json"), friction_model);
    for (int i = 0; i < 60; ++i) {
      held.put_pose(kTarget, {Mat3<double>::Identity(), V(30, 0, 0)});
      held.set_random_state(random, i % 3 ? random.uniform(0.0, 3e-3) : -0.05);
      held.set_random_loads(random);
      for (size_t k = 0; k < kMaxLatches; ++k) {
        held.discrete.latch[k].mode = static_cast<LatchMode>(1 + (i + k) % 4);
      }
      const double found = held.find();
      EXPECT_TRUE(std::isfinite(found) && found >= 0.0) << found << " at " << i;
      positive += found > 0.0;
    }
  }
  EXPECT_GT(positive, 100);
}

TEST(LargestDelay, is_the_first_one_with_a_motion_of_constant_amplitude) {
  using Complex = std::complex<double>;
  TestRandom random(17);
  for (int i = 0; i < 200; ++i) {
    const V draw = random.vector(1.0);
    const double k = std::exp(4.0 * draw[0]), c = 3.0 * std::abs(draw[1]) * std::sqrt(k);
    const double share = i % 2 ? 1.0 : 0.05 + 0.95 * std::abs(draw[2]);
    double w = 0.0;
    const double delay = find_largest_delay(k, c, share, w);
    const auto residual = [&](double at, double T) {
      const Complex z(k, at * c);
      return at * at - z * (1.0 - share + share * std::exp(Complex(0.0, -at * T)));
    };
    if (w > 0.0) {
      EXPECT_LE(std::abs(residual(w, delay)), 1e-9 * w * w) << k << " " << c << " " << share;
    } else {
      EXPECT_EQ(delay, kNoDelayLimit);
    }
    // At no frequency a shorter delay does the same: |w^2/z - (1 - share)| is not share there.
    for (int n = 1; n < 4000; ++n) {
      const double at = 0.002 * n * (std::sqrt(k) + c);
      const Complex z(k, at * c), turn = (at * at / z - (1.0 - share)) / share;
      if (std::abs(std::abs(turn) - 1.0) > 1e-4) continue;
      double angle = -std::arg(turn);
      if (angle < -1e-3) angle += 2.0 * M_PI;
      EXPECT_GE(angle / at, 0.98 * delay - 1e-3 / at) << k << " " << c << " " << share;
    }
  }
  double w = 0.0;
  EXPECT_NEAR(find_largest_delay(100.0, 0.02, 1.0, w), 0.02 / 100.0, 1e-8);  // c/k
  EXPECT_NEAR(w, 10.0, 1e-4);
}

TEST(InterfaceStiffness, a_scene_without_a_target_gives_zero) {
  EXPECT_EQ(Held(read_test_scene("scene_slider_crank.json")).find(), 0.0);
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(InterfaceStiffness, no_call_allocates) {
  for (const double opening : {-1e-3, 0.002}) {
    Held held = hexapod(true, 2, opening);
    double found = 0.0;
    const Trapped trapped = trap([&] { found = held.find(); });
    EXPECT_GT(found, 0.0);
    EXPECT_EQ(trapped.allocations, 0);
    EXPECT_EQ(trapped.exceptions, 0);
    EXPECT_EQ(trapped.locks, 0);
  }
}
#endif

}  // namespace
}  // namespace dockloop
