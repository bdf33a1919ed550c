// Arithmetic of legs in lanes; see leg_lanes.hpp. Included once per instruction set, with LANES
// (lanes in a register) and FUNCTIONS (name of the table) defined. Includes nothing of a library:
// what a library defines inline could be merged with copies for other instruction sets.
//
// Formulas: universal joint about y and z, slide along x, cut at (xi, dy, dz) in rod axes;
// src/kernels/README.md derives them.
namespace dockloop::legs {
namespace {

typedef double Lanes __attribute__((vector_size(8 * LANES)));
typedef long long Mask __attribute__((vector_size(8 * LANES)));

inline Lanes take_root(Lanes x) {
  Lanes root;
  for (int i = 0; i < LANES; ++i) root[i] = __builtin_sqrt(x[i]);
  return root;
}

struct V {
  Lanes x, y, z;
};
inline V operator+(V a, V b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline V operator-(V a, V b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline V operator*(Lanes f, V a) { return {f * a.x, f * a.y, f * a.z}; }
inline Lanes dot(V a, V b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline V cross(V a, V b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// By columns.
struct M {
  V x, y, z;
};
inline V operator*(const M& m, V a) { return a.x * m.x + a.y * m.y + a.z * m.z; }
inline V turn_back(const M& m, V a) { return {dot(m.x, a), dot(m.y, a), dot(m.z, a)}; }
inline M operator*(const M& a, const M& b) { return {a * b.x, a * b.y, a * b.z}; }
inline M transpose(const M& m) {
  return {{m.x.x, m.y.x, m.z.x}, {m.x.y, m.y.y, m.z.y}, {m.x.z, m.y.z, m.z.z}};
}

/// Symmetric.
struct Sym {
  Lanes xx, yy, zz, xy, xz, yz;
};
inline Sym operator+(Sym a, Sym b) {
  return {a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
}
inline V operator*(const Sym& s, V a) {
  return {s.xx * a.x + s.xy * a.y + s.xz * a.z, s.xy * a.x + s.yy * a.y + s.yz * a.z,
          s.xz * a.x + s.yz * a.y + s.zz * a.z};
}
/// R s R^T
inline Sym turn(const M& R, const Sym& s) {
  const V x = {s.xx, s.xy, s.xz}, y = {s.xy, s.yy, s.yz}, z = {s.xz, s.yz, s.zz};
  const M half = {R * x, R * y, R * z};  // R s
  const M rows = transpose(R);
  const V a = half * rows.x, b = half * rows.y;
  return {a.x, b.y, half.x.z * R.x.z + half.y.z * R.y.z + half.z.z * R.z.z, a.y, a.z, b.z};
}

/// One register's worth of rows.
struct Cells {
  double (*row)[kGroup];
  int at;
  Lanes get(int i) const { return *reinterpret_cast<const Lanes*>(&row[i][at]); }
  V get_vector(int i) const { return {get(i), get(i + 1), get(i + 2)}; }
  M get_matrix(int i) const { return {get_vector(i), get_vector(i + 3), get_vector(i + 6)}; }
  Sym get_symmetric(int i) const {
    return {get(i), get(i + 1), get(i + 2), get(i + 3), get(i + 4), get(i + 5)};
  }
  void put(int i, Lanes x) const { *reinterpret_cast<Lanes*>(&row[i][at]) = x; }
  void put(int i, V v) const { put(i, v.x), put(i + 1, v.y), put(i + 2, v.z); }
  void put(int i, const M& m) const { put(i, m.x), put(i + 3, m.y), put(i + 6, m.z); }
  void put(int i, const Sym& s) const {
    put(i, s.xx), put(i + 1, s.yy), put(i + 2, s.zz);
    put(i + 3, s.xy), put(i + 4, s.xz), put(i + 5, s.yz);
  }
  void add(int i, Lanes x) const { put(i, get(i) + x); }
  void add(int i, V v) const { add(i, v.x), add(i + 1, v.y), add(i + 2, v.z); }
  void add(int i, const M& m) const { add(i, m.x), add(i + 3, m.y), add(i + 6, m.z); }
  void add(int i, const Sym& s) const {
    add(i, s.xx), add(i + 1, s.yy), add(i + 2, s.zz);
    add(i + 3, s.xy), add(i + 4, s.xz), add(i + 5, s.yz);
  }
};

inline Lanes spread(double x) { return x - Lanes{}; }
inline V spread3(const double* x) { return {spread(x[0]), spread(x[1]), spread(x[2])}; }

/// Sums of rows over the lanes of a group, in one order for every instruction set.
inline void add_lanes(const double (*row)[kGroup], int count, double* sums) {
  for (int i = 0; i < count; ++i) {
    const double* x = row[i];
    sums[i] = ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));
  }
}

bool is_below(Lanes a, Lanes b) {  // in any lane; true for what is not a number
  const Mask fine = a >= b;
  long long all = -1;
  for (int i = 0; i < LANES; ++i) all &= fine[i];
  return all == 0;
}

template <bool kMoving>
bool calc_group_position(LegGroup& group, int at, const M& R, V p, Lanes limit,
                         double (*sum)[kGroup]) {
  const Cells in{group.parameter, at};
  const Cells work{group.work, at};
  const Cells total{sum, at};
  // Where the tip must be, and the joint angles that bring it there.                 [Y2 (9a)]
  const M K = in.get_matrix(kAxesK);
  const M KC = {turn_back(K, R.x), turn_back(K, R.y), turn_back(K, R.z)};  // C in K
  const V s = in.get_vector(kRing), d0 = in.get_vector(kTip);
  const V L = turn_back(K, p) - in.get_vector(kCentreK) + KC * s;
  const Lanes square = dot(L, L);
  const Lanes xi2 = square - d0.y * d0.y - d0.z * d0.z;
  const Lanes X2 = L.x * L.x + L.z * L.z - d0.z * d0.z;
  const Lanes least = limit * limit * square;
  if (is_below(xi2, least) || is_below(X2, least)) return false;
  const Lanes xi = in.get(kElbow) * take_root(xi2), X = in.get(kFlip) * take_root(X2);
  const Lanes in_plane = 1.0 / (xi2 + d0.y * d0.y), across = 1.0 / (X2 + d0.z * d0.z);
  const Lanes c2 = (xi * X + d0.y * L.y) * in_plane, s2 = (xi * L.y - d0.y * X) * in_plane;
  const Lanes c1 = (X * L.x + d0.z * L.z) * across, s1 = (d0.z * L.x - X * L.z) * across;
  const M E = {{c1 * c2, s2, -s1 * c2}, {-c1 * s2, c2, s1 * s2}, {s1, Lanes{}, c1}};  // in K
  const M EC = {turn_back(KC, E.x), turn_back(KC, E.y), turn_back(KC, E.z)};
  const Lanes slide = xi - d0.x;

  // Tube and rod about the centre, E.
  const V h2 = in.get_vector(kTube), h3_0 = in.get_vector(kRod + 1);
  const Lanes m3 = in.get(kRod);
  const V h3 = {h3_0.x + m3 * slide, h3_0.y, h3_0.z};
  Sym J = in.get_symmetric(kTube + 3) + in.get_symmetric(kRod + 4);
  const Lanes spread_x = slide * (h3_0.x + h3.x);
  J.yy += spread_x;
  J.zz += spread_x;
  J.xy -= slide * h3.y;
  J.xz -= slide * h3.z;
  const V h = h2 + h3;

  // Inertia in the joint coordinates, inverse of the loop matrix, apparent inertia at the tip.
  const Lanes A11 = in.get(kCross + 5) + s2 * s2 * J.xx + 2.0 * s2 * c2 * J.xy + c2 * c2 * J.yy;
  const Lanes A12 = s2 * J.xz + c2 * J.yz, A22 = J.zz, A13 = c2 * h3.z, A23 = -h3.y, A33 = m3;
  const Lanes k2 = 1.0 / xi;
  const Lanes k1z = 1.0 / (s2 * d0.y - c2 * xi);
  const Lanes k2z = k2 * s2 * d0.z * k1z;
  const Lanes k3y = d0.y * k2, k3z = d0.y * k2z - c2 * d0.z * k1z;
  const V wy = {A12 * k2 + A13 * k3y, A22 * k2 + A23 * k3y, A23 * k2 + A33 * k3y};
  const V wz = {A11 * k1z + A12 * k2z + A13 * k3z, A12 * k1z + A22 * k2z + A23 * k3z,
                A13 * k1z + A23 * k2z + A33 * k3z};
  const Sym apparent = {A33, k2 * wy.y + k3y * wy.z, k1z * wz.x + k2z * wz.y + k3z * wz.z,
                        wy.z, wz.z, k1z * wy.x + k2z * wy.y + k3z * wy.z};

  work.put(kAxesC, EC);
  work.put(kSine, s2);
  work.put(kCosine, c2);
  work.put(kXi, xi);
  work.put(kSlide, slide);
  work.put(kInverse, k1z);
  work.put(kInverse + 1, k2);
  work.put(kInverse + 2, k2z);
  work.put(kInverse + 3, k3y);
  work.put(kInverse + 4, k3z);
  work.put(kMoment, h);
  work.put(kRodMoment, h3);
  work.put(kInertia, J);
  work.put(kApparent, apparent);

  const Sym A = turn(EC, apparent);
  const M columns = {{A.xx, A.xy, A.xz}, {A.xy, A.yy, A.yz}, {A.xz, A.yz, A.zz}};
  const M K_ = {cross(s, columns.x), cross(s, columns.y), cross(s, columns.z)};
  const M rows = transpose(K_);
  const V Dx = cross(s, rows.x), Dy = cross(s, rows.y), Dz = cross(s, rows.z);
  total.add(kSumA, A);
  total.add(kSumK, K_);
  total.add(kSumD, Sym{Dx.x, Dy.y, Dz.z, Dx.y, Dx.z, Dy.z});
  if constexpr (kMoving) {
    // The whole leg as one rigid body, and the momentum that its joints carry.
    const M EP = K * E;
    const V h1 = in.get_vector(kCross + 1);
    const Sym J1 = in.get_symmetric(kCross + 4);
    const V h1E = {c2 * h1.x + s2 * h1.y, c2 * h1.y - s2 * h1.x, h1.z};
    const Lanes cc = c2 * c2, ss = s2 * s2, cs = c2 * s2, between = 2.0 * cs * J1.xy;
    const Sym J1E = {cc * J1.xx + between + ss * J1.yy,
                     ss * J1.xx - between + cc * J1.yy,
                     J1.zz,
                     cs * (J1.yy - J1.xx) + (cc - ss) * J1.xy,
                     c2 * J1.xz + s2 * J1.yz,
                     c2 * J1.yz - s2 * J1.xz};
    const V ht = h + h1E;
    const Sym Jt = J + J1E;
    const V e1 = {s2, c2, Lanes{}};
    const V f1 = cross(e1, ht), n1 = Jt * e1;
    const V f2 = {-h.y, h.x, Lanes{}}, n2 = {J.xz, J.yz, J.zz};
    const V f3 = {m3, Lanes{}, Lanes{}}, n3 = {Lanes{}, h3.z, -h3.y};
    const M linear = {f3, k2 * f2 + k3y * f3, k1z * f1 + k2z * f2 + k3z * f3};
    const M angular = {n3, k2 * n2 + k3y * n3, k1z * n1 + k2z * n2 + k3z * n3};
    work.put(kAxesP, EP);
    work.put(kCarried, linear);
    work.put(kCarried + 9, angular);
    const V centre = in.get_vector(kCentre);
    const M lE = EP * linear;
    const M aE0 = EP * angular;
    const M aE = {aE0.x + cross(centre, lE.x), aE0.y + cross(centre, lE.y),
                  aE0.z + cross(centre, lE.z)};
    // Rows of (EP linear) EC^T, and what a turn of C about its origin moves at the tip.
    const M CE = transpose(EC);
    const M lV = transpose(lE * CE), aV = transpose(aE * CE);  // columns are rows of the product
    total.add(kSumLV, lV);
    total.add(kSumLW, M{cross(s, lV.x), cross(s, lV.y), cross(s, lV.z)});
    total.add(kSumAV, aV);
    total.add(kSumAW, M{cross(s, aV.x), cross(s, aV.y), cross(s, aV.z)});
    const Lanes mass = in.get(kCross) + in.get(kTubeMass) + m3;
    const V hP = EP * ht;
    Sym JP = turn(EP, Jt);
    const Lanes trace = 2.0 * dot(centre, hP) + mass * dot(centre, centre);
    const V q = hP + hP + mass * centre;
    JP.xx += trace - centre.x * q.x;
    JP.yy += trace - centre.y * q.y;
    JP.zz += trace - centre.z * q.z;
    JP.xy -= centre.x * hP.y + centre.y * (hP.x + mass * centre.x);
    JP.xz -= centre.x * hP.z + centre.z * (hP.x + mass * centre.x);
    JP.yz -= centre.y * hP.z + centre.z * (hP.y + mass * centre.y);
    total.add(kSumH, hP + mass * centre);
    total.add(kSumJ, JP);
  }
  return true;
}

template <bool kMoving>
bool calc_all_positions(LegGroup* groups, int count, const Platform& platform, double limit,
                        double* sums) {
  constexpr int kSums = kMoving ? kPositionSums : kFixedSums;
  alignas(64) double sum[kSums][kGroup] = {};
  const M R = {spread3(platform.R), spread3(platform.R + 3), spread3(platform.R + 6)};
  const V p = spread3(platform.p);
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      if (!calc_group_position<kMoving>(groups[g], at, R, p, spread(limit), sum)) return false;
    }
  }
  add_lanes(sum, kSums, sums);
  return true;
}

bool calc_position(LegGroup* groups, int count, const Platform& platform, bool moving, double limit,
                   double* sums) {
  return moving ? calc_all_positions<true>(groups, count, platform, limit, sums)
                : calc_all_positions<false>(groups, count, platform, limit, sums);
}

void calc_rates(LegGroup* groups, int count, const Platform& platform) {
  const V v = spread3(platform.v), w = spread3(platform.w);
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells in{groups[g].parameter, at};
      const Cells work{groups[g].work, at};
      const V tip = v + cross(w, in.get_vector(kRing));
      const V y = turn_back(work.get_matrix(kAxesC), tip);
      work.put(kRate, work.get(kInverse) * y.z);
      work.put(kRate + 1, work.get(kInverse + 1) * y.y + work.get(kInverse + 2) * y.z);
      work.put(kRate + 2, y.x + work.get(kInverse + 3) * y.y + work.get(kInverse + 4) * y.z);
      work.put(kTipC, cross(w, tip));
    }
  }
}

template <bool kMoving>
void calc_all_biases(LegGroup* groups, int count, const Platform& platform, double* sums) {
  constexpr int kSums = kMoving ? kBiasSums : kFixedBiasSums;
  alignas(64) double sum[kSums][kGroup] = {};
  for (int g = 0; g < count; ++g) {
    for (int at = 0; at < kGroup; at += LANES) {
      const Cells in{groups[g].parameter, at};
      const Cells work{groups[g].work, at};
      const Cells total{sum, at};
      const Lanes s2 = work.get(kSine), c2 = work.get(kCosine), xi = work.get(kXi);
      const V rate = work.get_vector(kRate);
      const V d0 = in.get_vector(kTip), d = {xi, d0.y, d0.z};
      const V h = work.get_vector(kMoment), h3 = work.get_vector(kRodMoment);
      const Sym J = work.get_symmetric(kInertia);
      const M EC = work.get_matrix(kAxesC);
      // Motion relative to P at zero joint accelerations.
      const V w = {s2 * rate.x, c2 * rate.x, rate.y};
      const Lanes both = rate.x * rate.y;
      const V alpha = {c2 * both, -s2 * both, Lanes{}};
      const Lanes twice = 2.0 * rate.z;
      const V slip = {Lanes{}, twice * w.z, -(twice * w.y)};
      const V bias = cross(alpha, d) + cross(w, cross(w, d)) + slip;
      V nu, F = {}, N = {};
      if constexpr (!kMoving) {
        const V moment = J * alpha + cross(w, J * w) + cross(h3, slip);
        const V wh3 = cross(w, h3);
        nu = {s2 * moment.x + c2 * moment.y, moment.z,
              alpha.y * h3.z - alpha.z * h3.y + w.y * wh3.z - w.z * wh3.y};
      } else {
        // The same with the motion of P, and the load on it.
        const V root = spread3(platform.root);
        const M EP = work.get_matrix(kAxesP);
        const V w0 = turn_back(EP, root), e1 = {s2, c2, Lanes{}};
        const V centre = in.get_vector(kCentre);
        const V a0 = turn_back(EP, cross(root, cross(root, centre)));
        const V w1 = w0 + rate.x * e1, alpha1 = rate.x * cross(w0, e1);
        const V w2 = {w1.x, w1.y, w1.z + rate.y};
        const V alpha2 = {alpha1.x + w1.y * rate.y, alpha1.y - w1.x * rate.y, alpha1.z};
        const V slip2 = {Lanes{}, twice * w2.z, -(twice * w2.y)};
        const Lanes m3 = in.get(kRod);
        F = (in.get(kTubeMass) + m3) * a0 + cross(alpha2, h) + cross(w2, cross(w2, h)) +
            m3 * slip2;
        N = J * alpha2 + cross(w2, J * w2) + cross(h, a0) + cross(h3, slip2);
        const V wh3 = cross(w2, h3);
        const Lanes axial = m3 * a0.x + alpha2.y * h3.z - alpha2.z * h3.y + w2.y * wh3.z -
                            w2.z * wh3.y;
        // The cross, in axes turned by the first joint only.
        const auto unturn = [&](V a) {
          return V{c2 * a.x - s2 * a.y, s2 * a.x + c2 * a.y, a.z};
        };
        const auto turn_z = [&](V a) {
          return V{c2 * a.x + s2 * a.y, c2 * a.y - s2 * a.x, a.z};
        };
        const V wY = unturn(w1), alphaY = unturn(alpha1), aY = unturn(a0);
        const V h1 = in.get_vector(kCross + 1);
        const Sym J1 = in.get_symmetric(kCross + 4);
        const V F1 = in.get(kCross) * aY + cross(alphaY, h1) + cross(wY, cross(wY, h1));
        const V N1 = J1 * alphaY + cross(wY, J1 * wY) + cross(h1, aY);
        nu = {s2 * N.x + c2 * N.y + N1.y, N.z, axial};
        F = F + turn_z(F1);
        N = N + turn_z(N1);
      }
      const V z = turn_back(EC, work.get_vector(kTipC)) - bias;
      const V force = work.get_vector(kForce), left = nu - force;
      const V b0 = work.get_symmetric(kApparent) * z;
      const Lanes k1z = work.get(kInverse), k2 = work.get(kInverse + 1),
                  k2z = work.get(kInverse + 2), k3y = work.get(kInverse + 3),
                  k3z = work.get(kInverse + 4);
      const V b = {b0.x + left.z, b0.y + k2 * left.y + k3y * left.z,
                   b0.z + k1z * left.x + k2z * left.y + k3z * left.z};
      work.put(kTipForce, b);
      const V bC = EC * b;
      total.add(kSumTipForce, bC);
      total.add(kSumTipMoment, cross(in.get_vector(kRing), bC));
      if constexpr (kMoving) {
        const M EP = work.get_matrix(kAxesP);
        const V fP = EP * (F + work.get_matrix(kCarried) * z);
        const V nP = EP * (N + work.get_matrix(kCarried + 9) * z);
        total.add(kSumRootForce, fP);
        total.add(kSumRootMoment, nP + cross(in.get_vector(kCentre), fP));
      }
    }
  }
  add_lanes(sum, kSums, sums);
}

void calc_bias(LegGroup* groups, int count, const Platform& platform, bool moving, double* sums) {
  if (moving) return calc_all_biases<true>(groups, count, platform, sums);
  calc_all_biases<false>(groups, count, platform, sums);
}

}  // namespace

const LegFunctions FUNCTIONS = {calc_position, calc_rates, calc_bias, NAME};

}  // namespace dockloop::legs
