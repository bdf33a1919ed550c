// The life of one docking; see docking.hpp.
#include "python/docking.hpp"

#include <algorithm>
#include <chrono>
#include <climits>
#include <cmath>
#include <utility>

#include "docking/phases.hpp"
#include "interface/log_categories.hpp"

namespace dockloop {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

std::shared_ptr<const Scene> make_scene(const std::string& document, const std::string& source,
                                        bool place, bool& touches) {
  auto scene =
      std::make_shared<Scene>(naming(source, [&] { return read_scene(document, source); }));
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

Docking::Docking(const std::string& document, const std::string& source, bool place)
    : callbacks_{log, nullptr, nullptr, nullptr, this},
      instance_(make_scene(document, source, place, touches_), FmiKind::kCoSimulation,
                Logger(callbacks_, "docking", false)) {
  instance_.state = kInitializationMode;
  instance_.sim.use_interruption([this, asked = Clock::now()]() mutable {
    constexpr double kBetween = 0.1;  // s
    if (!interruption || seconds_since(asked) < kBetween) return false;
    asked = Clock::now();
    return interruption();
  });
}

void Docking::reset() {
  instance_.reset();
  instance_.state = kInitializationMode;
  log_.clear();
  notes_.clear();
}

void Docking::log(fmi2ComponentEnvironment environment, fmi2String, fmi2Status status,
                  fmi2String category, fmi2String message, ...) {
  const bool is_choice = category == std::string(kLogCategories[kLogChoices].name);
  if (status != fmi2Warning && !is_choice) return;  // errors are exceptions here
  std::string text;
  for (const char* c = message; *c; ++c) {
    text += *c;
    if (c[0] == '%' && c[1] == '%') ++c;  // a logger is printf-like
  }
  Docking& self = *static_cast<Docking*>(environment);
  (is_choice ? self.notes_ : self.log_).push_back(std::move(text));
}

std::vector<int> Docking::find(const std::vector<std::string>& names) const {
  std::vector<int> rows;
  for (const std::string& name : names) {
    const auto found = std::find_if(variables().begin(), variables().end(),
                                    [&](const Variable& v) { return v.name == name; });
    if (found == variables().end()) throw ModelError("there is no variable '" + name + "'");
    rows.push_back(static_cast<int>(found - variables().begin()));
  }
  return rows;
}

void Docking::set(const std::vector<int>& rows, const std::vector<double>& values,
                  const std::string& caller) {
  bool tunables = false;
  for (size_t i = 0; i < rows.size(); ++i) {
    const Variable& v = row(rows[i]);
    const std::string function = caller.empty() ? std::string("fmi2Set") + name_of(v.type) : caller;
    const auto refuse = [&](const char* why) {
      throw ModelError(function + ": '" + v.name + "' " + why);
    };
    instance_.check_settable(v, function.c_str());
    check_value(v, values.at(i), function.c_str());
    if (v.type == Type::kInteger &&
        (values[i] != std::floor(values[i]) || std::abs(values[i]) > INT_MAX)) {
      refuse("must be a whole number");
    }
    if (v.type == Type::kBoolean && values[i] != 0.0 && values[i] != 1.0) {
      refuse("must be true or false");
    }
    tunables = tunables || v.variability == Variability::kTunable;
  }
  const Parameters parameters = instance_.sim.parameters();
  const Inputs inputs = instance_.sim.inputs();
  for (size_t i = 0; i < rows.size(); ++i) {
    const Variable& v = row(rows[i]);
    if (v.type == Type::kReal) *static_cast<double*>(v.start) = values[i];
    if (v.type == Type::kInteger) *static_cast<int*>(v.start) = static_cast<int>(values[i]);
    if (v.type == Type::kBoolean) *static_cast<char*>(v.start) = values[i] != 0.0;
  }
  try {
    instance_.note_change(tunables);
  } catch (...) {
    instance_.sim.parameters() = parameters;
    instance_.sim.inputs() = inputs;
    throw;
  }
}

double Docking::read(const Variable& v) {
  const void* value = instance_.current(v);
  if (v.type == Type::kReal) return *static_cast<const double*>(value);
  if (v.type == Type::kInteger) return *static_cast<const int*>(value);
  return *static_cast<const char*>(value);
}

std::vector<double> Docking::get(const std::vector<int>& rows) {
  std::vector<double> values;
  for (const int place : rows) values.push_back(read(row(place)));
  return values;
}

std::vector<int> Docking::list_differentiable() const {
  std::vector<int> rows;
  for (size_t i = 0; i < variables().size(); ++i) {
    if (variables()[i].output >= 0) rows.push_back(static_cast<int>(i));
  }
  return rows;
}

std::vector<double> Docking::find_derivatives(const std::vector<int>& unknowns,
                                              const std::vector<int>& knowns) {
  start();
  std::vector<double> values;
  for (const int place : knowns) {
    const Variable& known = row(place);
    if (known.input < 0 && known.state < 0) {
      throw ModelError("'" + known.name + "' is neither an input nor a continuous state");
    }
    const Seed seed = known.input >= 0 ? Seed{Seed::Of::kInput, known.input, 1.0}
                                       : Seed{Seed::Of::kState, known.state, 1.0};
    const Status status = instance_.sim.calc_directional_derivative({seed});
    if (!status.ok()) throw StepError(instance_.sim.describe(status));
    for (const int other : unknowns) {
      const Variable& v = row(other);
      if (v.rate < 0 && v.output < 0) {
        throw ModelError("'" + v.name + "' is neither a continuous output nor the rate of a state");
      }
      values.push_back(v.rate >= 0 ? instance_.sim.rate_derivative(v.rate)
                                   : instance_.sim.output_derivative(v.output));
    }
  }
  return values;
}

void Docking::start() {
  if (!instance_.before_start()) return;
  instance_.initialise();
  instance_.state = kStepComplete;
}

void Docking::step_to(double t) {
  if (instance_.step(instance_.time, t - instance_.time) != fmi2OK) {
    throw StepError(instance_.sim.status_text());
  }
  instance_.time = t;
}

void Docking::step(double h) {
  start();
  if (instance_.step(instance_.time, h) != fmi2OK) throw StepError(instance_.sim.status_text());
}

Record Docking::record(const RecordOrder& order) {
  constexpr double kBetweenReports = 0.1;  // s
  Record result;
  const size_t last = order.times.size() - 1;
  if (!order.last_only) result.values.reserve(order.times.size() * order.rows.size());
  const auto keep = [&] {
    const Clock::time_point begin = Clock::now();
    for (const int place : order.rows) result.values.push_back(read(row(place)));
    result.read_time += seconds_since(begin);
  };
  start();
  Clock::time_point reported = Clock::now();
  int decision = kUndecided;
  double since = order.times[0];
  if (!order.last_only) keep();
  for (size_t k = 1; k <= last; ++k) {
    const Clock::time_point begin = Clock::now();
    step_to(order.times[k]);
    result.step_time += seconds_since(begin);
    if (!order.last_only) keep();
    if (order.progress && (seconds_since(reported) > kBetweenReports || k == last)) {
      order.progress(static_cast<double>(k) / static_cast<double>(last));
      reported = Clock::now();
    }
    if (std::isinf(order.end_after_outcome)) continue;
    if (!instance_.sim.update(OutputGroup::kMain).ok()) continue;
    const int outcome = instance_.sim.output_storage().outcome;
    if (outcome != decision) {
      decision = outcome;
      since = order.times[k];
    }
    if (is_final(decision) && order.times[k] - since >= order.end_after_outcome) break;
  }
  if (order.last_only) keep();
  return result;
}

std::vector<char> Docking::save() const {
  SavedInstance saved;
  instance_.save(saved);
  return serialise(saved);
}

void Docking::restore(const char* bytes, size_t size) {
  SavedInstance saved;
  deserialise(bytes, size, instance_.guid, saved);
  instance_.load(saved);
}

std::vector<std::string> Docking::take_warnings() { return std::exchange(log_, {}); }
std::vector<std::string> Docking::take_notes() { return std::exchange(notes_, {}); }

}  // namespace dockloop
