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
  memory.near_gap.reserve(count);
  if (find_sphere_gap(model, motion.p) <= 0 && count > 0) {
    memory.searched += work.searched;
    forget_plates(work);
    const auto find_gap_below = [&](int pair, double limit) {
      Place<double> c;
      return find_pair<double>(model, model.pairs[pair], motion, work, limit, c);
    };
    const int near = static_cast<int>(memory.near.size());
    // A new list origin after a motion of half the list radius.
    if (!memory.has_reference ||
        find_displacement<double>(model, memory.all, motion) > memory.radius / 2) {
      memory.gap.resize(count);
      memory.least_gap = kNoGap;
      for (int i = 0; i < count; ++i) {
        memory.gap[i] = find_gap_below(i, kGapLimit);
        memory.least_gap = std::min(memory.least_gap, memory.gap[i]);
      }
      memory.radius = std::max(kLeastListRadius, memory.least_gap / 2);
      memory.near.clear();
      memory.near_gap.clear();
      for (int i = 0; i < count; ++i) {
        if (memory.gap[i] > memory.radius) continue;
        memory.near.push_back(i);
        memory.near_gap.push_back(memory.gap[i]);
      }
      memory.all = memory.close = {motion.R, motion.p};
      memory.searched = 0;
      memory.has_reference = true;
    } else if (kSearches * memory.searched > near) {
      // And one for the near pairs as soon as searches would have paid for it.
      for (int k = 0; k < near; ++k) {
        memory.near_gap[k] = find_gap_below(memory.near[k], memory.radius);
      }
      memory.close = {motion.R, motion.p};
      memory.searched = 0;
    }
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

double find_sphere_gap(const ContactModel& model, const Vec3<double>& p) {
  return p.norm() - 2 * model.bounding_radius;
}

bool have_rings_passed(const ContactModel& model, const RelativeMotion<double>& motion) {
  if (!model.rings || find_sphere_gap(model, motion.p) > 0) return false;
  const Annulus<double> active = get_annulus(model.active[0]);
  const Annulus<double> passive = get_annulus(model.passive[0]);
  const Vec3<double> center = motion.p + motion.R.col(0) * passive.x;
  return center.x() < active.x && center.tail<2>().norm() < active.outer + passive.outer;
}

double find_approach_bound(const ContactModel& model, const RelativeMotion<double>& motion) {
  return motion.v.norm() + motion.w.norm() * model.bounding_radius;
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
