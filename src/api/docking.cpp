// The life of one docking: an instance of the FMU without FMI; see docking.hpp.
#include "api/docking.hpp"

#include <algorithm>
#include <chrono>
#include <climits>
#include <cmath>
#include <fstream>
#include <iterator>
#include <mutex>
#include <utility>

#include "api/placing.hpp"
#include "docking/phases.hpp"
#include "instance.hpp"
#include "interface/log_categories.hpp"

namespace dockloop {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// Call `body`; what it refuses becomes a UsageError, without the FMI function that it begins with.
template <class Body>
auto translated(Body&& body) {
  const auto make = [](const std::exception& error) {
    const std::string text = error.what();
    const size_t colon = text.rfind("fmi2", 0) == 0 ? text.find(": ") : text.npos;
    return UsageError(colon == text.npos ? text : text.substr(colon + 2));
  };
  try {
    return body();
  } catch (const ModelError& error) {
    throw make(error);
  } catch (const Refusal& error) {
    throw make(error);
  } catch (const Discard& error) {
    throw make(error);
  }
}

std::string read_document(const std::filesystem::path& file) {
  constexpr const char* kRemedy =
      "'dockloop build SCENE -o FILE.json' writes the document of a scene";
  const auto refuse = [&](const char* why) {
    throw UsageError(file.string() + ": " + why + ": " + kRemedy);
  };
  std::error_code none;
  if (!std::filesystem::is_regular_file(file, none)) refuse("no such file");
  std::ifstream stream(file, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (!stream.is_open() || stream.bad()) refuse("cannot be read");
  if (text.rfind("PK", 0) == 0) refuse("is an FMU or another zip file");
  return text;
}

std::shared_ptr<const Scene> make_scene(const std::string& document, const std::string& source,
                                        bool place, bool& touches) {
  auto scene = std::make_shared<Scene>(read_scene(document, source));
  if (place && scene->conditions.given) {
    Placement placement = place_vehicles(*scene, source);
    scene->vehicle = std::move(placement.vehicle);
    touches = placement.touches;
  }
  return scene;
}

}  // namespace

Placement place_vehicles(const Scene& scene, const std::string& source) {
  return naming(source, [&] {
    Placement placement = find_placement(scene);
    for (const VehicleParameters& p : placement.vehicle) {
      if (!(p.position.allFinite() && p.velocity.allFinite() && p.attitude.allFinite() &&
            p.angular_velocity.allFinite())) {
        throw ModelError(
            "the start that leads to first contact is too far away to be computed: check "
            "initial.approach_time, the speeds of [initial] and the interface_position of both "
            "vehicles");
      }
    }
    return placement;
  });
}

struct Docking::Impl {
  Impl(const std::string& text, const std::string& source, bool place)
      : callbacks{log, nullptr, nullptr, nullptr, this},
        instance(make_scene(text, source, place, touches), FmiKind::kCoSimulation,
                 Logger(callbacks, "docking", false)) {
    instance.state = kInitializationMode;
    instance.use_interruption([this, asked = Clock::now()]() mutable {
      constexpr double kBetween = 0.1;  // s
      if (!interruption || seconds_since(asked) < kBetween) return false;
      asked = Clock::now();
      return interruption();
    });
  }
  static void log(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                  fmi2String category, fmi2String message, ...);

  int find(const std::string& name) const {
    const auto found = std::find_if(instance.variables.begin(), instance.variables.end(),
                                    [&](const Variable& v) { return v.name == name; });
    if (found == instance.variables.end()) {
      throw UsageError("there is no variable '" + name +
                       "': 'dockloop variables SCENE' lists them");
    }
    return static_cast<int>(found - instance.variables.begin());
  }
  const Variable& row(int place) const {
    const size_t rows = instance.variables.size();
    if (place < 0 || static_cast<size_t>(place) >= rows) {
      throw UsageError("there is no row " + std::to_string(place) +
                       ": variables have the rows 0 to " + std::to_string(rows - 1));
    }
    return instance.variables[static_cast<size_t>(place)];
  }
  double read(const Variable& v) { return number(v, instance.current(v)); }
  /// A stored value of a row.
  static double number(const Variable& v, const void* value) {
    if (v.type == Type::kReal) return *static_cast<const double*>(value);
    if (v.type == Type::kInteger) return *static_cast<const int*>(value);
    return *static_cast<const char*>(value);
  }
  void check(const Variable& v, double value, const std::string& function) const;
  void start() {
    if (!instance.before_start()) return;
    instance.initialise();
    instance.state = kStepComplete;
  }
  /// After a failure all is as before, the states of FMI included.
  void step(double h) {
    const State state = instance.state;
    const fmi2Status status = instance.step_status;
    try {
      if (instance.step(instance.time, h) != fmi2OK) throw StepError(instance.sim.status_text());
    } catch (...) {
      instance.state = state;
      instance.step_status = status;
      throw;
    }
  }

  std::recursive_mutex mutex;  ///< held during a call; `order.progress` may call, too
  std::function<bool()> interruption;
  std::vector<std::string> warnings, notes;
  bool touches = true;
  fmi2CallbackFunctions callbacks;
  Instance instance;
};

namespace {

/// Call `body` with the inside of a docking, when no other call runs.
template <class Inside, class Body>
auto alone(const std::unique_ptr<Inside>& inside, Body&& body) {
  const std::lock_guard lock(inside->mutex);
  return translated([&] { return body(*inside); });
}

}  // namespace

Docking::Docking(const std::filesystem::path& document)
    : Docking(read_document(document), document.string()) {}
Docking::Docking(const std::string& text, const std::string& source, bool place)
    : impl_(translated([&] { return std::make_unique<Impl>(text, source, place); })) {}
Docking::Docking(Docking&&) noexcept = default;
Docking& Docking::operator=(Docking&&) noexcept = default;
Docking::~Docking() = default;

double Docking::time() const {
  return alone(impl_, [](Impl& self) { return self.instance.time; });
}

std::vector<VariableFacts> Docking::variables() const {
  return alone(impl_, [](Impl& self) {
    std::vector<VariableFacts> all;
    for (const Variable& v : self.instance.variables) {
      all.push_back({v.name, name_of(v.type), name_of(v.causality), name_of(v.variability), v.unit,
                     std::nullopt, v.min, v.max, v.description});
      if (v.has_start()) all.back().start = Impl::number(v, v.start);
    }
    return all;
  });
}

std::vector<int> Docking::find(const std::vector<std::string>& names) const {
  return alone(impl_, [&](Impl& self) {
    std::vector<int> rows;
    for (const std::string& name : names) rows.push_back(self.find(name));
    return rows;
  });
}

void Docking::Impl::check(const Variable& v, double value, const std::string& function) const {
  const auto refuse = [&](const char* why) {
    throw UsageError(function + ": '" + v.name + "' " + why);
  };
  instance.check_settable(v, function.c_str());
  check_value(v, value, function.c_str());
  if (v.type == Type::kInteger && (value != std::floor(value) || std::abs(value) > INT_MAX)) {
    refuse("must be a whole number");
  }
}

void Docking::set(const std::vector<int>& rows, const std::vector<double>& values,
                  const std::string& caller) {
  alone(impl_, [&](Impl& self) {
    if (rows.size() != values.size()) {
      throw UsageError("Docking.set: there are " + std::to_string(values.size()) + " values for " +
                       std::to_string(rows.size()) + " rows: must be one for each");
    }
    bool tunables = false;
    for (size_t i = 0; i < rows.size(); ++i) {
      const Variable& v = self.row(rows[i]);
      self.check(v, values[i], caller.empty() ? std::string("fmi2Set") + name_of(v.type) : caller);
      tunables = tunables || v.variability == Variability::kTunable;
    }
    const Parameters parameters = self.instance.sim.parameters();
    const Inputs inputs = self.instance.sim.inputs();
    for (size_t i = 0; i < rows.size(); ++i) {
      const Variable& v = self.row(rows[i]);
      if (v.type == Type::kReal) *static_cast<double*>(v.start) = values[i];
      if (v.type == Type::kInteger) *static_cast<int*>(v.start) = static_cast<int>(values[i]);
      if (v.type == Type::kBoolean) *static_cast<char*>(v.start) = values[i] != 0.0;
    }
    try {
      self.instance.note_change(tunables);
    } catch (...) {
      self.instance.sim.parameters() = parameters;
      self.instance.sim.inputs() = inputs;
      throw;
    }
  });
}

void Docking::set(const std::string& name, double value) { set(find({name}), {value}); }

std::vector<double> Docking::get(const std::vector<int>& rows) {
  return alone(impl_, [&](Impl& self) {
    std::vector<double> values;
    for (const int place : rows) values.push_back(self.read(self.row(place)));
    return values;
  });
}

double Docking::get(const std::string& name) { return get(find({name}))[0]; }

void Docking::start() {
  alone(impl_, [](Impl& self) { self.start(); });
}

void Docking::step(double h) {
  alone(impl_, [&](Impl& self) {
    if (!(std::isfinite(h) && h > 0.0)) {
      throw UsageError("Docking.step: h is " + describe_number(h) +
                       " s: must be a positive, finite number");
    }
    self.start();
    self.step(h);
  });
}

Record Docking::record(const RecordOrder& order) {
  return alone(impl_, [&](Impl& self) {
    if (order.times.empty()) throw UsageError("there are no times to step to");
    constexpr double kBetweenReports = 0.1;  // s
    Record result;
    const size_t last = order.times.size() - 1;
    if (!order.last_only) result.values.reserve(order.times.size() * order.rows.size());
    const auto keep = [&] {
      const Clock::time_point begin = Clock::now();
      for (const int place : order.rows) result.values.push_back(self.read(self.row(place)));
      result.read_time += seconds_since(begin);
    };
    self.start();
    Clock::time_point reported = Clock::now();
    int decision = kUndecided;
    double since = order.times[0];
    if (!order.last_only) keep();
    for (size_t k = 1; k <= last; ++k) {
      const Clock::time_point begin = Clock::now();
      self.step(order.times[k] - self.instance.time);
      self.instance.time = order.times[k];
      result.step_time += seconds_since(begin);
      if (!order.last_only) keep();
      if (order.progress && (seconds_since(reported) > kBetweenReports || k == last)) {
        order.progress(static_cast<double>(k) / static_cast<double>(last));
        reported = Clock::now();
      }
      if (std::isinf(order.end_after_outcome)) continue;
      if (!self.instance.sim.update(OutputGroup::kMain).ok()) continue;
      const int outcome = self.instance.sim.output_storage().outcome;
      if (outcome != decision) {
        decision = outcome;
        since = order.times[k];
      }
      if (is_final(decision) && order.times[k] - since >= order.end_after_outcome) break;
    }
    if (order.last_only) keep();
    return result;
  });
}

void Docking::reset() {
  alone(impl_, [](Impl& self) {
    self.instance.reset();
    self.instance.state = kInitializationMode;
    self.warnings.clear();
    self.notes.clear();
  });
}

std::vector<char> Docking::save() const {
  return alone(impl_, [](Impl& self) {
    SavedInstance saved;
    self.instance.save(saved);
    return serialise(saved);
  });
}

void Docking::restore(const std::vector<char>& state) {
  alone(impl_, [&](Impl& self) {
    SavedInstance saved;
    deserialise(state.data(), state.size(), self.instance.guid, saved);
    self.instance.load(saved);
  });
}

std::vector<int> Docking::differentiable() const {
  return alone(impl_, [](Impl& self) {
    std::vector<int> rows;
    for (size_t i = 0; i < self.instance.variables.size(); ++i) {
      if (self.instance.variables[i].output >= 0) rows.push_back(static_cast<int>(i));
    }
    return rows;
  });
}

std::vector<double> Docking::derivatives(const std::vector<int>& unknowns,
                                         const std::vector<int>& knowns) {
  return alone(impl_, [&](Impl& self) {
    self.start();
    DockingSim& sim = self.instance.sim;
    std::vector<double> values;
    for (const int place : knowns) {
      const Variable& known = self.row(place);
      if (known.input < 0 && known.state < 0) {
        throw UsageError("'" + known.name + "' is neither an input nor a continuous state");
      }
      const Seed seed = known.input >= 0 ? Seed{Seed::Of::kInput, known.input, 1.0}
                                         : Seed{Seed::Of::kState, known.state, 1.0};
      const Status status = sim.calc_directional_derivative({seed});
      if (!status.ok()) throw StepError(sim.describe(status));
      for (const int other : unknowns) {
        const Variable& v = self.row(other);
        if (v.rate < 0 && v.output < 0) {
          throw UsageError("'" + v.name +
                           "' is neither a continuous output nor the rate of a state");
        }
        values.push_back(v.rate >= 0 ? sim.rate_derivative(v.rate)
                                     : sim.output_derivative(v.output));
      }
    }
    return values;
  });
}

void Docking::Impl::log(fmi2ComponentEnvironment environment, fmi2String, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
  const bool is_choice = category == std::string(kLogCategories[kLogChoices].name);
  if (status != fmi2Warning && !is_choice) return;  // errors are exceptions here
  std::string text;
  for (const char* c = message; *c; ++c) {
    text += *c;
    if (c[0] == '%' && c[1] == '%') ++c;  // a logger is printf-like
  }
  Impl& self = *static_cast<Impl*>(environment);
  (is_choice ? self.notes : self.warnings).push_back(std::move(text));
}

std::vector<std::string> Docking::take_warnings() {
  return alone(impl_, [](Impl& self) { return std::exchange(self.warnings, {}); });
}

std::vector<std::string> Docking::take_notes() {
  return alone(impl_, [](Impl& self) { return std::exchange(self.notes, {}); });
}

void Docking::log_left_out() {
  alone(impl_, [](Impl& self) { self.instance.log_left_out(); });
}

bool Docking::touches() const { return impl_->touches; }

void Docking::use_interruption(std::function<bool()> asks) {
  alone(impl_, [&](Impl& self) { self.interruption = std::move(asks); });
}

}  // namespace dockloop
