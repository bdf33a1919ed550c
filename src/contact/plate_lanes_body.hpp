// Plates in SIMD lanes; see plate_lanes.hpp. Included once per instruction set, with LANES (lanes
// in a register) defined.
#include "contact/plate_lanes.hpp"
#include "math/lane_arithmetic.hpp"

namespace dockloop::plates {
namespace {

using namespace lanes;

/// Edges of a plate, one per lane: rows of begin (3) and direction (3).
struct alignas(64) EdgeRows {
  double row[6][kGroup];
  V get_begin(int at) const { return {get(0, at), get(1, at), get(2, at)}; }
  V get_direction(int at) const { return {get(3, at), get(4, at), get(5, at)}; }
  Lanes get(int i, int at) const { return *reinterpret_cast<const Lanes*>(&row[i][at]); }
};

/// @param first, each  lane l has edge first + l/each, modulo 4
EdgeRows spread_edges(const PlateNumbers& plate, int first, int each) {
  EdgeRows edges;
  for (int lane = 0; lane < kGroup; ++lane) {
    const int k = (first + lane / each) % 4;
    for (int i = 0; i < 3; ++i) {
      edges.row[i][lane] = plate.corner[k][i];
      edges.row[3 + i][lane] = plate.edge[k][i];
    }
  }
  return edges;
}

Lanes clamp_unit(Lanes x) {
  const Lanes zero{}, one = spread(1.0);
  const Lanes above = x > zero ? x : zero;
  return above < one ? above : one;
}

/// Candidates of one register: points on both plates and regularised squares.
struct Candidates {
  V first, second;
  Lanes square;
};

Lanes find_square(const V& p, const V& q, const V& cp, const V& cq, Lanes mu) {
  const V pq = p - q, p0 = p - cp, q0 = q - cq;
  return dot(pq, pq) + mu * (dot(p0, p0) + dot(q0, q0));
}

/// As find_segment_segment().
Candidates find_edges(const V& p0, const V& dp, const V& cp, const V& q0, const V& dq, const V& cq,
                      Lanes mu) {
  const Lanes zero{}, one = spread(1.0);
  const V r = p0 - q0;
  const Lanes a = (1.0 + mu) * dot(dp, dp), e = (1.0 + mu) * dot(dq, dq), b = dot(dp, dq);
  const Lanes g = mu * dot(dp, cp - p0) - dot(dp, r), h = mu * dot(dq, cq - q0) + dot(dq, r);
  const Lanes det = a * e - b * b;
  const Lanes s0 = det > zero ? clamp_unit((g * e + b * h) / det) : spread(0.5);
  const Lanes t0 = (h + b * s0) / e;
  const Mask before = t0<zero, behind = t0> one;
  const Lanes t = before ? zero : (behind ? one : t0);
  const Lanes s1 = clamp_unit((g + b * t) / a);
  const Lanes s = (before | behind) ? s1 : s0;
  const V p = p0 + s * dp, q = q0 + t * dq;
  return {p, q, find_square(p, q, cp, cq, mu)};
}

/// As find_face_segment(): the face of A and edges q0 + t d of a plate with centre cq.
/// @param[out] inside  the point of the plane belongs to the face
Candidates find_face(const PlateNumbers& A, const V& q0, const V& d, const V& cq, Lanes mu,
                     Mask& inside) {
  const Lanes zero{};
  const V centre = spread3(A.centre), normal = spread3(A.normal), u = q0 - centre;
  const Lanes m = mu / (1.0 + mu), height = dot(normal, u), slope = dot(normal, d);
  const Lanes linear = height * slope + m * (dot(u, d) - height * slope) + mu * dot(d, q0 - cq);
  const Lanes dd = dot(d, d);
  const Lanes t = clamp_unit(-linear / (slope * slope + m * (dd - slope * slope) + mu * dd));
  const V q = q0 + t * d, w = q - centre;
  const V p = centre + (1.0 / (1.0 + mu)) * (w - dot(normal, w) * normal);
  inside = zero <= zero;
  for (int k = 0; k < 4; ++k) {
    inside &= dot(spread3(A.inward[k]), p - spread3(A.corner[k])) >= zero;
  }
  return {p, q, find_square(p, q, centre, cq, mu)};
}

/// The first least of the candidates so far.
struct Best {
  PlateCandidate least{{}, {}, 1e300};
  void add(const Candidates& from, Mask counts, int lanes, bool swapped) {
    for (int i = 0; i < lanes; ++i) {
      if (!counts[i] || !(from.square[i] < least.square)) continue;
      const V &p = swapped ? from.second : from.first, &q = swapped ? from.first : from.second;
      least = {{p.x[i], p.y[i], p.z[i]}, {q.x[i], q.y[i], q.z[i]}, from.square[i]};
    }
  }
};

PlateCandidate find(const PlateNumbers& P, const PlateNumbers& Q, double regularisation) {
  constexpr int kFour = LANES < 4 ? LANES : 4;  // lanes of a register with different edges
  const Lanes mu = spread(regularisation), zero{};
  const Mask all = zero <= zero;
  const V cp = spread3(P.centre), cq = spread3(Q.centre);
  const EdgeRows of_P = spread_edges(P, 0, 1), of_Q = spread_edges(Q, 0, 1);
  Best best;
  for (int first = 0; first < 4; first += 2) {  // two edges of P with all of Q
    const EdgeRows pair = spread_edges(P, first, 4);
    for (int at = 0; at < kGroup; at += LANES) {
      best.add(find_edges(pair.get_begin(at), pair.get_direction(at), cp, of_Q.get_begin(at),
                          of_Q.get_direction(at), cq, mu),
               all, LANES, false);
    }
  }
  for (int at = 0; at < 4; at += LANES) {
    Mask inside;
    const Candidates face =
        find_face(P, of_Q.get_begin(at), of_Q.get_direction(at), cq, mu, inside);
    best.add(face, inside, kFour, false);
  }
  for (int at = 0; at < 4; at += LANES) {
    Mask inside;
    const Candidates face =
        find_face(Q, of_P.get_begin(at), of_P.get_direction(at), cp, mu, inside);
    best.add(face, inside, kFour, true);
  }
  return best.least;
}

constexpr PlateFunctions kFunctions = {find};

}  // namespace

}  // namespace dockloop::plates
