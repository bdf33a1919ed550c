// The stages of legs in lanes; see leg_lanes.hpp. Included once per instruction set, with LANES
// (lanes in a register) defined.
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

/// Call work(in, work, at, type) for each register that has a leg. @return false as soon as it does
template <class Work>
bool visit_registers(LegGroup* groups, int count, const Work& work) {
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < groups[g].legs; at += LANES) {
      const Cells in{{groups[g].parameter, at}}, cells{{groups[g].work, at}};
      if (!work(in, cells, at, groups[g].type)) return false;
    }
  }
  return true;
}

/// Call work(leg, in, work, at), with a leg of the kind of the register. @return as above
template <class Work>
bool visit_legs(LegGroup* groups, int count, const Work& work) {
  return visit_registers(
      groups, count, [&](const Cells& in, const Cells& cells, int at, LegType type) {
        return visit_leg<Lanes, Lanes>(type, [&](auto leg) { return work(leg, in, cells, at); });
      });
}

template <bool kMoving>
bool calc_all_positions(LegGroup* groups, int count, const PlatformMotion<double>& platform,
                        double least, double* sums) {
  constexpr int kSums = kMoving ? kPositionSums : kFixedSums;
  alignas(64) double sum[kSums][kSumLanes];
  __builtin_memset(sum, 0, sizeof sum);
  const M R = spread9<Lanes>(platform.R);
  const V p = spread3(platform.p);
  const bool fine =
      visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
        return calc_leg_position<kMoving>(leg, in, work, Sums{{sum, at}}, R, p, least) ==
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
  visit_registers(groups, count, [&](const Cells&, const Cells& work, int, LegType) {
    work.put(kAngles + joint, find_angle(work.get_turn(kTurns + 2 * joint)));
    return true;
  });
}

void calc_rates(LegGroup* groups, int count, const PlatformMotion<double>& platform) {
  visit_registers(groups, count, [&](const Cells& in, const Cells& work, int, LegType) {
    calc_leg_rates<Lanes>(in, work, platform);
    return true;
  });
}

template <bool kMoving>
void calc_all_biases(LegGroup* groups, int count, const PlatformMotion<double>& platform,
                     double* sums) {
  constexpr int kSums = kMoving ? kBiasSums : kFixedBiasSums;
  alignas(64) double sum[kSums][kSumLanes];
  __builtin_memset(sum, 0, sizeof sum);
  visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
    calc_leg_bias<kMoving>(leg, in, work, Sums{{sum, at}}, platform);
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
  alignas(64) double sum[kLoadSums][kSumLanes];
  __builtin_memset(sum, 0, sizeof sum);
  visit_legs(groups, count, [&](auto leg, const Cells& in, const Cells& work, int at) {
    calc_leg_loads(leg, in, work, Sums{{sum, at}}, platform);
    return true;
  });
  add_lanes(sum, kLoadSums, sums);
}

constexpr LegFunctions kFunctions = {calc_position, calc_angles, calc_rates, calc_bias, calc_loads};

}  // namespace

}  // namespace dockloop::legs
