// Makes contact models from hardware: cores, the pairs of them that may touch, what follows from
// both.
#include <algorithm>
#include <array>
#include <set>
#include <string>

#include "contact/contact_model.hpp"
#include "math/dock_assert.hpp"
#include "math/status.hpp"

namespace dockloop {
namespace {

constexpr size_t kMaxPairs = 4000;
constexpr int kLeastNodes = 3;  ///< of a set that is evaluated together

/// Cores of one side by index.
using CoreList = std::vector<int>;

/// Kind of a pair; the first core is the simpler one. @param rings  of two guide rings
/// @pre no pair of a plate or a surface of revolution with a surface of revolution
PairKind find_kind(const Core& first, const Core& second, bool rings) {
  DOCK_ASSERT(second.kind != CoreKind::kRevolution || first.kind == CoreKind::kPoint ||
              first.kind == CoreKind::kSegment);
  switch (second.kind) {
    case CoreKind::kPoint:
      return PairKind::kPointPoint;
    case CoreKind::kSegment:
      return first.kind == CoreKind::kPoint ? PairKind::kPointSegment : PairKind::kSegmentSegment;
    case CoreKind::kPlate:
      return first.kind == CoreKind::kPoint     ? PairKind::kPointPlate
             : first.kind == CoreKind::kSegment ? PairKind::kSegmentPlate
                                                : PairKind::kPlatePlate;
    case CoreKind::kRevolution:
      break;
  }
  if (first.kind == CoreKind::kPoint) {
    return is_annulus(second) ? PairKind::kPointAnnulus : PairKind::kPointRevolution;
  }
  return rings ? PairKind::kSegmentAnnulus : PairKind::kSegmentRevolution;
}

/// All pairs of a core of one list, which `flip` says is of P, with one of the other side.
void add_pairs(ContactModel& m, bool flip, const CoreList& first, const CoreList& second, int law) {
  const std::vector<Core>&own = flip ? m.passive : m.active, &other = flip ? m.active : m.passive;
  for (const int i : first) {
    for (const int j : second) {
      m.pairs.push_back({find_kind(own[i], other[j], m.rings), flip, i, j, law,
                         own[i].rounding + other[j].rounding, -1, (flip ? other[j] : own[i]).body});
    }
  }
}

/// Points of a run of pairs that are evaluated together.
NodeSet make_node_set(const ContactModel& m, int first, int count) {
  NodeSet set;
  set.first = first;
  set.count = count;
  set.on_passive = m.pairs[first].first_on_passive;
  set.groups.resize((static_cast<size_t>(count) + kGroup - 1) / kGroup);
  for (int i = 0; i < static_cast<int>(set.groups.size()) * kGroup; ++i) {
    const ContactPair& pair = m.pairs[first + std::min(i, count - 1)];
    const Vec3<double>& point = (set.on_passive ? m.passive : m.active)[pair.first].point;
    for (int j = 0; j < 3; ++j) set.groups[i / kGroup].position[j][i % kGroup] = point[j];
  }
  return set;
}

/// Finds the runs of points on one annulus.
void make_node_sets(ContactModel& m) {
  const auto belong_together = [&](const ContactPair& a, const ContactPair& b) {
    const std::vector<Core>& own = a.first_on_passive ? m.passive : m.active;
    return b.kind == PairKind::kPointAnnulus && a.first_on_passive == b.first_on_passive &&
           a.body == b.body && a.second == b.second && a.law == b.law && a.rounding == b.rounding &&
           own[a.first].surface == own[b.first].surface;
  };
  for (int i = 0; i < m.pair_count();) {
    int end = i;
    while (end < m.pair_count() && belong_together(m.pairs[i], m.pairs[end])) ++end;
    if (end - i >= kLeastNodes) {
      for (int k = i; k < end; ++k) m.pairs[k].node_set = static_cast<int>(m.node_sets.size());
      m.node_sets.push_back(make_node_set(m, i, end - i));
    }
    i = std::max(end, i + 1);
  }
}

/// What follows from cores and pairs.
void finish(ContactModel& m) {
  m.kind = ContactModel::Kind::kSurfaces;
  for (std::vector<Core>* side : {&m.active, &m.passive}) {
    for (Core& core : *side) {
      core.sphere = find_sphere(core);
      if (core.kind == CoreKind::kRevolution) core.box = find_box(core.profile);
    }
  }
  std::stable_sort(m.pairs.begin(), m.pairs.end(),
                   [](const ContactPair& a, const ContactPair& b) { return a.body < b.body; });
  m.least_rounding = kNoGap;
  for (const ContactPair& pair : m.pairs) {
    m.least_rounding = std::min(m.least_rounding, pair.rounding);
    ++m.bodies[pair.body].count;
  }
  int first = 0;
  for (int body = 0; body < m.body_count(); ++body) {
    ActiveBody& of = m.bodies[body];
    of.first = first;
    first += of.count;
    of.bounding_radius =
        std::max(find_bounding_radius(m.active, body), find_bounding_radius(m.passive));
    m.bounding_radius = std::max(m.bounding_radius, of.bounding_radius);
  }
  make_node_sets(m);
}

}  // namespace

ContactModel make_ring_contact(const GuideRing& active, const GuideRing& passive,
                               const ContactLaw& law) {
  constexpr int kFace = 0, kCommon = 0, kNode = 1;  // first core; laws
  const CaptureHardware hardware[2] = {make_capture_hardware(active),
                                       make_passive_hardware(passive)};
  ContactModel m;
  m.rings = true;
  m.active = make_ring_cores(hardware[0], "active ring");
  m.passive = make_ring_cores(hardware[1], "passive ring");
  set_law(m, law);
  // Cores of each side by what they are.
  std::array<CoreList, 2> nodes, petals, edges;
  for (const int side : {0, 1}) {
    const int node_count = static_cast<int>(hardware[side].nodes.size());
    const int petal_count = static_cast<int>(hardware[side].petals.size());
    for (int i = 0; i < node_count; ++i) nodes[side].push_back(1 + i);
    for (int i = 0; i < petal_count; ++i) petals[side].push_back(1 + node_count + i);
    for (int i = 0; i < 2 * petal_count; ++i) {
      edges[side].push_back(1 + node_count + petal_count + i);
    }
  }
  for (size_t i = 0; i < petals[0].size(); ++i) {
    const int surface = static_cast<int>(i);
    m.surfaces.push_back({"petal" + std::to_string(i + 1), false});
    for (const int core : {petals[0][i], edges[0][2 * i], edges[0][2 * i + 1]}) {
      m.active[core].surface = surface;
    }
  }
  for (const bool flip : {false, true}) {
    add_pairs(m, flip, nodes[flip], {kFace}, kNode);
    add_pairs(m, flip, edges[flip], {kFace}, kCommon);
    add_pairs(m, flip, nodes[flip], petals[!flip], kCommon);
  }
  add_pairs(m, false, petals[0], petals[1], kCommon);
  finish(m);
  return m;
}

namespace {

/// The cores of one side while a model is made from names.
struct NamedSide {
  bool on_passive;
  std::vector<Core>& cores;
  std::vector<std::string> group, law;  ///< per core; none for edges of plates

  CoreList find(const std::string& name) const {
    CoreList found;
    for (size_t i = 0; i < group.size(); ++i) {
      if (group[i] == name) found.push_back(static_cast<int>(i));
    }
    return found;
  }
};

/// Index of a surface, which is new if its name is.
int add_surface(ContactModel& m, const std::string& name, bool on_passive) {
  for (size_t i = 0; i < m.surfaces.size(); ++i) {
    if (m.surfaces[i].name == name && m.surfaces[i].on_passive == on_passive) {
      return static_cast<int>(i);
    }
  }
  if (m.surfaces.size() == kMaxSurfaces) {
    throw ModelError("contact: its cores form more than " + std::to_string(kMaxSurfaces) +
                     " groups; give cores that belong together one group");
  }
  m.surfaces.push_back({name, on_passive});
  return static_cast<int>(m.surfaces.size()) - 1;
}

void add_side(ContactModel& m, const std::vector<NamedCore>& named, NamedSide& side) {
  for (const NamedCore& each : named) {
    Core core = each.core;
    // A group without a piece has no surface: its force would always be zero.
    const std::vector<std::string>& pieces = each.piece_groups;
    const bool has_piece =
        pieces.empty() || std::find(pieces.begin(), pieces.end(), each.group) != pieces.end();
    core.surface = add_surface(m, has_piece ? each.group : pieces.front(), side.on_passive);
    for (const std::string& group : pieces) {
      core.piece_surfaces.push_back(add_surface(m, group, side.on_passive));
    }
    if (core.body >= m.body_count()) m.bodies.resize(static_cast<size_t>(core.body) + 1);
    side.cores.push_back(core);
    side.group.push_back(each.group);
    side.law.push_back(each.law);
  }
  // Edges of plates are segments of their own, after the named cores.
  for (size_t i = 0; i < named.size(); ++i) {
    const Core plate = side.cores[i];
    for (size_t k = 0; k < plate.edges.size(); ++k) {
      const int edge = plate.edges[k];
      Core segment = make_segment("edge " + std::to_string(edge + 1) + " of " + plate.name,
                                  plate.plate.corner[edge], plate.plate.corner[(edge + 1) % 4],
                                  plate.rounding);
      segment.surface = plate.surface;
      segment.body = plate.body;
      side.cores[i].edges[k] = static_cast<int>(side.cores.size());
      side.cores.push_back(segment);
    }
  }
}

/// Law of a pair of cores: that of the groups, else of the cores, else the common one.
int find_law(const ContactModel& m, const std::string& of_groups, const std::string& of_active,
             const std::string& of_passive, const std::string& cores) {
  if (of_groups.empty() && !of_active.empty() && !of_passive.empty() && of_active != of_passive) {
    throw ModelError("contact: " + cores + " have the laws '" + of_active + "' and '" + of_passive +
                     "'; name the law of this pair in contact.pairs");
  }
  const std::string& name = !of_groups.empty()   ? of_groups
                            : !of_active.empty() ? of_active
                                                 : of_passive;
  if (name.empty()) return 0;
  std::string known;
  for (size_t i = 0; i < m.variants.size(); ++i) {
    if (m.variants[i].name == name) return static_cast<int>(i) + 1;
    known += (known.empty() ? "" : ", ") + m.variants[i].name;
  }
  throw ModelError("contact: " + cores + " have the law '" + name + "', which contact.laws lacks" +
                   (known.empty() ? "" : "; it has " + known));
}

/// The direction to a surface of revolution is not defined on its axis: no core may touch there.
void check_bore(const Core& first, const Core& second, double rounding) {
  const Profile& profile = second.profile;
  for (int k = 0; k < profile.piece_count(); ++k) {
    const Profile::Node &a = profile.begin_of(k), &b = profile.end_of(k);
    const double least = std::min(a.r, b.r);
    const bool is_disc = a.x == b.x && a.r != b.r && least == 0.0;
    if (is_disc || least > rounding) continue;
    throw ModelError("contact: the profile of " + second.name + " has a radius of " +
                     describe_number(least) + " m, and the roundings of it and of " + first.name +
                     " are " + describe_number(rounding) +
                     " m together; radii must be larger than that, except of a disc that begins "
                     "on the axis (where the core touches on the axis, no direction exists)");
  }
}

/// A pair of one core of each side.
void add_pair(ContactModel& m, int active, int passive, int law) {
  const bool flip = m.passive[passive].kind < m.active[active].kind;
  const Core& first = flip ? m.passive[passive] : m.active[active];
  const Core& second = flip ? m.active[active] : m.passive[passive];
  if (second.kind == CoreKind::kRevolution) {
    if (first.kind == CoreKind::kRevolution) {
      throw ModelError("contact: " + first.name + " and " + second.name +
                       " are both surfaces of revolution, which do not meet directly; put nodes "
                       "on one of them");
    }
    if (first.kind == CoreKind::kPlate) {
      if (first.edges.empty()) {
        throw ModelError("contact: " + first.name + " meets " + second.name +
                         " with its edges; list those that count in its member 'edges'");
      }
      for (const int edge : first.edges) {
        add_pair(m, flip ? active : edge, flip ? edge : passive, law);
      }
      return;
    }
    check_bore(first, second, first.rounding + second.rounding);
  }
  if (m.pairs.size() == kMaxPairs) {
    throw ModelError("contact: its pairs are more than " + std::to_string(kMaxPairs));
  }
  add_pairs(m, flip, {flip ? passive : active}, {flip ? active : passive}, law);
}

std::string list_groups(const NamedSide& side) {
  std::set<std::string> names(side.group.begin(), side.group.end());
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text.empty() ? "none" : text;
}

/// Innermost place of the passive side along x of P [m].
double find_depth(const std::vector<Core>& passive) {
  double depth = 0.0;
  for (const Core& core : passive) {
    double x = core.sphere.centre.x() + core.sphere.radius;
    if (core.kind == CoreKind::kRevolution && core.axis.R.isIdentity(0.0)) {
      x = core.axis.p.x() + core.box.x_high;
    }
    depth = std::max(depth, x);
  }
  return depth;
}

}  // namespace

ContactModel make_surface_contact(const std::vector<NamedCore>& active,
                                  const std::vector<NamedCore>& passive,
                                  const std::vector<GroupPair>& groups, const ContactLaw& law,
                                  const std::vector<LawVariant>& variants) {
  ContactModel m;
  m.variants = variants;
  set_law(m, law);
  NamedSide on_G{false, m.active, {}, {}}, on_P{true, m.passive, {}, {}};
  add_side(m, active, on_G);
  add_side(m, passive, on_P);
  std::set<std::pair<int, int>> known;
  for (const GroupPair& row : groups) {
    bool exists = false;
    const auto add_row = [&](const std::string& of_G, const std::string& of_P) {
      for (const int a : on_G.find(of_G)) {
        for (const int p : on_P.find(of_P)) {
          exists = true;
          const std::string cores = m.active[a].name + " and " + m.passive[p].name;
          if (!known.insert({a, p}).second) {
            throw ModelError("contact.pairs name " + cores + " twice");
          }
          add_pair(m, a, p, find_law(m, row.law, on_G.law[a], on_P.law[p], cores));
        }
      }
    };
    add_row(row.first, row.second);
    if (row.first != row.second) add_row(row.second, row.first);
    if (!exists) {
      throw ModelError("contact.pairs name the groups '" + row.first + "' and '" + row.second +
                       "', which no two cores of opposite sides have; groups of the active side: " +
                       list_groups(on_G) + "; of the passive side: " + list_groups(on_P));
    }
  }
  if (m.pairs.empty()) throw ModelError("contact.pairs is empty: nothing could touch");
  finish(m);
  m.depth = find_depth(m.passive);
  return m;
}

}  // namespace dockloop
