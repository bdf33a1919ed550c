// The numbers of the legs of a platform, one leg after another: for scalars that are not doubles
// (leg_lanes.hpp has those side by side). And views of such numbers as vectors and matrices.
#pragma once

#include <algorithm>

#include "loops/leg_platforms.hpp"
#include "loops/leg_stages.hpp"

namespace dockloop {

namespace {

template <class S>
Eigen::Map<Vec3<S>> as_vector(S* x) {
  return Eigen::Map<Vec3<S>>(x);
}
template <class S>
Eigen::Map<const Vec3<S>> as_vector(const S* x) {
  return Eigen::Map<const Vec3<S>>(x);
}
template <class S>
Eigen::Map<const Mat3<S>> as_columns(const S* x) {
  return Eigen::Map<const Mat3<S>>(x);
}
template <class S>
Mat3<S> get_rows(const S* x) {
  return Eigen::Map<const Mat3<S>>(x).transpose();
}
template <class S>
Mat3<S> get_symmetric(const S* s) {
  Mat3<S> m;
  m << s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2];
  return m;
}

}  // namespace

template <class S>
void LegStore<S>::add(LegPlace& place) {
  place.group = legs_.size();
  legs_.emplace_back();
  legs_.back().type = place.type;
}

namespace {

// The stages for one leg. N is the number of its constants.

template <class N, class S>
bool calc_one_position(legs::LegType type, const N* parameter, S* one,
                       const legs::PlatformMotion<S>& at, bool moving, double least, S* sums) {
  const lanes::CellsOf<lanes::OneByOne<const N>> in{{parameter}};
  const lanes::CellsOf<lanes::OneByOne<S>> work{{one}};
  const lanes::SumsOf<lanes::OneByOne<S>> total{{sums}};
  const lanes::Matrix<S> R = lanes::spread9<S>(at.R);
  const lanes::Vector<S> p = lanes::spread3<S>(at.p);
  const legs::Reached reached = legs::visit_leg<N, S>(type, [&](auto leg) {
    return moving ? legs::calc_leg_position<true>(leg, in, work, total, R, p, least)
                  : legs::calc_leg_position<false>(leg, in, work, total, R, p, least);
  });
  if (reached != legs::Reached::kYes) return false;
  for (int i = legs::kReach; i < legs::kReach + 4; i += 2) {
    if (!(to_double(one[i]) >= least * to_double(one[i + 1]))) return false;
  }
  return true;
}

template <class N, class S>
void calc_one_bias(legs::LegType type, const N* parameter, S* one,
                   const legs::PlatformMotion<S>& at, bool moving, S* sums) {
  const lanes::CellsOf<lanes::OneByOne<const N>> in{{parameter}};
  const lanes::CellsOf<lanes::OneByOne<S>> work{{one}};
  const lanes::SumsOf<lanes::OneByOne<S>> total{{sums}};
  legs::visit_leg<N, S>(type, [&](auto leg) {
    if (moving) return legs::calc_leg_bias<true>(leg, in, work, total, at);
    legs::calc_leg_bias<false>(leg, in, work, total, at);
  });
}

template <class N, class S>
void calc_one_load(legs::LegType type, const N* parameter, S* one,
                   const legs::PlatformMotion<S>& at, S* sums) {
  const lanes::CellsOf<lanes::OneByOne<const N>> in{{parameter}};
  const lanes::CellsOf<lanes::OneByOne<S>> work{{one}};
  const lanes::SumsOf<lanes::OneByOne<S>> total{{sums}};
  legs::visit_leg<N, S>(type, [&](auto leg) { legs::calc_leg_loads(leg, in, work, total, at); });
}

template <class N, class S>
void calc_one_rate(const N* parameter, S* one, const legs::PlatformMotion<S>& at) {
  legs::calc_leg_rates<S>(lanes::CellsOf<lanes::OneByOne<const N>>{{parameter}},
                          lanes::CellsOf<lanes::OneByOne<S>>{{one}}, at);
}

}  // namespace

template <class S>
bool LegStore<S>::calc_position(const legs::PlatformMotion<S>& at, bool moving, double least,
                                S* sums) {
  std::fill_n(sums, moving ? legs::kPositionSums : legs::kFixedSums, S(0));
  for (One& one : legs_) {
    if (!calc_one_position(one.type, one.parameter, one.work, at, moving, least, sums)) {
      return false;
    }
  }
  return true;
}

template <class S>
void LegStore<S>::calc_rates(const legs::PlatformMotion<S>& at) {
  for (One& one : legs_) calc_one_rate(one.parameter, one.work, at);
}

template <class S>
void LegStore<S>::calc_bias(const legs::PlatformMotion<S>& at, bool moving, S* sums) {
  std::fill_n(sums, moving ? legs::kBiasSums : legs::kFixedBiasSums, S(0));
  for (One& one : legs_) calc_one_bias(one.type, one.parameter, one.work, at, moving, sums);
}

template <class S>
void LegStore<S>::calc_loads(const legs::PlatformMotion<S>& at, S* sums) {
  std::fill_n(sums, legs::kLoadSums, S(0));
  for (One& one : legs_) calc_one_load(one.type, one.parameter, one.work, at, sums);
}

}  // namespace dockloop
