// The Python module dockloop._core; its signatures are in scripts/dockloop/_core.pyi.
//
// Documents come as text, with the name of their file for messages; reports go back as JSON. What
// takes time runs without the lock of the interpreter, so threads of Python run dockings side by
// side.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <atomic>
#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "api/docking.hpp"
#include "api/placing.hpp"
#include "check/mechanism_check.hpp"
#include "docking/phases.hpp"
#include "docking/scene_mechanism.hpp"
#include "interface/model_description.hpp"
#include "interface/variables.hpp"
#include "sim/host_diagnosis.hpp"
#include "sim/solver_methods.hpp"

namespace nb = nanobind;
using namespace dockloop;
namespace {

std::atomic<std::thread::id> ending;  // the thread that ends the program, once it does

/// At the end of the program a thread that takes the interpreter waits for ever, as in Python 3.14.
/// Earlier versions end this thread instead, and C++ then ends the process by std::terminate.
void wait_if_ended() {
  const std::thread::id none, own = std::this_thread::get_id();
  for (std::thread::id end = ending; end != none && end != own; end = ending) {
    std::this_thread::sleep_for(std::chrono::hours(1));
  }
}

/// Lets other threads have the interpreter.
struct Released {
  ~Released() { wait_if_ended(); }
  nb::gil_scoped_release released;
};

/// Takes the interpreter.
struct Taken {
  struct Wait {
    Wait() { wait_if_ended(); }
  } wait;
  nb::gil_scoped_acquire taken;
};

using FreeThreads = nb::call_guard<Released>;

/// A step that the user stops ends with KeyboardInterrupt. @pre without the interpreter
template <class Body>
auto make_steps(Body&& body) {
  try {
    return body();
  } catch (const StepError&) {
    const Taken held;
    if (PyErr_Occurred()) throw nb::python_error();
    throw;
  }
}

/// A docking whose steps the user can stop. @pre without the interpreter
void make_docking(Docking* self, const std::string& document, const std::string& source,
                  bool place) {
  new (self) Docking(document, source, place);
  self->use_interruption([] {
    const Taken held;
    return PyErr_CheckSignals() != 0;
  });
}

/// The rows of the variable table, as the constructor of dockloop.native.variables.Variable takes
/// them.
nb::list list_variables(Docking& self) {
  const auto all = [&] {
    const Released free;
    return self.variables();
  }();
  nb::list rows;
  for (const VariableFacts& v : all) {
    nb::object start = nb::none();
    if (v.start) {
      start = v.type == name_of(Type::kReal)      ? nb::object(nb::float_(*v.start))
              : v.type == name_of(Type::kInteger) ? nb::object(nb::int_(static_cast<int>(*v.start)))
                                                  : nb::object(nb::bool_(*v.start != 0.0));
    }
    rows.append(nb::make_tuple(v.name, v.type, v.causality, v.variability, v.unit, start, v.min,
                               v.max, v.description));
  }
  return rows;
}

nb::dict start_state(const VehicleParameters& p) {
  const auto list = [](const auto& v) {
    return std::vector<double>(v.data(), v.data() + v.size());
  };
  nb::dict state;
  state["position"] = list(p.position);
  state["velocity"] = list(p.velocity);
  state["attitude"] = list(p.attitude);
  state["angular_velocity"] = list(p.angular_velocity);
  return state;
}

nb::dict place(const std::string& document, const std::string& source) {
  Placement placement;
  {
    const Released free;
    placement =
        place_vehicles(naming(source, [&] { return read_scene(document, source); }), source);
  }
  nb::dict result;
  result["chaser"] = start_state(placement.vehicle[kChaser]);
  result["target"] = start_state(placement.vehicle[kTarget]);
  result["time_of_contact"] = placement.time_of_contact;
  result["touches"] = placement.touches;
  return result;
}

std::string describe(const std::string& document, const std::string& source,
                     const std::string& date) {
  return naming(source, [&] {
    DockingSim sim(std::make_shared<const Scene>(read_scene(document, source)));
    return make_model_description(sim, date);
  });
}

/// Steps to all times; returns the values, shape (points, rows), and wall times [s].
nb::tuple record(Docking& self, std::vector<double> times, std::vector<int> rows,
                 double end_after_outcome, bool last_only, nb::object progress) {
  const size_t columns = rows.size();
  RecordOrder order{std::move(times), std::move(rows), end_after_outcome, last_only, {}};
  order.progress = [&](double part) {
    const Taken held;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (!progress.is_none()) progress(part);
  };
  auto* done = new Record;
  nb::capsule owner(done, [](void* p) noexcept { delete static_cast<Record*>(p); });
  {
    const Released free;
    *done = make_steps([&] { return self.record(order); });
  }
  const size_t points = columns > 0 ? done->values.size() / columns : 0;
  nb::ndarray<nb::numpy, double> values(done->values.data(), {points, columns}, owner);
  return nb::make_tuple(values, done->step_time, done->read_time);
}

/// The list of methods, as JSON.
std::string list_method_facts() {
  nlohmann::json list = nlohmann::json::array();
  for (const MethodFacts& m : list_methods()) {
    list.push_back({{"number", m.method},
                    {"name", m.name},
                    {"meaning", m.meaning},
                    {"for_comparison", m.carried != Carried::kAlways},
                    {"is_built", m.carried != Carried::kNoLonger},
                    {"fixed_step", m.fixed_step},
                    {"same_as", m.same_as}});
  }
  return list.dump();
}

/// The lists of choices by the variable that takes them, as JSON: [[number, name, meaning], ...].
std::string list_all_choices() {
  nlohmann::json all;
  const std::pair<const char*, const ChoiceList*> lists[] = {
      {"phase", &kPhases},
      {"outcome", &kOutcomes},
      {"command", &kCommands},
      {"capture.reason", &kCaptureReasons},
      {"latch.state", &kLatchReports},
      {"hard_dock.command", &kHardDockCommands},
      {"friction.model", &kFrictionModels},
      {"coupling.mode", &kCouplingModes},
      {"coupling.diagnosis", &kHostFaults},
      {"model.level", &kLevels},
      {"model.flight", &kFreeDriftModels},
      {"solver.method", &get_method_choices()},
      {"solver.dae_form", &kDaeForms}};
  for (const auto& [variable, list] : lists) {
    for (const Choice& c : *list) all[variable].push_back({c.number, c.name, c.meaning});
  }
  return all.dump();
}

/// Numbers of the outcomes with which a case can end.
std::vector<int> list_final_outcomes() {
  std::vector<int> numbers;
  for (const Choice& c : kOutcomes) {
    if (is_final(c.number)) numbers.push_back(c.number);
  }
  return numbers;
}

/// The loads between ring and target, as JSON: [[name, unit], ...].
std::string list_all_loads() {
  nlohmann::json all = nlohmann::json::array();
  for (const Load& load : list_loads()) all.push_back({load.name, load.quantity.unit});
  return all.dump();
}

std::string list_watched_limits() {
  nlohmann::json all = nlohmann::json::array();
  for (const WatchedLimit& limit : kLimits) {
    all.push_back({limit.name, limit.unit, limit.happened, limit.means});
  }
  return all.dump();
}

/// Is generated code of no use for the mechanism of a scene, because all its loops are legs?
bool has_only_legs(const std::string& document, const std::string& source) {
  return naming(source, [&] {
    const Mechanism mechanism = make_scene_mechanism(read_scene(document, source));
    const std::vector<LoopBlock>& blocks = mechanism.plan.blocks;
    return !blocks.empty() && blocks[0].is_leg;  // legs come last: all are legs
  });
}

}  // namespace

NB_MODULE(_core, m) {
  nb::module_::import_("atexit").attr("register")(nb::cpp_function([] {
    ending = std::this_thread::get_id();
    // Threads that wait for the interpreter already take it now, and wait for ever later.
    const nb::gil_scoped_release free;
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
  }));
  nb::set_leak_warnings(false);
  auto model_error = nb::exception<ModelError>(m, "ModelError");
  nb::exception<StepError>(m, "StepError");
  nb::register_exception_translator(
      [](const std::exception_ptr& p, void* type) {
        try {
          std::rethrow_exception(p);
        } catch (const UsageError& error) {
          PyErr_SetString(static_cast<PyObject*>(type), error.what());
        }
      },
      model_error.ptr());

  m.def("place", &place, nb::arg("document"), nb::arg("source"));
  m.def("describe", &describe, nb::arg("document"), nb::arg("source"), nb::arg("date"),
        FreeThreads());
  m.def("methods", &list_method_facts);
  m.def("choices", &list_all_choices);
  m.def("final_outcomes", &list_final_outcomes);
  m.def("loads", &list_all_loads);
  m.def("limits", &list_watched_limits);
  m.def("has_only_legs", &has_only_legs, nb::arg("document"), nb::arg("source"), FreeThreads());
  m.def(
      "check",
      [](const std::string& mechanism, const std::string& source) {
        return naming(source, [&] { return check_mechanism_file(mechanism, source); }).dump();
      },
      nb::arg("mechanism"), nb::arg("source"), FreeThreads());
  m.def(
      "expand",
      [](const std::string& mechanism, const std::string& source) {
        return naming(source, [&] { return expand_mechanism(mechanism, source); }).dump();
      },
      nb::arg("mechanism"), nb::arg("source"), FreeThreads());
  m.def(
      "evaluate",
      [](const std::string& mechanism, const std::string& source, const std::string& states,
         const std::string& states_source, bool newton) {
        return evaluate_states(mechanism, source, states, states_source, newton).dump();
      },
      nb::arg("mechanism"), nb::arg("source"), nb::arg("states"), nb::arg("states_source"),
      nb::arg("newton") = false, FreeThreads());

  nb::class_<Docking>(m, "Docking")
      .def("__init__", &make_docking, nb::arg("document"), nb::arg("source"),
           nb::arg("place") = false, FreeThreads())
      .def("variables", &list_variables)
      .def("find", &Docking::find, nb::arg("names"), FreeThreads())
      .def_prop_ro("touches", &Docking::touches)
      .def_prop_ro("time", &Docking::time, FreeThreads())
      .def("set",
           nb::overload_cast<const std::vector<int>&, const std::vector<double>&,
                             const std::string&>(&Docking::set),
           nb::arg("rows"), nb::arg("values"), nb::arg("caller") = "", FreeThreads())
      .def("get", nb::overload_cast<const std::vector<int>&>(&Docking::get), nb::arg("rows"),
           FreeThreads())
      .def("differentiable", &Docking::differentiable, FreeThreads())
      .def("derivatives", &Docking::derivatives, nb::arg("unknowns"), nb::arg("knowns"),
           FreeThreads())
      .def("start", &Docking::start, FreeThreads())
      .def("reset", &Docking::reset, FreeThreads())
      .def(
          "step", [](Docking& self, double h) { make_steps([&] { self.step(h); }); }, nb::arg("h"),
          FreeThreads())
      .def("record", &record, nb::arg("times"), nb::arg("rows"),
           nb::arg("end_after_outcome") = std::numeric_limits<double>::infinity(),
           nb::arg("last_only") = false, nb::arg("progress") = nb::none())
      .def("save",
           [](const Docking& self) {
             const auto bytes = [&] {
               const Released free;
               return self.save();
             }();
             return nb::bytes(bytes.data(), bytes.size());
           })
      .def(
          "restore",
          [](Docking& self, const nb::bytes& state) {
            const std::vector<char> bytes(state.c_str(), state.c_str() + state.size());
            const Released free;
            self.restore(bytes);
          },
          nb::arg("state"))
      .def("take_warnings", &Docking::take_warnings, FreeThreads())
      .def("take_notes", &Docking::take_notes, FreeThreads())
      .def("log_left_out", &Docking::log_left_out, FreeThreads());
}
