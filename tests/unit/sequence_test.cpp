// Sequences in the step path: changes of the step neither allocate nor block; a state saved between
// two events restores a run bit for bit, also after bytes; damaged states are refused.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "sim/docking_sim.hpp"
#include "sim/sim_state.hpp"
#include "unit/minimal_scene.hpp"
#include "unit/sim_test_support.hpp"
#include "unit/traps.hpp"

namespace dockloop {
namespace {

/// The shared scene with a drive on a slide of the chaser. The steps go back and forth: by a
/// located bound with a dwell, by the time, and by a command.
Scene make_sequence_scene() {
  nlohmann::json document = nlohmann::json::parse(minimal_scene_text());
  document["mechanism"].update(nlohmann::json::parse(R"({
    "bodies": [{"name": "block", "parent": "base", "mass": 40,
                "joint": {"type": "prismatic", "axis": [0, 1, 0]}}],
    "forces": [{"name": "drive", "along": [{"joint": "block"}], "laws": [
      {"type": "drive", "target": 0, "speed": 0.1, "acceleration": 1, "gain": 1e3, "limit": 50},
      {"type": "brake", "forward": 2}]}],
    "sequence": {"steps": [
      {"name": "out", "phase": 1, "do": [{"element": "drive", "run": {"target": 0.05}},
                                         {"element": "drive", "engagement": 0},
                                         {"element": "drive", "lock": "off"}],
       "next": [{"when": {"quantity": "element.drive.coordinate", "above": 0.03, "for": 0.05},
                 "go": "back"}, {"when": {"command": "abort"}, "go": "hold"}]},
      {"name": "back", "phase": 2, "do": [{"element": "drive", "run": {"target": 0}},
                                          {"thrust": "on"}, {"latches": "release"}],
       "next": [{"when": {"any": [{"quantity": "time", "above": 0.3},
                                  {"quantity": "gap", "below": -1}]}, "go": "hold"}]},
      {"name": "hold", "phase": 11, "do": [{"element": "drive", "run": "off"},
                                           {"element": "drive", "engagement": 1},
                                           {"element": "drive", "lock": "on"}],
       "timeout": 0.2, "on_timeout": {"go": "out"}}]}})"));
  return read_scene(document.dump(), "scene of the test");
}

struct Stepped {
  DockingSim sim{std::make_shared<const Scene>(make_sequence_scene())};
  double time = 0.0;
  Stepped() { sim.initialise(0.0, 0.0); }
  bool step(double h) {
    const bool ok = sim.step(time, h).ok();
    time += h;
    return ok;
  }
};

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST(Sequence, steps_and_commands_do_nothing_that_can_block) {
  Stepped run;
  SavedSim saved;
  run.sim.save(saved);
  bool ok = true;
  int changes = 0, last = 1;
  const Trapped trapped = trap([&] {
    for (int i = 0; i < 200; ++i) {
      run.sim.inputs().command = i % 50 == 20 ? kHold : i % 70 == 65 ? kAbort : kNoCommand;
      run.sim.save(saved);
      ok = ok && run.step(0.013);
      const int now = run.sim.outputs().sequence_step;
      changes += now != last ? 1 : 0;
      last = now;
    }
  });
  EXPECT_TRUE(ok);
  EXPECT_GT(changes, 5);
  EXPECT_EQ(run.sim.take_warnings().size(), 1u);  // a step of the sequence times out
  EXPECT_LE(trapped.allocations, 2);              // the text of this warning, and its place
  EXPECT_EQ(trapped.locks, 0);
  EXPECT_EQ(trapped.exceptions, 0);
  EXPECT_EQ(trapped.files, 0);
}
#endif

TEST(Sequence, saved_states_restore_a_run_bit_for_bit) {
  Stepped run;
  for (int i = 0; i < 40; ++i) {
    run.sim.inputs().command = i % 9 == 4 ? kHold : kNoCommand;
    ASSERT_TRUE(run.step(0.031));
    SavedSim saved;
    run.sim.save(saved);
    const double from = run.time;
    const SavedSim read = through_bytes(saved);
    for (int k = 0; k < 4; ++k) ASSERT_TRUE(run.step(0.047));
    const double there = run.sim.outputs().element_coordinate[0];
    const int step = run.sim.outputs().sequence_step;
    run.sim.load(read);
    run.time = from;
    for (int k = 0; k < 4; ++k) ASSERT_TRUE(run.step(0.047));
    EXPECT_EQ(run.sim.outputs().element_coordinate[0], there);
    EXPECT_EQ(run.sim.outputs().sequence_step, step);
    run.sim.load(saved);
    run.time = from;
  }
}

TEST(Sequence, a_saved_state_with_an_impossible_step_is_refused) {
  Stepped run;
  ASSERT_TRUE(run.step(0.1));
  SavedSim saved;
  run.sim.save(saved);
  saved.setup = std::make_shared<const dockloop::Setup>(*saved.setup);  // as from another process
  const auto refuses = [&](auto change) {
    SavedSim damaged = saved;
    change(damaged.snapshot.state.discrete);
    EXPECT_THROW(run.sim.load(damaged), ModelError);
  };
  refuses([](DiscreteState& d) { d.sequence.step = 3; });
  refuses([](DiscreteState& d) { d.sequence.command = 0; });
  refuses([](DiscreteState& d) { d.sequence.changes = 9; });
  refuses([](DiscreteState& d) { d.law.pop_back(); });
  EXPECT_NO_THROW(run.sim.load(saved));
}

}  // namespace
}  // namespace dockloop
