// Marches along roll and lateral directions; see seated_play.hpp.
#include "contact/seated_play.hpp"

#include <algorithm>
#include <cmath>

#include "math/dock_assert.hpp"
#include "math/rotation.hpp"

namespace dockloop {
namespace {

constexpr double kHalfTurn = static_cast<double>(EIGEN_PI);
constexpr double kTouch = 1e-6;   // [m] of gap that ends a march
constexpr int kMostSteps = 2000;  // of a march along a surface, where steps are short
constexpr int kRolls = 13;        // sections, first and last at the ends of the roll
constexpr int kDirections = 24;   // in each section
constexpr int kRefinements = 10;  // halvings of the spacing about the best sample

/// The two rings, seated, with free y, z and roll.
class SeatedRings {
 public:
  SeatedRings(const ContactModel& model, const LatchSet& latches)
      : model_(without_faces(model)), latches_(latches), work_(model_) {
    const Core &active = model.active[0], &passive = model.passive[0];
    motion_.p[0] =
        (get_annulus(active).x + active.rounding) - (get_annulus(passive).x - passive.rounding);
  }

  double find_gap_at(double y, double z, double roll) {
    place(y, z, roll);
    return find_gap<double>(model_, {}, motion_, work_);
  }

  /// Free roll from the centre, in the direction `sign` [rad].
  double find_roll(double sign) {
    const double radius =
        model_.bounding_radius;  // no point of the surfaces moves by more than radius x roll
    return sign / radius * march(kHalfTurn * radius, [&](double s) {
             return find_gap_at(0.0, 0.0, sign * s / radius);
           });
  }

  /// Free distance from the docking axis at this roll [m].
  double find_lateral(double direction, double roll) {
    const double y = std::cos(direction), z = std::sin(direction);
    return march(2.0 * model_.bounding_radius,
                 [&](double s) { return find_gap_at(s * y, s * z, roll); });
  }

  /// Largest distance of a striker before its hook [m].
  double find_striker_opening() {
    place(0.0, 0.0, 0.0);
    double largest = 0.0;
    for (int i = 0; i < latches_.count(); ++i) {
      largest = std::max(largest, find_latch_motion(latches_, i, motion_).s[0]);
    }
    return largest;
  }

  /// Largest distance of a striker from its hook at the end of the free distance [m].
  double find_striker_offset(double direction, double roll) {
    const double way = find_lateral(direction, roll);
    place(way * std::cos(direction), way * std::sin(direction), roll);
    double largest = 0.0;
    for (int i = 0; i < latches_.count(); ++i) {
      largest = std::max(largest, find_latch_motion(latches_, i, motion_).s.tail<2>().norm());
    }
    return largest;
  }

 private:
  /// Seated, ring faces touch everywhere.
  static ContactModel without_faces(ContactModel model) {
    const auto is_face = [](const ContactPair& pair) {
      return pair.kind == PairKind::kPointAnnulus;
    };
    model.pairs.erase(std::remove_if(model.pairs.begin(), model.pairs.end(), is_face),
                      model.pairs.end());
    model.bodies[0].count = model.pair_count();
    return model;
  }

  void place(double y, double z, double roll) {
    motion_.p[1] = y;
    motion_.p[2] = z;
    motion_.R = axis_rotation<double>(Vec3<double>::UnitX(), std::cos(roll), std::sin(roll));
  }

  template <class Gap>
  static double march(double most, const Gap& gap_at) {
    double way = 0.0;
    for (int i = 0; i < kMostSteps && way < most; ++i) {
      const double gap = gap_at(way);
      if (gap < kTouch) return way;
      way += gap;
    }
    return std::min(way, most);
  }

  const ContactModel model_;
  const LatchSet& latches_;
  ContactWorkspace<double> work_;
  RelativeMotion<double> motion_;
};

/// Samples of one variable, evenly spaced, both ends included.
struct Samples {
  double first = 0.0, last = 0.0;
  int count = 1;
  double step() const { return count > 1 ? (last - first) / (count - 1) : 0.0; }
};

/// Highest value over a grid of samples, refined from the best sample in steps that are halved when
/// no step increases the value. Only between the first and the last sample.
template <class Height>
double find_highest(const Samples& along_x, const Samples& along_y, const Height& height) {
  double best = -kNoGap, x = 0.0, y = 0.0;
  const auto try_at = [&](double at_x, double at_y) {
    const double value = height(at_x, at_y);
    if (!(value > best)) return false;
    best = value;
    x = at_x;
    y = at_y;
    return true;
  };
  for (int i = 0; i < along_x.count; ++i) {
    for (int j = 0; j < along_y.count; ++j) {
      try_at(along_x.first + i * along_x.step(), along_y.first + j * along_y.step());
    }
  }
  double step_x = along_x.step(), step_y = along_y.step();
  for (int halvings = 0; halvings < kRefinements;) {
    const double from_x = x, from_y = y;
    bool rises = false;
    for (const int i : {-1, 0, 1}) {
      for (const int j : {-1, 0, 1}) {
        const double at_y = from_y + j * step_y;
        if ((i || j) && at_y >= along_y.first && at_y <= along_y.last) {
          rises |= try_at(from_x + i * step_x, at_y);
        }
      }
    }
    if (rises) continue;
    step_x /= 2.0;
    step_y /= 2.0;
    ++halvings;
  }
  return best;
}

}  // namespace

SeatedPlay find_seated_play(const ContactModel& model, const LatchSet& latches) {
  DOCK_ASSERT(model.rings);
  SeatedRings rings(model, latches);
  SeatedPlay play;
  play.overlap = std::max(0.0, -rings.find_gap_at(0.0, 0.0, 0.0));
  if (play.overlap > 0.0) return play;
  play.striker_opening = rings.find_striker_opening();
  play.least_roll = rings.find_roll(-1.0);
  play.most_roll = rings.find_roll(1.0);
  const Samples directions{0.0, 2.0 * kHalfTurn, kDirections + 1};
  const auto lateral = [&](double direction, double) { return rings.find_lateral(direction, 0.0); };
  play.most_lateral = find_highest(directions, {}, lateral);
  play.least_lateral = -find_highest(
      directions, {}, [&](double direction, double) { return -lateral(direction, 0.0); });
  // Lateral motion and roll both move strikers from their hooks; one limits the other.
  play.striker_offset = find_highest(
      directions, {play.least_roll, play.most_roll, kRolls},
      [&](double direction, double roll) { return rings.find_striker_offset(direction, roll); });
  return play;
}

}  // namespace dockloop
