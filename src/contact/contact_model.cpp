// Pair table, neighbour list and bounds; contact_model_body.hpp, for the scalars of the core.
#include "contact/contact_model.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "contact/contact_model_body.hpp"

namespace dockloop {

namespace {

NodeSet make_node_set(int first, bool on_passive, const std::vector<Vec3<double>>& points) {
  NodeSet set;
  set.first = first;
  set.count = static_cast<int>(points.size());
  set.on_passive = on_passive;
  set.groups.resize((points.size() + kGroup - 1) / kGroup);
  for (size_t i = 0; i < set.groups.size() * kGroup; ++i) {
    const Vec3<double>& point = points[std::min(i, points.size() - 1)];
    for (int j = 0; j < 3; ++j) set.groups[i / kGroup].position[j][i % kGroup] = point[j];
  }
  return set;
}

/// "azimuth 78.8 deg", from 0 to 360.
std::string describe_azimuth(const Vec3<double>& at) {
  constexpr double kUp = 1e-6;  // halves are rounded up, on every machine
  const double tenths =
      std::round(std::atan2(at[2], at[1]) * 1800.0 / static_cast<double>(EIGEN_PI) + kUp);
  char text[32];
  std::snprintf(text, sizeof text, "azimuth %.1f deg", std::fmod(tenths + 3600.0, 3600.0) / 10.0);
  return text;
}

void require_value(bool ok, const char* name, double value, const char* limit) {
  if (!ok) {
    throw ModelError(std::string("contact law: ") + name + " is " + std::to_string(value) +
                     "; it must be " + limit);
  }
}

}  // namespace

ContactModel make_ring_contact(const GuideRing& active, const GuideRing& passive,
                               const ContactLaw& law) {
  ContactModel m;
  m.kind = ContactModel::Kind::kRings;
  m.active = make_capture_hardware(active);
  m.passive = make_passive_hardware(passive);
  m.reach = std::max(m.active.reach(), m.passive.reach());
  set_law(m, law);

  // Pairs, each kind once per carrier of its first core.
  const auto add = [&](PairKind kind, bool flip, size_t first, size_t second, int petal, double r) {
    m.pairs.push_back({kind, flip, static_cast<int>(first), static_cast<int>(second), petal, r});
  };
  for (const bool flip : {false, true}) {
    const CaptureHardware &a = flip ? m.passive : m.active, &b = flip ? m.active : m.passive;
    const double ring_ring = a.ring_rounding + b.ring_rounding;
    const double petal_ring = a.petal_rounding + b.ring_rounding;
    const double node_petal = a.ring_rounding + b.petal_rounding;
    m.nodes[flip] = make_node_set(m.pair_count(), flip, a.nodes);
    for (size_t i = 0; i < a.nodes.size(); ++i) add(PairKind::kNodeRing, flip, i, 0, -1, ring_ring);
    for (size_t i = 0; i < 2 * a.petals.size(); ++i) {
      add(PairKind::kEdgeRing, flip, i, 0, flip ? -1 : static_cast<int>(i / 2), petal_ring);
    }
    for (size_t i = 0; i < a.nodes.size(); ++i) {
      for (size_t j = 0; j < b.petals.size(); ++j) {
        add(PairKind::kNodePetal, flip, i, j, flip ? static_cast<int>(j) : -1, node_petal);
      }
    }
  }
  for (size_t i = 0; i < m.active.petals.size(); ++i) {
    for (size_t j = 0; j < m.passive.petals.size(); ++j) {
      add(PairKind::kPetalPetal, false, i, j, static_cast<int>(i),
          m.active.petal_rounding + m.passive.petal_rounding);
    }
  }
  m.least_rounding = kNoGap;
  for (const ContactPair& pair : m.pairs) {
    m.least_rounding = std::min(m.least_rounding, pair.rounding);
  }
  return m;
}

ContactModel make_absorber_contact(const AbsorberLaw& law) {
  require_value(law.stiffness >= 0, "absorber stiffness", law.stiffness, "0 or more");
  require_value(law.damping >= 0, "absorber damping", law.damping, "0 or more");
  ContactModel m;
  m.kind = ContactModel::Kind::kAbsorber;
  m.absorber = law;
  m.least_rounding = kNoGap;
  return m;
}

std::string describe_pair(const ContactModel& model, int pair) {
  if (pair < 0 || pair >= model.pair_count()) return "surfaces";  // no pair, as of an absorber
  const ContactPair& p = model.pairs[pair];
  const CaptureHardware& side = p.first_on_passive ? model.passive : model.active;
  const char* own = p.first_on_passive ? "passive ring" : "active ring";
  const char* other = p.first_on_passive ? "active ring" : "passive ring";
  const auto petal = [](int index, const char* ring) {
    return "petal " + std::to_string(index + 1) + " of the " + ring;
  };
  const auto node = [&] {
    return "node " + std::to_string(p.first + 1) + " (" + describe_azimuth(side.nodes[p.first]) +
           ") of the " + own + " face";
  };
  switch (p.kind) {
    case PairKind::kNodeRing:
      return node() + " and the " + other + " face";
    case PairKind::kEdgeRing: {
      const bool at_plus = p.first % 2 == 0;  // base corners come first: -, +
      return "the side edge (base at " +
             describe_azimuth(side.petals[p.first / 2].corner[at_plus]) + ") of " +
             petal(p.first / 2, own) + " and the " + other + " face";
    }
    case PairKind::kPetalPetal:
      return petal(p.first, own) + " and " + petal(p.second, other);
    case PairKind::kNodePetal:
      break;
  }
  return node() + " and " + petal(p.second, other);
}

void set_law(ContactModel& model, const ContactLaw& law) {
  require_value(law.stiffness > 0, "stiffness", law.stiffness, "above 0");
  require_value(law.node_stiffness > 0, "node_stiffness", law.node_stiffness, "above 0");
  require_value(law.toe > 0, "toe", law.toe, "above 0");
  require_value(law.damping >= 0, "damping", law.damping, "0 or more");
  require_value(law.regularisation > 0 && law.regularisation <= 0.01, "regularisation",
                law.regularisation, "above 0 and at most 0.01");
  require_value(law.friction_coefficient >= 0, "friction_coefficient", law.friction_coefficient,
                "0 or more");
  require_value(law.friction_speed > 0, "friction_speed", law.friction_speed, "above 0");
  require_value(law.friction_model == 1 || law.friction_model == 2, "friction_model",
                law.friction_model, "1 (regularised) or 2 (bristle)");
  require_value(law.bristle_stiffness > 0, "bristle_stiffness", law.bristle_stiffness, "above 0");
  require_value(law.bristle_damping >= 0, "bristle_damping", law.bristle_damping, "0 or more");
  require_value(law.bristle_relaxation > 0, "bristle_relaxation", law.bristle_relaxation,
                "above 0");
  require_value(law.bristle_force_floor > 0, "bristle_force_floor", law.bristle_force_floor,
                "above 0");
  model.law = law;
}

int bristle_state_count(const ContactModel& model) {
  return model.law.friction_model == 2 ? 3 * model.pair_count() : 0;
}

double update_contact_memory(const ContactModel& model, const RelativeMotion<double>& motion,
                             double* z, ContactWorkspace<double>& work, ContactMemory& memory) {
  const int count = model.pair_count();
  memory.closed = work.closed;
  memory.n_last.resize(count, Vec3<double>::Zero());
  for (int i = 0; i < count; ++i) {
    if (memory.closed[i]) memory.n_last[i] = work.way[i].normalized();
  }
  memory.gap.reserve(count);  // all allocation happens in the first call
  memory.near.reserve(count);
  if (find_sphere_gap(model, motion.p) <= 0 && count > 0) {
    // A new list origin after a motion of half the list radius.
    const double delta =
        memory.has_reference ? find_displacement<double>(model, memory, motion) : 0;
    if (!memory.has_reference || delta > memory.radius / 2) {
      place_petals<double>(motion, work);
      memory.gap.resize(count);
      memory.least_gap = kNoGap;
      for (int i = 0; i < count; ++i) {
        Closest<double> c;
        memory.gap[i] = find_pair<double>(model, model.pairs[i], motion, work, kGapLimit, c);
        memory.least_gap = std::min(memory.least_gap, memory.gap[i]);
      }
      memory.radius = std::max(kLeastListRadius, memory.least_gap / 2);
      memory.near.clear();
      for (int i = 0; i < count; ++i) {
        if (memory.gap[i] <= memory.radius) memory.near.push_back(i);
      }
      memory.R_ref = motion.R;
      memory.p_ref = motion.p;
      memory.has_reference = true;
    }
  }

  // Bristles of open pairs are dropped.
  double dropped = 0.0;
  for (int i = 0; z && i < bristle_state_count(model); ++i) {
    if (memory.closed[i / 3]) continue;
    dropped += model.law.bristle_stiffness * z[i] * z[i] / 2;
    z[i] = 0.0;
  }
  return dropped;
}

double find_sphere_gap(const ContactModel& model, const Vec3<double>& p) {
  return p.norm() - 2 * model.reach;
}

bool have_rings_passed(const ContactModel& model, const RelativeMotion<double>& motion) {
  if (model.kind != ContactModel::Kind::kRings || find_sphere_gap(model, motion.p) > 0)
    return false;
  const Annulus<double>&active = model.active.ring, &passive = model.passive.ring;
  const Vec3<double> center = motion.p + motion.R.col(0) * passive.x;
  return center.x() < active.x && center.tail<2>().norm() < active.outer + passive.outer;
}

double find_approach_bound(const ContactModel& model, const RelativeMotion<double>& motion) {
  return motion.v.norm() + motion.w.norm() * model.reach;
}

double find_step_bound(const ContactModel& model, double gap,
                       const RelativeMotion<double>& motion) {
  const double speed = find_approach_bound(model, motion);
  const double way = std::max(gap, 0.0) + model.least_rounding / 4;
  return way < kNever * speed ? way / speed : kNever;
}

double find_time_to_contact(double gap, double speed_bound, double acceleration_bound) {
  if (gap <= 0) return 0.0;
  // Root of a t^2/2 + v t - gap without cancellation.
  const double rate =
      speed_bound + std::sqrt(speed_bound * speed_bound + 2 * acceleration_bound * gap);
  return 2 * gap < kNever * rate ? 2 * gap / rate : kNever;
}

}  // namespace dockloop
