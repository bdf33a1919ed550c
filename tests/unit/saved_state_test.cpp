// Keeping and restoring a simulation, in the middle of whatever goes on.
// 1. saved and restored around every step, a run gives the bits of the uninterrupted run: in
//    contact, with bristles, latched, with every method of integration, with driven vehicles and
//    sloped inputs, through a change of independent coordinates;
// 2. the same in another simulation, and through bytes;
// 3. saving again allocates nothing;
// 4. what does not fit is refused, and the simulation goes on as if nothing had been asked.
#include <gtest/gtest.h>

#include <functional>

#include "sim/sim_state.hpp"
#include "unit/allocations.hpp"
#include "unit/minimal_scene.hpp"
#include "unit/sim_test_support.hpp"

namespace dockloop {
namespace {

/// What a host does before step i; must depend on i only.
using Host = std::function<void(DockingSim&, int)>;

struct Run {
  std::string name;
  std::shared_ptr<const Scene> scene;
  std::function<void(Parameters&)> choose = [](Parameters&) {};
  Host before_step = [](DockingSim&, int) {};
  int steps = 60;
  double h = 0.01;
  const char* seen = "";  ///< what must have happened, so that the run shows something
};

void PrintTo(const Run& run, std::ostream* out) { *out << run.name; }

/// A crank and a slider, started near the pose where the slider cannot be independent.
std::shared_ptr<const Scene> slider_crank_scene() {
  return share(read_scene(read_test_file("scene_slider_crank.json"), "scene_slider_crank.json"));
}

std::shared_ptr<const Scene> driven_scene() {
  Scene scene = short_ring_scene();
  scene.motion[kTarget] = Motion::kDriven;
  return share(scene);
}

void push(DockingSim& sim, int i) {
  Inputs& in = sim.inputs();
  Inputs& slope = sim.input_slopes();
  in.vehicle[kChaser].force_ext = Vec3<double>(20.0 * (i % 3), -5.0, 3.0);
  slope.vehicle[kChaser].torque_ext = Vec3<double>(1.0, 2.0, -100.0 * (i % 2));
  slope.gravity = Vec3<double>(0.0, 0.1 * i, 0.0);
}

void drive(DockingSim& sim, int i) {
  Inputs::Vehicle& target = sim.inputs().vehicle[kTarget];
  target.position += 0.01 * target.velocity;
  target.velocity.y() = 1e-3 * (i % 4);
}

std::vector<Run> make_runs() {
  const auto ring = share(short_ring_scene());
  std::vector<Run> runs;
  runs.push_back({"contact", ring});
  runs.back().steps = 400;
  runs.back().seen = "latched";
  runs.push_back({"bristles", ring, [](Parameters& p) { p.friction_model = 2; }});
  runs.push_back({"fixed_steps", ring, [](Parameters& p) { p.solver_method = kFixedRk4; }});
  const auto add_method = [&](const char* name, void (*choose)(Parameters&)) {
    runs.push_back({name, ring, choose});
    runs.back().steps = 100;
    runs.back().seen = "latched";
  };
  add_method("bdf", [](Parameters& p) { p.solver_method = kBdf; });
  add_method("rosenbrock", [](Parameters& p) { p.solver_method = kRosenbrock; });
  add_method("fixed_rosenbrock", [](Parameters& p) { p.solver_method = kFixedRosenbrock; });
  add_method("dae", [](Parameters& p) { p.model_level = kReference; });
  runs.push_back({"sloped_inputs", ring, [](Parameters& p) { p.contact_thrust = 50.0; }, push});
  runs.push_back({"massless_legs", ring, [](Parameters& p) { p.model_level = kMasslessLegs; }});
  runs.back().steps = 100;
  runs.back().seen = "latched";
  runs.push_back({"rigid", ring, [](Parameters& p) { p.model_level = kRigid; }, push});
  runs.push_back({"driven", driven_scene(), [](Parameters&) {}, drive});
  runs.push_back(
      {"announced", driven_scene(), [](Parameters& p) { p.coupling_mode = kParallel; }, drive});
  runs.push_back({"bristles_bdf", ring, [](Parameters& p) {
                    p.friction_model = 2;
                    p.solver_method = kBdf;
                  }});
  runs.back().steps = 12;  // with 600 bristles a Jacobian costs as much as a second of other runs
  runs.back().seen = "contact";
  runs.push_back({"announced_bdf", driven_scene(),
                  [](Parameters& p) {
                    p.coupling_mode = kParallel;
                    p.solver_method = kBdf;
                  },
                  drive});
  runs.push_back({"announced_dae", driven_scene(),
                  [](Parameters& p) {
                    p.coupling_mode = kParallel;
                    p.model_level = kReference;
                  },
                  drive});
  runs.back().steps = 15;
  runs.back().seen = "contact";
  runs.push_back({"absorber", share(minimal_scene())});
  runs.back().h = 0.05;
  runs.back().steps = 60;
  runs.back().seen = "released";
  runs.push_back({"other_coordinates", slider_crank_scene()});
  runs.back().seen = "coordinates";
  runs.push_back({"other_coordinates_bdf", slider_crank_scene(),
                  [](Parameters& p) { p.solver_method = kBdf; }});
  runs.back().seen = "coordinates";
  runs.push_back({"other_coordinates_rosenbrock", slider_crank_scene(),
                  [](Parameters& p) { p.solver_method = kRosenbrock; }});
  runs.back().seen = "coordinates";
  runs.push_back({"other_coordinates_dae", slider_crank_scene(),
                  [](Parameters& p) { p.model_level = kReference; }});
  runs.back().seen = "coordinates";
  return runs;
}

class SavedState : public ::testing::TestWithParam<Run> {
 protected:
  std::unique_ptr<DockingSim> make(bool started = true) const {
    auto sim =
        std::make_unique<DockingSim>(GetParam().scene, FmiKind::kCoSimulation, get_comparison());
    GetParam().choose(sim->parameters());
    if (started) sim->initialise(1e3, 0.0);
    return sim;
  }
  void step(DockingSim& sim, int i) const {
    const double h = GetParam().h;
    GetParam().before_step(sim, i);
    const Status status = sim.step(1e3 + i * h, h);
    ASSERT_TRUE(status.ok()) << sim.status_text();
  }
  /// Outputs after every step of the uninterrupted run.
  std::vector<std::vector<double>> reference() const {
    std::vector<std::vector<double>> all;
    const auto sim = make();
    for (int i = 0; i < GetParam().steps; ++i) {
      step(*sim, i);
      all.push_back(flatten(sim->outputs(), true));
    }
    SavedSim last;
    sim->save(last);
    if (GetParam().seen == std::string("latched")) {
      EXPECT_TRUE(sim->outputs().captured);
    }
    if (GetParam().seen == std::string("released")) {
      EXPECT_TRUE(last.snapshot.state.discrete.contacted);
      EXPECT_EQ(last.snapshot.state.memory.absorber, Acting::kNo);
    }
    if (GetParam().seen == std::string("contact")) {
      EXPECT_TRUE(last.snapshot.state.discrete.contacted);
    }
    if (GetParam().seen == std::string("coordinates")) {
      EXPECT_NE(last.snapshot.state.coordinates, nullptr);
    }
    return all;
  }
};

TEST_P(SavedState, rollback_of_every_step_gives_the_bits_of_the_uninterrupted_run) {
  const auto expected = reference();
  const auto sim = make();
  SavedSim saved;
  for (int i = 0; i < GetParam().steps; ++i) {
    sim->save(saved);
    // Something else first: another size, and reading out in between.
    sim->inputs().gravity.x() += 0.1;
    ASSERT_TRUE(sim->step(1e3 + i * GetParam().h, 0.7 * GetParam().h).ok());
    sim->outputs();
    sim->load(saved);
    step(*sim, i);
    ASSERT_TRUE(same_bits(flatten(sim->outputs(), true), expected[static_cast<size_t>(i)]))
        << "step " << i;
  }
}

TEST_P(SavedState, goes_on_in_another_simulation_and_from_bytes) {
  const auto expected = reference();
  auto sim = make();
  for (int i = 0; i < GetParam().steps; ++i) {
    if (i % 7 == 3) {
      SavedSim saved;
      sim->save(saved);
      sim = make(i % 2 == 0);  // started or not
      sim->parameters().vehicle[kChaser].mass *= 1.1;
      sim->load(i % 4 < 2 ? saved : through_bytes(saved));
      EXPECT_TRUE(sim->take_warnings().empty());
    }
    step(*sim, i);
    ASSERT_TRUE(same_bits(flatten(sim->outputs(), true), expected[static_cast<size_t>(i)]))
        << "step " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Runs, SavedState, ::testing::ValuesIn(make_runs()),
                         [](const auto& run) { return run.param.name; });

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(SavedStates, saving_and_restoring_again_allocate_nothing) {
  DockingSim sim(share(short_ring_scene()));
  sim.initialise(0.0, 0.0);
  for (int i = 0; i < 40; ++i) ASSERT_TRUE(sim.step(0.01 * i, 0.01).ok());
  SavedSim saved;
  sim.save(saved);
  const long allocated = count_allocations([&] {
    for (int i = 40; i < 60; ++i) {
      sim.save(saved);
      sim.load(saved);
      ASSERT_TRUE(sim.step(0.01 * i, 0.01).ok());
    }
  });
  EXPECT_EQ(allocated, 0);
}
#endif

TEST(SavedStates, before_the_start_hold_parameters_and_inputs) {
  const auto scene = share(short_ring_scene());
  DockingSim sim(scene), other(scene);
  sim.parameters().vehicle[kChaser].mass = 1234.0;
  sim.inputs().gravity.z() = -1.0;
  SavedSim saved;
  sim.save(saved);
  other.initialise(0.0, 0.0);
  other.load(saved);
  EXPECT_EQ(other.parameters().vehicle[kChaser].mass, 1234.0);
  EXPECT_EQ(other.inputs().gravity.z(), -1.0);
  other.initialise(0.0, 0.0);
  EXPECT_TRUE(other.step(0.0, 0.01).ok());
}

TEST(SavedStates, of_another_model_are_refused_and_nothing_changes) {
  const auto scene = share(short_ring_scene());
  DockingSim sim(scene), reference(scene), other(slider_crank_scene());
  for (DockingSim* each : {&sim, &reference, &other}) each->initialise(0.0, 0.0);
  SavedSim foreign;
  other.save(foreign);
  for (int i = 0; i < 30; ++i) {
    ASSERT_TRUE(reference.step(0.01 * i, 0.01).ok());
    EXPECT_THROW(sim.load(foreign), ModelError);
    SavedSim damaged;
    reference.save(damaged);
    damaged = through_bytes(damaged);
    damaged.snapshot.state.memory.lists.at(0).near.assign(1, 1 << 20);
    EXPECT_THROW(sim.load(damaged), ModelError);
    ASSERT_TRUE(sim.step(0.01 * i, 0.01).ok());
    ASSERT_TRUE(same_bits(flatten(sim.outputs()), flatten(reference.outputs()))) << "step " << i;
  }
}

TEST(SavedStates, cut_short_anywhere_are_refused) {
  DockingSim sim(share(short_ring_scene()));
  sim.initialise(0.0, 0.0);
  SavedSim saved;
  sim.save(saved);
  ByteWriter writer;
  transfer(writer, saved);
  const std::vector<char> bytes = writer.take();
  for (size_t size = 0; size < bytes.size(); size += 13) {
    ByteReader reader(bytes.data(), size);
    SavedSim copy;
    EXPECT_THROW(transfer(reader, copy), ModelError) << size << " of " << bytes.size();
  }
}

}  // namespace
}  // namespace dockloop
