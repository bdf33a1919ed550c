// Checks and lists of numbers of force elements; see force_element.hpp.
#include "model/force_element.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>

#include "math/status.hpp"

namespace dockloop {
namespace {

std::string find_own_fault(const SpringLaw& law) {
  if (law.stages.empty()) return "lacks stages";
  const std::string corner = "corner is " + describe_number(law.corner) + "; it must be at most ";
  if (law.side == 0 && law.stages[0][0] != 0.0) {
    return "the first stage starts at " + describe_number(law.stages[0][0]) +
           "; with side 'both' it must start at 0";
  }
  for (size_t i = 1; i < law.stages.size(); ++i) {
    const double width = law.stages[i][0] - law.stages[i - 1][0];
    if (!(width > 0.0)) {
      return "stage " + std::to_string(i + 1) + " starts at " + describe_number(law.stages[i][0]) +
             "; it must start beyond stage " + std::to_string(i);
    }
    if (law.corner > 0.5 * width) {
      return corner + describe_number(0.5 * width) + ", half the width of stage " +
             std::to_string(i);
    }
  }
  if (law.preload == 0.0) return "";
  if (!(law.take_up > 0.0)) {
    return "preload is " + describe_number(law.preload) +
           " without take_up, which is a jump of the force; give take_up, for example 0.001";
  }
  if (law.corner > law.take_up) return corner + describe_number(law.take_up) + ", the take_up";
  if (law.stages.size() > 1 && !(law.take_up < law.stages[1][0] - law.stages[0][0])) {
    return "take_up is " + describe_number(law.take_up) +
           "; it must be less than the width of stage 1, " +
           describe_number(law.stages[1][0] - law.stages[0][0]);
  }
  return "";
}

std::string find_own_fault(const DamperLaw& law) {
  for (size_t i = 1; i < law.orifice.size(); ++i) {
    if (law.orifice[i][0] > law.orifice[i - 1][0]) continue;
    return "row " + std::to_string(i + 1) + " of orifice is at " +
           describe_number(law.orifice[i][0]) + "; the coordinates must increase";
  }
  return "";
}

std::string find_own_fault(const BrakeLaw& law) {
  constexpr double kLeastRatio = 0.1;
  const double larger = std::max(law.forward, law.back), less = std::min(law.forward, law.back);
  if (larger == 0.0 && law.load_share == 0.0) {
    return "needs a level above 0 (forward, back) or a load_share";
  }
  if (!law.has_bristle()) return "";
  if (less < kLeastRatio * larger) {
    return "has the levels " + describe_number(law.forward) + " and " + describe_number(law.back) +
           "; the smaller level of a bristle must be at least 0.1 of the larger one; use model 1 "
           "for a brake that acts one way";
  }
  if (larger == 0.0 && !(law.bristle_stiffness > 0.0 && law.floor > 0.0)) {
    return "has levels of 0; a bristle without levels needs bristle_stiffness and floor above 0, "
           "or use model 1";
  }
  return "";
}

std::string find_own_fault(const MotorLaw& law) {
  if (law.corner <= law.current_limit) return "";
  return "corner is " + describe_number(law.corner) + "; it must be at most current_limit, " +
         describe_number(law.current_limit);
}

std::string find_own_fault(const DriveLaw& law) {
  if (law.corner <= law.limit) return "";
  return "corner is " + describe_number(law.corner) + "; it must be at most limit, " +
         describe_number(law.limit);
}

std::string find_own_fault(const StopLaw& law) {
  if (law.lower < law.upper) return "";
  return "lower is " + describe_number(law.lower) + "; it must be less than upper, " +
         describe_number(law.upper);
}

std::string find_row_fault(const std::vector<double>& list, const char* name) {
  for (size_t i = 1; i < list.size(); ++i) {
    if (list[i] > list[i - 1]) continue;
    return std::string(name) + "[" + std::to_string(i + 1) + "] is " + describe_number(list[i]) +
           "; it must be above " + name + "[" + std::to_string(i) + "], " +
           describe_number(list[i - 1]);
  }
  return "";
}

std::string find_own_fault(const TableLaw& law) {
  const size_t rows = law.travel.size();
  if (rows < 2) return "travel has " + std::to_string(rows) + " rows; a table needs 2 or more";
  for (const std::string& fault :
       {find_row_fault(law.travel, "travel"), find_row_fault(law.rates, "rates")}) {
    if (!fault.empty()) return fault;
  }
  const auto zero = std::find(law.rates.begin(), law.rates.end(), 0.0);
  if (zero == law.rates.end()) {
    return "rates lack 0; the force at rest is the elastic one, from which the energy follows";
  }
  if (law.force.size() != law.rates.size()) {
    return "force has " + std::to_string(law.force.size()) + " lists; it must have " +
           std::to_string(law.rates.size()) + ", one per rate";
  }
  for (const std::vector<double>& list : law.force) {
    if (list.size() == rows) continue;
    return "force has " + std::to_string(list.size()) + " rows; travel has " + std::to_string(rows);
  }
  const std::vector<double>& elastic = law.force[static_cast<size_t>(zero - law.rates.begin())];
  for (size_t j = 0; j < law.rates.size(); ++j) {
    for (size_t i = 0; i < rows; ++i) {
      if (!(law.factor * (law.force[j][i] - elastic[i]) * law.rates[j] > 0.0)) continue;
      return "the force at the travel " + describe_number(law.travel[i]) + " is " +
             describe_number(law.force[j][i]) + " at the rate " + describe_number(law.rates[j]) +
             " and " + describe_number(elastic[i]) +
             " at rest; it must not drive the motion: check signs, or set factor to -1";
    }
  }
  return "";
}

template <class Law>
std::string find_own_fault(const Law&) {
  return "";
}

/// f(number) for all numbers of all laws.
template <class F>
void for_each_number(std::vector<ForceElement>& elements, F&& f) {
  for (ForceElement& element : elements) {
    for (ForceLaw& law : element.laws) {
      for_each_number(law,
                      [&](const std::string&, double& number, Rule, const char*) { f(number); });
    }
  }
}

}  // namespace

void TableLaw::interpolate() {
  const auto zero = std::find(rates.begin(), rates.end(), 0.0);
  const std::vector<double> at_rest = force[static_cast<size_t>(zero - rates.begin())];
  elastic = MonotoneCubic(travel, at_rest);
  for (std::vector<double> list : force) {
    for (size_t i = 0; i < list.size(); ++i) list[i] -= at_rest[i];
    viscous.push_back(MonotoneCubic(travel, list));
  }
}

std::string find_fault(const ForceLaw& law) {
  std::string fault;
  ForceLaw copy = law;  // the list of numbers is for laws that may change
  for_each_number(copy, [&](const std::string& name, double& number, Rule rule, const char*) {
    const std::string why = find_fault(number, rule);
    if (fault.empty() && !why.empty()) fault = name + " is " + describe_number(number) + "; " + why;
  });
  if (!fault.empty()) return fault;
  return std::visit([](const auto& each) { return find_own_fault(each); }, law);
}

double find_next_failure(const std::vector<LawFailure>& failures, const double* entered,
                         double now) {
  double next = std::numeric_limits<double>::infinity();
  for (const LawFailure& failure : failures) {
    if (!failure.active) continue;
    double time = find_time(failure.onset, entered);
    const bool delays = failure.kind == LawFailure::Kind::kDelayed;
    if (delays && time <= 0.0) time = failure.value;
    if (time > now) next = std::min(next, time);
  }
  return next;
}

std::vector<int> list_bristle_elements(const std::vector<ForceElement>& elements,
                                       const std::vector<LawFailure>& failures) {
  std::vector<int> list;
  for (size_t e = 0; e < elements.size(); ++e) {
    for (const ForceLaw& law : elements[e].laws) {
      if (has_bristle(law)) list.push_back(static_cast<int>(e));
    }
  }
  for (const LawFailure& failure : failures) {
    if (failure.kind == LawFailure::Kind::kJammed) list.push_back(failure.element);
  }
  return list;
}

int count_element_bristles(const std::vector<ForceElement>& elements,
                           const std::vector<LawFailure>& failures) {
  return static_cast<int>(list_bristle_elements(elements, failures).size());
}

int count_laws(const std::vector<ForceElement>& elements) {
  size_t count = 0;
  for (const ForceElement& element : elements) count += element.laws.size();
  return static_cast<int>(count);
}

std::vector<double> list_start_commands(const std::vector<ForceElement>& elements) {
  std::vector<double> commands;
  for (const ForceElement& element : elements) {
    double command = 0.0;
    for (const ForceLaw& law : element.laws) {
      if (!is_commanded(law)) continue;
      if (const MotorLaw* motor = std::get_if<MotorLaw>(&law)) {
        command = motor->by_current ? motor->current : motor->voltage;
      } else {
        command = std::get<DriveLaw>(law).target;
      }
    }
    commands.push_back(command);
  }
  return commands;
}

std::vector<double> get_element_numbers(const std::vector<ForceElement>& elements) {
  std::vector<double> numbers;
  std::vector<ForceElement> copy = elements;
  for_each_number(copy, [&](double& number) { numbers.push_back(number); });
  return numbers;
}

void put_element_numbers(const std::vector<double>& numbers, std::vector<ForceElement>& elements) {
  size_t next = 0;
  for_each_number(elements, [&](double& number) {
    if (next == numbers.size()) throw ModelError("numbers of force elements are missing");
    number = numbers[next++];
  });
  if (next != numbers.size()) throw ModelError("there are too many numbers of force elements");
}

void check_elements(const std::vector<ForceElement>& elements) {
  for (const ForceElement& element : elements) {
    for (size_t k = 0; k < element.laws.size(); ++k) {
      const std::string fault = find_fault(element.laws[k]);
      if (fault.empty()) continue;
      throw ModelError("element '" + element.name + "', law " + std::to_string(k + 1) + " (" +
                       describe_type(element.laws[k]) + "): " + fault);
    }
  }
}

}  // namespace dockloop
