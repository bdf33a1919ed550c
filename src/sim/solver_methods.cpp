// Rows of the list of methods; see solver_methods.hpp.
#include "sim/solver_methods.hpp"

#include "docking/scene.hpp"

namespace dockloop {

namespace {

constexpr Carried kCore = Carried::kAlways, kCompare = Carried::kForComparison,
                  kReserved = Carried::kNoLonger;
constexpr bool kFixed = true, kMultistep = true;
constexpr std::array<MethodFacts, kMethodCount> kMethods = {{
    {kAuto, "auto",
     "12 where surfaces may touch and tolerances are loose or friction is steep, else 11 or 12, "
     "whichever makes longer steps",
     kCore},
    {kExplicit, "explicit", "adaptive one-step", kCore},
    {kImplicit, "implicit", "another name of 12 (rosenbrock)", kCore, !kFixed, !kMultistep,
     kRosenbrock},
    {kImex, "imex", "implicit for contact and latches only; no longer built: take 12 (rosenbrock)",
     kReserved},
    {kAdams, "adams", "multistep of order up to 12; no longer built: take 11 (stabilised)",
     kReserved},
    {kBdf, "bdf",
     "multistep for stiff models; restarts at every communication point and event: for long "
     "communication steps; with bristles as 11",
     kCore, !kFixed, kMultistep, 0, kStabilised},
    {kFixedRk4, "fixed_rk4", "equal steps of solver.step, bounded cost", kCore, kFixed},
    {kFixedImplicit, "fixed_implicit",
     "equal implicit steps; no longer built: take 13 (fixed_rosenbrock)", kReserved},
    {kDae, "dae",
     "all joint coordinates, loops held by multipliers: with model.level 4 only, where 1 is the "
     "same",
     kCompare},
    {kHighOrder, "high_order", "explicit, of order 8; no longer built: take 11 (stabilised)",
     kReserved},
    {kStabilised, "stabilised", "as 2; longer steps of order 4 where stability limits the steps",
     kCore},
    {kRosenbrock, "rosenbrock",
     "linearly implicit one-step, for loose tolerances and steep friction; with bristles as 11",
     kCore, !kFixed, !kMultistep, 0, kStabilised},
    {kFixedRosenbrock, "fixed_rosenbrock",
     "as 7 with the steps of 12, for stiff models; with bristles as 7", kCore, kFixed, !kMultistep,
     0, kFixedRk4},
}};

constexpr bool is_in_order() {
  for (int i = 0; i < kMethodCount; ++i) {
    if (kMethods[static_cast<size_t>(i)].method != i + 1) return false;
  }
  return true;
}
static_assert(is_in_order(), "the place of a row is its number");

}  // namespace

const std::array<MethodFacts, kMethodCount>& list_methods() { return kMethods; }

const MethodFacts* find_method(int number) {
  if (number < 1 || number > kMethodCount) return nullptr;
  return &kMethods[static_cast<size_t>(number - 1)];
}

const ChoiceList& get_method_choices() {
  static const ChoiceList kAll = [] {
    ChoiceList all;
    for (const MethodFacts& m : kMethods) all.push_back({m.method, m.name, m.meaning});
    return all;
  }();
  return kAll;
}

int find_used_method(int number) {
  const int other = find_method(number)->same_as;
  return other > 0 ? other : number;
}

const MethodFacts* find_method(int number, bool needs_other) {
  const MethodFacts* stated = find_method(number);
  return needs_other && stated->without_structure > 0 ? find_method(stated->without_structure)
                                                      : stated;
}

ChoiceList list_carried_methods(bool has_comparison) {
  ChoiceList carried;
  for (const MethodFacts& m : kMethods) {
    if (m.is_carried(has_comparison)) carried.push_back({m.method, m.name, m.meaning});
  }
  return carried;
}

std::string describe_missing_method(int number) {
  const MethodFacts& m = *find_method(number);
  const std::string name = std::string(" (") + m.name + "), a method for comparison";
  if (m.carried == Carried::kNoLonger) return name + ": " + m.meaning;
  return name + ", which this build does not carry: take " +
         list_names(list_carried_methods(false), true) +
         ", or compare methods with `dockloop trade`, which carries this one";
}

std::string describe_missing_reference_level() {
  const ChoiceList carried(kLevels.begin(), kLevels.end() - 1);
  return " (reference), a form for comparison, which this build does not carry: take " +
         list_names(carried, true) +
         ", or compare forms with `dockloop trade`, which carries all of them";
}

}  // namespace dockloop
