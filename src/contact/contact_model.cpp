// Pair table, neighbour list and bounds; contact_model_body.hpp, for the scalars of the core.
#include "contact/contact_model.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>

#include "contact/contact_model_body.hpp"

namespace dockloop {

namespace {

/// @throws ModelError with the fault, if there is one
void refuse(const std::string& fault) {
  if (!fault.empty()) throw ModelError("contact law: " + fault);
}

}  // namespace

void check_absorber(const AbsorberLaw& law) { refuse(find_fault(law, kAbsorberNumbers)); }

ContactModel make_absorber_contact(const AbsorberLaw& law) {
  check_absorber(law);
  ContactModel m;
  m.kind = ContactModel::Kind::kAbsorber;
  m.absorber = law;
  m.least_rounding = kNoGap;
  return m;
}

Closest<double> find_plates(const plates::PlateFunctions& functions, const Plate<double>& P,
                            const Plate<double>& Q, double mu) {
  plates::PlateNumbers numbers[2];
  static_assert(sizeof(Plate<double>) == sizeof(plates::PlateNumbers) + sizeof(double),
                "the numbers of a plate, and its radius");
  std::memcpy(&numbers[0], static_cast<const void*>(&P), sizeof numbers[0]);
  std::memcpy(&numbers[1], static_cast<const void*>(&Q), sizeof numbers[1]);
  const plates::PlateCandidate least = functions.find(numbers[0], numbers[1], mu);
  Closest<double> best{Eigen::Map<const Vec3<double>>(least.first),
                       Eigen::Map<const Vec3<double>>(least.second), least.square};
  improve_by_faces(P, Q, mu, best);
  return best;
}

std::string describe_pair(const ContactModel& model, int pair) {
  if (pair < 0 || pair >= model.pair_count()) return "surfaces";  // no pair, as of an absorber
  const ContactPair& p = model.pairs[pair];
  const std::vector<Core>& own = p.first_on_passive ? model.passive : model.active;
  const std::vector<Core>& other = p.first_on_passive ? model.active : model.passive;
  return own[p.first].name + " and " + other[p.second].name;
}

namespace {

void check_law(const ContactLaw& law) {
  refuse(find_fault(law, kContactNumbers));
  constexpr double kMostRegularisation = 0.01;
  if (law.regularisation > kMostRegularisation) {
    refuse("regularisation is " + describe_number(law.regularisation) +
           "; it must be at most 0.01");
  }
  if (law.friction_model != 1 && law.friction_model != 2) {
    refuse("friction_model is " + std::to_string(law.friction_model) +
           "; it must be 1 (regularised) or 2 (bristle)");
  }
}

}  // namespace

void set_law(ContactModel& model, const ContactLaw& law) {
  model.law = law;
  model.laws = {law};
  if (model.rings) {
    model.laws.push_back(law);
    model.laws.back().stiffness = law.node_stiffness;
  }
  for (const LawVariant& variant : model.variants) {
    model.laws.push_back(law);
    for (const auto& [member, value] : variant.stated) model.laws.back().*member = value;
  }
  for (const ContactLaw& each : model.laws) check_law(each);
}

int bristle_state_count(const ContactModel& model) {
  return model.law.friction_model == 2 ? 3 * model.pair_count() : 0;
}

namespace {

/// Renew the neighbour list of a body, or its part of near pairs, if that pays.
void update_list(const ContactModel& model, int body, const RelativeMotion<double>& motion,
                 ContactWorkspace<double>& work, NeighbourList& list, unsigned& origins) {
  const ActiveBody& of = model.bodies[body];
  list.reserve(of.count);  // all allocation happens in the first call
  if (of.count == 0 || find_sphere_gap(of, motion) > 0) return;
  list.searched += work.searched[body];
  forget_plates(work);
  const auto find_gap_below = [&](int pair, double limit) {
    Place<double> c;
    return find_pair<double>(model, model.pairs[pair], motion, work, limit, c);
  };
  const int near = static_cast<int>(list.near.size());
  // A new list origin after a motion of half the list radius.
  if (!list.has_reference || find_displacement<double>(of, list.all, motion) > list.radius / 2) {
    list.gap.resize(of.count);
    list.least_gap = kNoGap;
    for (int k = 0; k < of.count; ++k) {
      list.gap[k] = find_gap_below(of.first + k, kGapLimit);
      list.least_gap = std::min(list.least_gap, list.gap[k]);
    }
    list.radius = std::max(kLeastListRadius, list.least_gap / 2);
    list.near.clear();
    list.near_gap.clear();
    for (int k = 0; k < of.count; ++k) {
      if (list.gap[k] > list.radius) continue;
      list.near.push_back(of.first + k);
      list.near_gap.push_back(list.gap[k]);
    }
    list.all = list.close = {motion.R, motion.p};
    list.searched = 0;
    list.has_reference = true;
    ++origins;
  } else if (kSearches * list.searched > near) {
    // And one for the near pairs as soon as searches would have paid for it.
    for (int k = 0; k < near; ++k) {
      list.near_gap[k] = find_gap_below(list.near[k], list.radius);
    }
    list.close = {motion.R, motion.p};
    list.searched = 0;
  }
}

}  // namespace

double update_contact_memory(const ContactModel& model, const HardwareMotion<double>& motion,
                             double* z, ContactWorkspace<double>& work, ContactMemory& memory) {
  const int count = model.pair_count();
  memory.closed = work.closed;
  memory.n_last.resize(count, {});
  const char* const all = memory.closed.data();
  const auto find_closed = [&](int from) {  // faster than to look at each pair: few are closed
    if (from == count) return count;
    const void* at = std::memchr(all + from, 1, static_cast<size_t>(count - from));
    return at ? static_cast<int>(static_cast<const char*>(at) - all) : count;
  };
  for (int i = find_closed(0); i < count; i = find_closed(i + 1)) {
    Eigen::Map<Vec3<double>>(memory.n_last[i].data()) = work.way[i].normalized();
  }
  memory.lists.resize(model.bodies.size());
  for (int body = 0; body < model.body_count(); ++body) {
    update_list(model, body, motion.of(body), work, memory.lists[body], memory.origins);
  }

  // Bristles of open pairs are dropped.
  double dropped = 0.0;
  for (int i = 0; z && i < bristle_state_count(model); ++i) {
    if (memory.closed[i / 3]) continue;
    dropped += model.laws[model.pairs[i / 3].law].bristle_stiffness * z[i] * z[i] / 2;
    z[i] = 0.0;
  }
  return dropped;
}

bool have_rings_passed(const ContactModel& model, const RelativeMotion<double>& motion) {
  if (!model.rings || find_sphere_gap(model.bodies[0], motion) > 0) return false;
  const Annulus<double> active = get_annulus(model.active[0]);
  const Annulus<double> passive = get_annulus(model.passive[0]);
  const Vec3<double> center = motion.p + motion.R.col(0) * passive.x;
  return center.x() < active.x && center.tail<2>().norm() < active.outer + passive.outer;
}

double find_approach_bound(const ContactModel& model, const HardwareMotion<double>& motion) {
  double bound = 0.0;
  for (int body = 0; body < model.body_count(); ++body) {
    const RelativeMotion<double>& to = motion.of(body);
    bound = std::max(bound, to.v.norm() + to.w.norm() * model.bodies[body].bounding_radius);
  }
  return bound;
}

double find_bounding_radius(const ContactModel& model, const HardwareMotion<double>& motion) {
  double radius = model.bounding_radius;
  for (int body = 1; body < model.body_count(); ++body) {
    const RelativeMotion<double>& to = motion.of(body);
    const Vec3<double> from_G = motion.p - motion.R * (to.R.transpose() * to.p);
    radius = std::max(radius, from_G.norm() + model.bodies[body].bounding_radius);
  }
  return radius;
}

double find_step_bound(const ContactModel& model, double gap,
                       const HardwareMotion<double>& motion) {
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
