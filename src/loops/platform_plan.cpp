// Legs and gears of platforms; see platform_plan.hpp and LEGS.md.
#include "loops/platform_plan.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace dockloop {
namespace {

constexpr double kRounding = 1e-12;  // of axes and of inertias, relative

/// The other joints of the coupling of a gear and how much of each its coordinate has.
std::vector<CouplingTerm> list_terms(const Loop& loop, const LoopPaths& paths) {
  const int own = loop.dependent[0];
  std::vector<CouplingTerm> terms;
  for (int body : paths.tied) {
    if (body == own) continue;
    terms.push_back({body, -find_coupling_factor(loop, body) / find_coupling_factor(loop, own)});
  }
  return terms;
}

/// Does a body that turns about this axis through its origin look the same at every angle?
bool is_round(const Body& body) {
  const Vec3<double>& e = body.axis;
  const Mat3<double>& I = body.inertia;
  const double axial = e.dot(I * e), across = (I.trace() - axial) / 2.0;
  const Mat3<double> along = e * e.transpose();
  const Mat3<double> round = axial * along + across * (Mat3<double>::Identity() - along);
  return body.com.cross(e).norm() <= kRounding * body.com.norm() &&
         (I - round).norm() <= kRounding * I.norm();
}

/// Searches for the legs and gears of a plan: starts with all that could be one, and drops those
/// that something else uses until nothing changes.
class PlatformSearch {
 public:
  PlatformSearch(const MechanismModel& model, const std::vector<Pose<double>>& home, LoopPlan& plan)
      : model_(model), home_(home), plan_(plan), gear_(model.bodies.size(), -1) {
    std::vector<char> has_children(model.bodies.size(), 0);
    for (const Body& body : model.bodies) {
      if (body.parent != kBase) has_children[body.parent] = 1;
    }
    for (size_t b = 0; b < plan.blocks.size(); ++b) {
      const LoopBlock& block = plan.blocks[b];
      if (!block.is_coupling || block.is_driven) continue;
      const int body = block.dep_bodies[0];
      const bool turns = model.bodies[body].joint == JointType::kRevolute;
      if (!turns || has_children[body] || model.is_contact_body(body)) continue;
      if (is_round(model.bodies[body])) gear_[body] = static_cast<int>(b);
    }
  }

  void run() {
    do {
      count_users();
      find_legs();
    } while (drop_gears());
    for (const int b : gear_) {
      if (b >= 0) plan_.blocks[b].is_gear = true;
    }
  }

 private:
  bool is_gear_loop(int k) const {
    const Loop& loop = model_.loops[k];
    return loop.cut == CutType::kCoupling && gear_[loop.dependent[0]] == plan_.block_of_loop[k] &&
           plan_.block_of_loop[k] >= 0;
  }

  /// Per body: joints below it, and loops that pass it or end on it; but those of gears.
  void count_users() {
    users_.assign(model_.bodies.size(), 0);
    for (size_t i = 0; i < model_.bodies.size(); ++i) {
      const int parent = model_.bodies[i].parent;
      if (parent != kBase && gear_[i] < 0) ++users_[parent];
    }
    for (size_t k = 0; k < plan_.paths.size(); ++k) {
      if (is_gear_loop(static_cast<int>(k))) continue;
      const LoopPaths& paths = plan_.paths[k];
      for (const auto* path : {&paths.terminal, &paths.closing, &paths.tied}) {
        for (int body : *path) ++users_[body];
      }
    }
  }

  /// Is a block a leg with an inverse whose bodies serve nothing else?
  bool is_leg(const LoopBlock& block) const {
    const ClosedForm* form = block.form();
    if (!form || !form->has_inverse() || block.size() != 3) return false;
    const Loop& loop = model_.loops[block.loops[0]];
    const LoopPaths& paths = plan_.paths[block.loops[0]];
    if (paths.closing.empty() || paths.terminal.size() != 3 || !loop.redundant.empty()) {
      return false;
    }
    int parent = paths.lca;
    for (size_t i = 0; i < 3; ++i) {
      const int body = form->joint[i].body;
      // The joint below and this loop; the terminal body carries this loop only.
      if (body != paths.terminal[i] || model_.bodies[body].parent != parent ||
          users_[body] != (i < 2 ? 2 : 1) || model_.is_contact_body(body)) {
        return false;
      }
      parent = body;
    }
    return true;
  }

  void find_legs() {
    leg_.assign(model_.bodies.size(), -1);
    for (size_t b = 0; b < plan_.blocks.size(); ++b) {
      LoopBlock& block = plan_.blocks[b];
      block.is_leg = is_leg(block);
      for (int body : block.dep_bodies) {
        if (block.is_leg) leg_[body] = static_cast<int>(b);
      }
    }
  }

  /// The leg at the end of every term of a gear: do all belong to one platform?
  /// @param[out] legs  blocks
  bool find_legs_of(int gear, std::vector<int>& legs) const {
    const int k = plan_.blocks[gear_[gear]].loops[0];
    for (const CouplingTerm& term : list_terms(model_.loops[k], plan_.paths[k])) {
      if (leg_[term.body] >= 0) {
        legs.push_back(leg_[term.body]);
      } else if (gear_[term.body] < 0 || !find_legs_of(term.body, legs)) {
        return false;
      }
    }
    const auto paths = [&](int b) -> const LoopPaths& {
      return plan_.paths[plan_.blocks[b].loops[0]];
    };
    return !legs.empty() && std::all_of(legs.begin(), legs.end(), [&](int b) {
      return paths(b).lca == paths(legs[0]).lca &&
             paths(b).closing.back() == paths(legs[0]).closing.back();
    });
  }

  /// On the root of its legs; or on tube or rod of its only leg, turning with the slide about it.
  bool has_known_carrier(int gear, const std::vector<int>& legs) const {
    const int carrier = model_.bodies[gear].parent;
    const LoopBlock& leg = plan_.blocks[legs[0]];
    if (carrier == plan_.paths[leg.loops[0]].lca) return true;
    const ClosedForm& form = *leg.form();
    const int slide = form.joint[2].body, k = plan_.blocks[gear_[gear]].loops[0];
    if (form.kind != LegKind::kR2P1R3 || (carrier != slide && carrier != form.joint[1].body)) {
      return false;
    }
    const std::vector<CouplingTerm> terms = list_terms(model_.loops[k], plan_.paths[k]);
    const Vec3<double> along = home_[slide].R * model_.bodies[slide].axis;
    return terms.size() == 1 && terms[0].body == slide &&
           along.cross(home_[gear].R * model_.bodies[gear].axis).norm() <= kRounding;
  }

  /// @return true if there was one
  bool drop_gears() {
    std::vector<int> dropped;
    for (int gear = 0; gear < static_cast<int>(gear_.size()); ++gear) {
      std::vector<int> legs;
      if (gear_[gear] < 0) continue;
      if (users_[gear] > 0 || !find_legs_of(gear, legs) || !has_known_carrier(gear, legs)) {
        dropped.push_back(gear);
      }
    }
    for (int gear : dropped) gear_[gear] = -1;
    return !dropped.empty();
  }

  const MechanismModel& model_;
  const std::vector<Pose<double>>& home_;
  LoopPlan& plan_;
  std::vector<int> gear_;   ///< per body: block of the coupling that turns it, or -1
  std::vector<int> leg_;    ///< per body: block of its leg, or -1
  std::vector<int> users_;  ///< per body
};

/// The platform on which a leg ends.
LegPlatform& find_platform(const MechanismModel& model, LoopPlan& plan, const LoopBlock& leg) {
  const LoopPaths& paths = plan.paths[leg.loops[0]];
  const int body = paths.closing.back();
  const auto known = std::find_if(
      plan.platforms.begin(), plan.platforms.end(),
      [&](const LegPlatform& each) { return each.root == paths.lca && each.body == body; });
  if (known != plan.platforms.end()) return *known;
  const bool is_free = paths.closing.size() == 1 && model.bodies[body].joint == JointType::kFree;
  plan.platforms.push_back({paths.lca, body, paths.closing, leg.low, {}, is_free, {}});
  return plan.platforms.back();
}

/// A gear with its coordinate in joints of legs. @pre the gears that its coupling names are there
void add_gear(const MechanismModel& model, LoopPlan& plan, int b) {
  const int k = plan.blocks[b].loops[0];
  const Loop& loop = model.loops[k];
  LegGear gear;
  gear.body = loop.dependent[0];
  gear.block = b;
  gear.constant = loop.offset / find_coupling_factor(loop, gear.body);
  gear.carrier = model.bodies[gear.body].parent;
  const auto add = [&gear](int body, double ratio) {
    const auto same = std::find_if(gear.terms.begin(), gear.terms.end(),
                                   [&](const CouplingTerm& term) { return term.body == body; });
    if (same != gear.terms.end()) {
      same->ratio += ratio;
    } else {
      gear.terms.push_back({body, ratio});
    }
  };
  LegPlatform* platform = nullptr;
  for (const CouplingTerm& term : list_terms(loop, plan.paths[k])) {
    for (LegPlatform& each : plan.platforms) {
      for (int leg : each.blocks) {
        const std::vector<int>& bodies = plan.blocks[leg].dep_bodies;
        if (std::find(bodies.begin(), bodies.end(), term.body) == bodies.end()) continue;
        platform = &each;
        add(term.body, term.ratio);
      }
      for (const LegGear& other : each.gears) {
        if (other.body != term.body) continue;
        platform = &each;
        gear.constant += term.ratio * other.constant;
        for (const CouplingTerm& of : other.terms) add(of.body, term.ratio * of.ratio);
      }
    }
  }
  platform->gears.push_back(gear);
}

bool is_free_platform(const MechanismModel& model, const LoopPlan& plan) {
  if (plan.platforms.size() != 1 || !plan.platforms[0].is_free) return false;
  const LegPlatform& platform = plan.platforms[0];
  const size_t carriers = platform.root == kBase ? 0 : 1;
  const auto is_free = [&](int i) {
    return model.bodies[i].joint == JointType::kFree &&
           (i == platform.body || model.bodies[i].parent == kBase);
  };
  return plan.tree_bodies.size() == 1 + carriers && plan.reduced_blocks == 0 &&
         std::all_of(plan.tree_bodies.begin(), plan.tree_bodies.end(), is_free);
}

}  // namespace

void find_platforms(const MechanismModel& model, const std::vector<Pose<double>>& home,
                    LoopPlan& plan) {
  PlatformSearch(model, home, plan).run();
  const auto place = [](const LoopBlock& block) {
    return block.is_gear ? 2 : block.is_leg ? 1 : 0;
  };
  std::stable_sort(plan.blocks.begin(), plan.blocks.end(),
                   [&](const LoopBlock& a, const LoopBlock& b) { return place(a) < place(b); });
  std::vector<char> is_condensed(model.bodies.size(), 0);
  for (int b = 0; b < static_cast<int>(plan.blocks.size()); ++b) {
    const LoopBlock& block = plan.blocks[b];
    for (int k : block.loops) plan.block_of_loop[k] = b;
    if (!block.is_condensed()) {
      ++plan.reduced_blocks;
      continue;
    }
    for (int body : block.dep_bodies) is_condensed[body] = 1;
    if (block.is_leg) find_platform(model, plan, block).blocks.push_back(b);
    if (block.is_gear) add_gear(model, plan, b);
  }
  for (int i = 0; i < static_cast<int>(model.bodies.size()); ++i) {
    (is_condensed[i] ? plan.leg_bodies : plan.tree_bodies).push_back(i);
  }
  plan.is_free_platform = is_free_platform(model, plan);
}

}  // namespace dockloop
