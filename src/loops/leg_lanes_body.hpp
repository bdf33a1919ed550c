// The stages of legs in lanes; see leg_lanes.hpp. Included once per instruction set, with LANES
// (lanes in a register), FUNCTIONS (name of the table) and NAME defined.
//
// Stages are flattened: vectors that pass through memory on calls cost a tenth.
#include "loops/leg_lanes.hpp"
#include "math/lane_arithmetic.hpp"

namespace dockloop::legs {
namespace {

/// Far enough from a singular pose in every lane? (False for what is not a number.)
inline Reached find_reached(lanes::Lanes square, lanes::Lanes of, double least) {
  return lanes::has_any(~(square >= least * of)) ? Reached::kNo : Reached::kYes;
}

}  // namespace
}  // namespace dockloop::legs

#include "loops/leg_stages.hpp"

namespace dockloop::legs {
namespace {

/// Call work(leg, in, work, at) for the legs of all registers, with a leg of their kind.
/// @return false as soon as a call does
template <class Work>
bool visit_legs(LegGroup* groups, int count, const Work& work) {
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells in{{groups[g].parameter, at}}, cells{{groups[g].work, at}};
      const bool fine = visit_leg<Lanes, Lanes>(groups[g].type,
                                                [&](auto leg) { return work(leg, in, cells, at); });
      if (!fine) return false;
    }
  }
  return true;
}

template <bool kMoving>
bool calc_all_positions(LegGroup* groups, int count, const PlatformMotion<double>& platform,
                        double least, double* sums) {
  constexpr int kSums = kMoving ? kPositionSums : kFixedSums;
  alignas(64) double sum[kSums][kGroup] = {};
  const M R = spread9<Lanes>(platform.R);
  const V p = spread3(platform.p);
  const bool fine =
      visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
        return calc_leg_position<kMoving>(leg, in, work, Cells{{sum, at}}, R, p, least) ==
               Reached::kYes;
      });
  if (fine) add_lanes(sum, kSums, sums);
  return fine;
}

[[gnu::flatten]] bool calc_position(LegGroup* groups, int count,
                                    const PlatformMotion<double>& platform, bool moving,
                                    double least, double* sums) {
  return moving ? calc_all_positions<true>(groups, count, platform, least, sums)
                : calc_all_positions<false>(groups, count, platform, least, sums);
}

void calc_angles(LegGroup* groups, int count, int joint) {
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells work{{groups[g].work, at}};
      work.put(kAngles + joint, find_angle(work.get_turn(kTurns + 2 * joint)));
    }
  }
}

void calc_rates(LegGroup* groups, int count, const PlatformMotion<double>& platform) {
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      calc_leg_rates<Lanes>(Cells{{groups[g].parameter, at}}, Cells{{groups[g].work, at}},
                            platform);
    }
  }
}

template <bool kMoving>
void calc_all_biases(LegGroup* groups, int count, const PlatformMotion<double>& platform,
                     double* sums) {
  constexpr int kSums = kMoving ? kBiasSums : kFixedBiasSums;
  alignas(64) double sum[kSums][kGroup] = {};
  visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
    calc_leg_bias<kMoving>(leg, in, work, Cells{{sum, at}}, platform);
    return true;
  });
  add_lanes(sum, kSums, sums);
}

[[gnu::flatten]] void calc_bias(LegGroup* groups, int count, const PlatformMotion<double>& platform,
                                bool moving, double* sums) {
  if (moving) return calc_all_biases<true>(groups, count, platform, sums);
  calc_all_biases<false>(groups, count, platform, sums);
}

[[gnu::flatten]] void calc_loads(LegGroup* groups, int count,
                                 const PlatformMotion<double>& platform, double* sums) {
  alignas(64) double sum[kLoadSums][kGroup] = {};
  visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
    calc_leg_loads(leg, in, work, Cells{{sum, at}}, platform);
    return true;
  });
  add_lanes(sum, kLoadSums, sums);
}

}  // namespace

const LegFunctions FUNCTIONS = {calc_position, calc_angles, calc_rates,
                                calc_bias,     calc_loads,  NAME};

}  // namespace dockloop::legs
