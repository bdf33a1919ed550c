// Scenes for tests of DockingSim, and all its outputs as numbers to compare.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <memory>
#include <vector>

#include "compare/comparison.hpp"
#include "docking/placement.hpp"
#include "sim/docking_sim.hpp"
#include "sim/sim_state.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {

/// idss_25t_350t as `dockloop build` resolves it: contact after 2 s.
inline Scene ring_scene() {
  return read_scene(read_test_file("scene_ring.json"), "scene_ring.json");
}

/// The same just before contact (approach 0.1 s), so that runs need not be long.
inline Scene short_ring_scene() {
  Scene scene = ring_scene();
  scene.conditions.approach_time = 0.1;
  scene.vehicle = find_placement(scene).vehicle;
  return scene;
}

/// A simulation that has the methods for comparison too.
struct ComparingSim : DockingSim {
  explicit ComparingSim(std::shared_ptr<const Scene> scene)
      : DockingSim(std::move(scene), FmiKind::kCoSimulation, get_comparison()) {}
};

inline std::shared_ptr<const Scene> share(Scene scene) {
  return std::make_shared<const Scene>(std::move(scene));
}

/// A saved state as another process receives it.
inline SavedSim through_bytes(const SavedSim& saved) {
  ByteWriter writer;
  transfer(writer, const_cast<SavedSim&>(saved));
  const std::vector<char> bytes = writer.take();
  ByteReader reader(bytes.data(), bytes.size());
  SavedSim copy;
  transfer(reader, copy);
  EXPECT_EQ(reader.left(), 0u);
  return copy;
}

/// Every number of the outputs, in a fixed order. @param with_solver also step counters
inline std::vector<double> flatten(const Outputs& outputs, bool with_solver = false) {
  Outputs o = outputs;
  std::vector<double> all;
  for_each_value(static_cast<OutputValues<double>&>(o), [&](double& x) { all.push_back(x); });
  const auto put = [&](const auto& list) {
    for (const auto& value : list) all.push_back(static_cast<double>(value));
  };
  for (const Peak& peak : o.capture_peak) put(std::array{peak.value, peak.time, double(peak.step)});
  put(o.latched);
  put(o.latch_state);
  put(std::array<double, 12>{
      o.time, o.capture_peak_load_ratio.value, double(o.phase), double(o.outcome),
      double(o.captured), o.time_to_contact, o.time_of_contact, o.time_of_capture,
      o.momentum_residual, o.solver_closure_residual, o.solver_singularity_margin, o.seated_time});
  put(std::array<double, 3>{double(o.capture_reason), double(o.hooks_closed),
                            double(o.joint_rigid)});
  if (with_solver) {
    put(std::array<double, 3>{o.solver_steps, o.solver_rhs_evaluations, o.solver_rejected_steps});
  }
  return all;
}

inline bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

}  // namespace dockloop
