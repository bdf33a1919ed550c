// Smooth transition from 0 to 1: of what is switched, released or fades out.
#pragma once

#include <algorithm>

namespace dockloop {

/// The nearest number from 0 to 1.
template <class S>
S clamp_unit(const S& t) {
  return std::min<S>(std::max<S>(t, S(0)), S(1));
}

/// Share of a C1 transition, and its rate [1/s].
template <class S>
struct Ramp {
  S share, rate;
};

/// @param u  part of the duration that is over, 0 to 1. @param duration  [s]
template <class S>
Ramp<S> calc_ramp(const S& u, const S& duration) {
  return {u * u * (S(3) - S(2) * u), S(6) * u * (S(1) - u) / duration};
}

}  // namespace dockloop
