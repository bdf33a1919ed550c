// All contacts between the capture hardware of two vehicles, as one wrench and one energy.
//
// Hardware is data: cores of both sides (cores.hpp) and the pairs of them that may touch. A guide
// ring is a builder of such data. Every pair has one closest-point problem, one potential of its
// distance sqrt(V), one damping and one friction law. Contributions of pairs add in a fixed order;
// nothing is selected, merged or averaged, because each of these would create jumps or energy. G is
// the frame of the active ring, P that of the passive interface; results are on P, about the origin
// of G, in axes of G, and the opposite acts on G at the same points, so momentum balances to
// rounding.
//
// Active cores may belong to several bodies, as fingers that close: G comes first. What is said of
// G here holds for each body: its pairs see the motion of P relative to it, in its axes.
#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "contact/cores.hpp"
#include "contact/guide_ring.hpp"
#include "contact/laws.hpp"
#include "contact/node_lanes.hpp"
#include "contact/plate_lanes.hpp"
#include "contact/primitives.hpp"
#include "math/dock_assert.hpp"
#include "math/status.hpp"
#include "math/types.hpp"

namespace dockloop {

/// One-dimensional absorber for scenes with an exact solution: depth d = -p_x, force
/// k d + c d' along x of G for d > 0, on P at its origin. With `pulls` false the force stays >= 0.
/// Limit: jumps at onset (c v) and, if it pulls, at the end; blind to lateral offset and tilt.
/// A step with the jump inside, even at its start, is wrong. The caller locates onset and end and
/// decides on which side of the jump the absorber is (ContactMemory::absorber).
struct AbsorberLaw {
  double stiffness = 0.0;  ///< k [N/m]
  double damping = 0.0;    ///< c [N s/m]
  bool pulls = false;
};

inline constexpr LawNumber<AbsorberLaw> kAbsorberNumbers[] = {
    {"stiffness", &AbsorberLaw::stiffness, "N/m", Rule::kNotNegative, true,
     "Stiffness of the absorber"},
    {"damping", &AbsorberLaw::damping, "N.s/m", Rule::kNotNegative, false,
     "Damping of the absorber"},
};

constexpr int kMaxPetals = 6, kMaxSurfaces = 16;
/// Gap of a model without surfaces [m] and time of an event that does not happen [s]: large but
/// finite, because results must be finite numbers.
constexpr double kNoGap = 1e9, kNever = 1e9;

/// First core, second core. The annulus kinds are special cases with less work: closed form without
/// pieces; edges of the petals of guide rings, which have one valley.
enum class PairKind : signed char {
  kPointPoint,
  kPointSegment,
  kPointPlate,
  kPointAnnulus,
  kPointRevolution,
  kSegmentSegment,
  kSegmentPlate,
  kSegmentAnnulus,
  kSegmentRevolution,
  kPlatePlate
};

/// Two cores that may touch. `first_on_passive`: the first core belongs to P.
struct ContactPair {
  PairKind kind;
  bool first_on_passive;
  int first, second;  ///< cores of their sides
  int law;            ///< of ContactModel::laws
  double rounding;    ///< sum of the rounding radii [m]
  int node_set = -1;  ///< of ContactModel::node_sets, -1 for none
  int body = 0;       ///< of ContactModel::bodies: that of the active core
};

/// A body with active cores.
struct ActiveBody {
  int first = 0, count = 0;      ///< of its pairs
  double bounding_radius = 0.0;  ///< of its cores, and of those of P, each about its origin [m]
};

/// Points of one side on one annulus of the other: pairs that are evaluated together.
struct NodeSet {
  int first = 0, count = 0;  ///< of its pairs
  bool on_passive = false;   ///< the points belong to P
  std::vector<nodes::NodeGroup> groups;
};

/// A part of the hardware whose resultant contact force is a result: a petal, a group of cores.
struct Surface {
  std::string name;
  bool on_passive = false;
};

/// A law that states some members; the others are those of the common law.
struct LawVariant {
  std::string name;
  std::vector<std::pair<double ContactLaw::*, double>> stated;
};

/// Groups of cores of which every core of one may touch every core of the other, on opposite sides.
/// An empty law: that of the cores, else the common law.
struct GroupPair {
  std::string first, second, law;
};

/// A core and the names it has in a description.
struct NamedCore {
  Core core;
  std::string group, law;                 ///< the law may be empty
  std::vector<std::string> piece_groups;  ///< of a profile, may be empty: one per piece
};

struct ContactModel {
  enum class Kind { kNone, kSurfaces, kAbsorber } kind = Kind::kNone;
  std::vector<Core> active, passive;  ///< in axes of their body, and of P
  std::vector<ActiveBody> bodies{1};  ///< G, then MechanismModel::contact_bodies
  std::vector<ContactPair> pairs;     ///< fixed order: the order of summation, by bodies
  std::vector<NodeSet> node_sets;
  std::vector<Surface> surfaces;
  ContactLaw law;                    ///< common
  std::vector<LawVariant> variants;  ///< of the common law
  std::vector<ContactLaw> laws;      ///< the common law and its variants, see set_law()
  AbsorberLaw absorber;
  bool rings = false;  ///< made by make_ring_contact(): face first, surfaces are the active petals
  double bounding_radius = 0.0;  ///< largest one of the bodies [m]
  double least_rounding = 0.0;   ///< smallest rounding sum of all pairs [m]
  double depth = 0.0;  ///< from the origin of P along x to the innermost core of P, 0 for rings [m]

  bool empty() const { return kind == Kind::kNone; }
  int body_count() const { return static_cast<int>(bodies.size()); }
  int pair_count() const { return static_cast<int>(pairs.size()); }
  bool has_surfaces() const { return kind == Kind::kSurfaces; }
};

/// Ring on ring. `passive` is written as for an active side and is placed turned.
/// @throws ModelError for dimensions or law parameters out of range.
ContactModel make_ring_contact(const GuideRing& active, const GuideRing& passive,
                               const ContactLaw& law);
ContactModel make_absorber_contact(const AbsorberLaw& law);
/// @throws ModelError naming the parameter.
void check_absorber(const AbsorberLaw& law);
/// Any hardware. Pairs follow the order of `groups`, in both directions. A plate meets a surface of
/// revolution with its edges. @throws ModelError naming core, group or parameter.
ContactModel make_surface_contact(const std::vector<NamedCore>& active,
                                  const std::vector<NamedCore>& passive,
                                  const std::vector<GroupPair>& groups, const ContactLaw& law,
                                  const std::vector<LawVariant>& variants);

/// Replace the common law. @throws ModelError naming the parameter.
void set_law(ContactModel& model, const ContactLaw& law);

/// The cores of a pair in words, of rings counted from 1; azimuths (y to z, 0 to 360 deg) in axes
/// of the side: "petal 2 of the active ring and petal 1 of the passive ring". Allocates.
std::string describe_pair(const ContactModel& model, int pair);

/// Motion of P relative to G, axes of G. A point c [m, from the origin of G] fixed to P moves
/// relative to G with v + w x (c - p).
template <class S>
struct RelativeMotion {
  Mat3<S> R = Mat3<S>::Identity();  ///< R_GP
  Vec3<S> p = Vec3<S>::Zero();      ///< p_GP [m]
  Vec3<S> w = Vec3<S>::Zero();      ///< w_GP [rad/s]
  Vec3<S> v = Vec3<S>::Zero();      ///< d/dt p as seen in G [m/s]
};

/// Motion of P relative to G and to the other bodies with active cores, each in axes of the body.
template <class S>
struct HardwareMotion : RelativeMotion<S> {
  std::vector<RelativeMotion<S>> others;
  HardwareMotion() = default;
  HardwareMotion(const RelativeMotion<S>& to_G) : RelativeMotion<S>(to_G) {}  // without others
  HardwareMotion& operator=(const RelativeMotion<S>& to_G) {
    RelativeMotion<S>::operator=(to_G);
    return *this;
  }
  /// @param body  of ContactModel::bodies
  const RelativeMotion<S>& of(int body) const {
    DOCK_ASSERT(body <= static_cast<int>(others.size()));
    return body == 0 ? *this : others[body - 1];
  }
};

/// Does the absorber act? Depth and force decide at every state, or the decision of the last event
/// holds until the next event, beyond the surface too.
enum class Acting : signed char { kByState, kNo, kYes };

/// The neighbour list of a body only saves work: lower bounds of all gaps at one list origin (a
/// pose of P in G), and of the gaps of near pairs at a later one. With the bounding radius r, a
/// point of P moves by at most delta = |p - p_origin| + 2 sin(theta/2) r from an origin, so a pair
/// with gap > delta is open.
struct NeighbourList {
  bool has_reference = false;
  Pose<double> all, close;       ///< list origins: of all pairs, of the near ones
  double least_gap = 0.0;        ///< smallest entry of gap [m]
  double radius = 0.0;           ///< pairs with gap <= radius are `near` [m]
  std::vector<double> gap;       ///< per pair of the body, lower bound at `all` [m]
  std::vector<int> near;         ///< pair indices, ascending
  std::vector<double> near_gap;  ///< of these pairs, lower bound at `close` [m]
  int searched = 0;              ///< open pairs searched at accepted steps since `close`

  /// Room for all pairs of a body: later changes and copies allocate nothing.
  void reserve(int pairs) {
    const auto count = static_cast<size_t>(pairs);
    gap.reserve(count);
    near.reserve(count);
    near_gap.reserve(count);
  }
};

/// Data of the last accepted step. Plain data, may be copied and stored. The closed pairs and their
/// normals detect a trial state on the far side of a surface.
struct ContactMemory {
  std::vector<NeighbourList> lists;  ///< per body; empty before the first accepted step
  unsigned origins = 0;              ///< list origins of all pairs that were made
  std::vector<char> closed;          ///< per pair, 1 if in contact at the last accepted step
  /// Unit normal of every closed pair, axes of G. Arrays are copied as bytes, vectors one by one.
  std::vector<std::array<double, 3>> n_last;
  Acting absorber = Acting::kByState;

  /// @return nullptr: all pairs must be searched
  const NeighbourList* find_list(int body) const {
    return !lists.empty() && lists[body].has_reference ? &lists[body] : nullptr;
  }
};

/// A place of a closed pair, axes of G.
struct Touching {
  int pair, sign;            ///< +1 valley, -1 ridge
  Vec3<double> way, middle;  ///< from the point on G to the one on P, and between them [m]
  double root;               ///< sqrt(V) [m]
};

/// Scratch of one evaluation; preallocated, without state.
template <class S>
struct ContactWorkspace {
  explicit ContactWorkspace(const ContactModel& model);
  // Plates by index of their core; nothing for other cores.
  std::vector<Plate<S>> active_plates;   ///< axes of G, written by the constructor
  std::vector<Plate<S>> passive_local;   ///< axes of P, written by the constructor
  std::vector<Plate<S>> passive_plates;  ///< axes of G, of an evaluation that needs them
  std::vector<char> is_placed;           ///< is an entry of passive_plates of this evaluation?
  std::vector<char> closed;              ///< per pair, written by calc_contact
  std::vector<int> searched;  ///< per body, open pairs of which it has searched closest points
  std::vector<Vec3<S>>
      way;  ///< with it: distance vector from G to P of every closed pair, axes of G [m]
  std::vector<Wrench<S>> on_passive;  ///< of the cores on each other body; its origin and axes
  std::vector<Place<S>> places;       ///< of one pair, axes of G; of the pair that is evaluated
  /// With `closed`, for plain numbers: all places of closed pairs but those of node sets, where
  /// `way` gives them.
  std::vector<Touching> touching;
  const nodes::NodeFunctions* node_functions = nullptr;  ///< for plain numbers
  const plates::PlateFunctions* plate_functions = nullptr;
  std::vector<nodes::NodeGaps> node_gaps;  ///< with them, per group of a set
  std::vector<char> may_touch;             ///< per group of a set
  std::vector<int> looked_at;              ///< pairs that no bound of the list excludes
};

template <class S>
struct ContactResult {
  Wrench<S> on_passive;     ///< of the cores on G, about its origin, axes of G [N], [N m]
  S energy = S(0);          ///< elastic, with bristles [J]
  S contact_power = S(0);   ///< dissipated by damping, >= 0 [W]
  S friction_power = S(0);  ///< dissipated by friction, >= 0 [W]
  S gap = S(kNoGap);        ///< exact where < 0, else a lower bound of find_gap [m]
  S depth_ratio = S(0);     ///< largest depth/rounding sum, 1 = cores meet [-]
  S pressed = S(0);         ///< positive where an absorber acts, falls through zero where it ends
  int active_count = 0;     ///< pairs in contact
  std::array<Vec3<S>, kMaxSurfaces> surface_force;  ///< on each surface, axes of G [N]
  ContactResult() { surface_force.fill(Vec3<S>::Zero()); }
};

/// As find_plate_plate(), in SIMD lanes.
Closest<double> find_plates(const plates::PlateFunctions& functions, const Plate<double>& P,
                            const Plate<double>& Q, double mu);

/// Bristle states in the ODE: 0 for friction model 1, else three per pair (z [m], axes of G).
int bristle_state_count(const ContactModel& model);

/// Force, energy and power of all contacts.
/// @param[in]  z      bristles (bristle_state_count), null for friction model 1
/// @param[out] z_dot  their rates [m/s], null for friction model 1
/// @return ok; kContactTooDeep (depth >= 0.98 rounding, or cores that nearly touch) or
/// kContactFlipped (normal of a pair closed at the last accepted step reversed) with index = pair
/// and margin = depth/rounding: the state must not be accepted; retry with a smaller step.
/// No allocation.
template <class S>
Status calc_contact(const ContactModel& model, const ContactMemory& memory,
                    const HardwareMotion<S>& motion, const S* z, S* z_dot,
                    ContactWorkspace<S>& work, ContactResult<S>& out);

/// Smallest sqrt(V) - rounding over all pairs [m], negative in contact; exact. Its neighbour list
/// leaves out pairs that cannot be the closest; an empty memory leaves out none.
template <class S>
S find_gap(const ContactModel& model, const ContactMemory& memory, const HardwareMotion<S>& motion,
           ContactWorkspace<S>& work);

/// Call at accepted steps only. Opened pairs lose their bristle.
/// @pre calc_contact() at this motion, with this workspace
/// @param[in,out] z  bristles or null
/// @return energy of the removed bristles [J], which the caller adds to the friction energy.
double update_contact_memory(const ContactModel& model, const HardwareMotion<double>& motion,
                             double* z, ContactWorkspace<double>& work, ContactMemory& memory);

/// Is a passive guide ring behind the active ring? Surfaces prevent such a motion. Only a start
/// state can have this pose, in which the surfaces do not touch and results have no meaning.
bool have_rings_passed(const ContactModel& model, const RelativeMotion<double>& motion);

/// Upper bound of the speed of any point of P's hardware relative to G, and to other bodies [m/s].
double find_approach_bound(const ContactModel& model, const HardwareMotion<double>& motion);

/// Radius of a sphere about the origin of G that contains the active cores, at this motion, and of
/// one about the origin of P that contains those of P [m].
double find_bounding_radius(const ContactModel& model, const HardwareMotion<double>& motion);

/// Largest step [s] in which no surface can pass through another surface unseen: (max(gap, 0) +
/// rounding/4)/speed.
double find_step_bound(const ContactModel& model, double gap, const HardwareMotion<double>& motion);

/// No contact before this time [s]: root of gap = v t + a t^2/2 with bounds of speed [m/s] and
/// acceleration [m/s2]; 0 in contact, at most kNever.
double find_time_to_contact(double gap, double speed_bound, double acceleration_bound);

}  // namespace dockloop
