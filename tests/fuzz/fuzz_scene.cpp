// Fuzz target: bytes -> JSON document -> scene or mechanism -> simulation -> start and two steps.
//
// A document that names the scene format is read as a scene, any other as a mechanism, which then
// hangs on a fixed base. Everything a user can write into such a file ends in one of two ways: a
// ModelError, or a simulation whose values are finite. Anything else (another exception, a crash, a
// hang, much memory, NaN, a refused step that leaves traces) aborts, and is a finding.
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "abort_with.hpp"
#include "interface/variables.hpp"
#include "sim/docking_sim.hpp"

namespace {

using namespace dockloop;

constexpr double kStep = 1e-5;            ///< [s] short: a stiff mechanism takes many inner steps
constexpr size_t kMaxSimulated = 60;      ///< bodies: more are read, but not simulated
constexpr const char* kSource = "input";  ///< what messages call the document

Scene read_document(const std::string& text) {
  if (text.find("dockloop-scene") != std::string::npos) return read_scene(text, kSource);
  Scene scene;
  scene.name = "mechanism";
  scene.has_target = false;
  scene.motion[kChaser] = Motion::kFixed;
  scene.vehicle[kChaser].inertia << 1, 1, 1, 0, 0, 0;
  scene.mechanism = read_mechanism(text, kSource);
  return scene;
}

/// Every Real output, which must be finite.
std::vector<double> read_outputs(DockingSim& sim, const std::vector<Variable>& variables,
                                 const char* when) {
  sim.outputs();
  std::vector<double> values;
  for (const Variable& v : variables) {
    if (v.type != Type::kReal || v.causality != Causality::kOutput) continue;
    values.push_back(*static_cast<const double*>(v.value));
    if (!std::isfinite(values.back())) abort_with(when, "'" + v.name + "' is not finite");
  }
  return values;
}

void simulate(Scene scene) {
  scene.groups = {"relative", "capture", "contact", "phase",  "ring",
                  "legs",     "states",  "loops",   "energy", "solver"};
  DockingSim sim(std::make_shared<const Scene>(std::move(scene)));
  const std::vector<Variable> variables = make_variables(sim);
  sim.initialise(0.0, 0.0);
  std::vector<double> before = read_outputs(sim, variables, "start");
  for (int i = 0; i < 2; ++i) {
    const bool made = sim.step(i * kStep, kStep).ok();
    if (!made && sim.status_text().empty()) abort_with("step", "refused without a reason");
    std::vector<double> after = read_outputs(sim, variables, "step");
    if (!made) {
      if (after != before) abort_with("step", "a refused step has changed the outputs");
      return;
    }
    before.swap(after);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, size_t size) {
  try {
    Scene scene = read_document({reinterpret_cast<const char*>(data), size});
    if (scene.mechanism.bodies.size() <= kMaxSimulated) simulate(std::move(scene));
  } catch (const ModelError& error) {
    if (std::string(error.what()).empty()) abort_with("refusal", "without a reason");
  }
  return 0;
}
