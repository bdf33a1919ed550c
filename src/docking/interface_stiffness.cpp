// Derivatives of the generalised forces, condensation, eigenvalues; see interface_stiffness.hpp.
#include "docking/interface_stiffness.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "docking/rigid_maps.hpp"
#include "math/decompositions.hpp"

namespace dockloop {
namespace {

constexpr double kLimp = 1e-10;    ///< a pivot below this part of its diagonal is rounding
constexpr double kLink = 1e6;      ///< link over mechanism, as squared frequencies
constexpr double kSlow = 1e-3;     ///< first guess: quasi-static [rad/s]
constexpr double kSettled = 1e-6;  ///< last relative change of w; two to five repetitions
constexpr int kFullSteps = 4;    ///< later repetitions are damped by one half, against oscillation
constexpr int kIterations = 30;  ///< limit: one state in a thousand does not converge

using Complex = std::complex<double>;

/// The present geometry, axes of the chaser.
struct Interface {
  Mat3<double> R;    ///< chaser to O
  Vec3<double> arm;  ///< chaser's origin to G
  Mat6<double> L;    ///< x = L xi
};

/// Leading block of the inverse of the inertia of a free vehicle with joints, axes of the vehicle.
Mat6<double> find_leading_inverse(const MechanismData<double>& at, VecX<double>& column) {
  Mat6<double> inverse;
  for (int i = 0; i < 6; ++i) {
    column.setZero();
    column[i] = 1.0;
    at.factor.solveInPlace(column);
    inverse.col(i) = column.head<6>();
  }
  return inverse;
}

/// A matrix of linear and angular parts in other axes.
Mat6<double> turn(const Mat3<double>& R, const Mat6<double>& matrix) {
  Mat6<double> both = Mat6<double>::Zero();
  both.topLeftCorner<3, 3>() = both.bottomRightCorner<3, 3>() = R;
  return both * matrix * both.transpose();
}

/// Inverse of the effective mass of relative motion at G. @param hosts  receives the part of driven
/// vehicles
Mat6<double> find_mobility(const DockingModel& model, const DockingData<double>& at,
                           const Interface& geometry, std::array<VecX<double>, 2>& column,
                           Mat6<double>& hosts) {
  Mat6<double> sum = Mat6<double>::Zero();
  hosts.setZero();
  if (model.moves[kChaser]) {
    const Mat6<double> inverse = at.locked ? make_mobility(at.locked->whole)
                                           : find_leading_inverse(at.mechanism, column[kChaser]);
    const Mat6<double> J = make_transfer(Mat3<double>::Identity(), geometry.arm);
    sum += J * inverse * J.transpose();
    if (model.driven[kChaser]) hosts = sum;
  }
  if (model.moves[kTarget]) {
    const FrameMotion<double>& target = at.vehicle[kTarget];
    const Mat3<double> R = geometry.R.transpose() * target.R;
    Mat6<double> inverse = Mat6<double>::Identity() / model.vehicle[kTarget].mass;
    inverse.bottomRightCorner<3, 3>() = R * invert(model.vehicle[kTarget].inertia) * R.transpose();
    if (at.target) inverse = turn(R, find_leading_inverse(at.target->mechanism, column[kTarget]));
    const Vec3<double> arm = geometry.R.transpose() * (at.capture.p - target.p);
    const Mat6<double> J = make_transfer(Mat3<double>::Identity(), arm);
    const Mat6<double> part = J * inverse * J.transpose();
    sum += part;
    if (model.driven[kTarget]) hosts += part;
  }
  return sum;
}

/// Puts one direction into the dual numbers of the state: a displacement, or a velocity.
class Seeds {
 public:
  Seeds(const DockingModel& model, const DockingData<double>& at, const Interface& geometry,
        const double* y, std::vector<Derivative>& seeded)
      : model_(model), at_(at), geometry_(geometry), y_(y), seeded_(seeded) {}

  void put_displacement(int direction, int lane) {
    if (direction < model_.layout.mechanism_nv) {
      return seed_displacement(model_, y_, direction, lane, seeded_);
    }
    const Twist<double> twist = find_twist(direction);
    const FrameMotion<double>& frame = at_.vehicle[mover()];
    const int pose = model_.layout.pose[mover()];
    add<3>(pose, lane, twist.v);
    const Vec4<double> q(y_[pose + 3], y_[pose + 4], y_[pose + 5], y_[pose + 6]);
    add<4>(pose + 3, lane, quat_rate<double>(q, frame.R.transpose() * twist.w));
  }

  /// Velocities of vehicles are stored as momenta.
  void put_velocity(int direction, int lane) {
    const bool with_vehicle = model_.moves[kChaser];
    const MatX<double>& A = at_.mechanism.A_ind;
    if (direction < model_.layout.mechanism_nv) {
      if (at_.locked) return;
      seeded_[model_.layout.mechanism_v + direction].d[lane] = 1.0;
      if (with_vehicle) put_momentum(kChaser, A.col(6 + direction).head<6>(), lane);
      return;
    }
    const Twist<double> twist = find_twist(direction);
    if (mover() == kChaser) {
      Vec6<double> body;
      body << geometry_.R.transpose() * twist.v, geometry_.R.transpose() * twist.w;
      const Mat6<double> inertia =
          at_.locked ? make_inertia(at_.locked->whole) : Mat6<double>(A.topLeftCorner<6, 6>());
      return put_momentum(kChaser, inertia * body, lane);
    }
    const FrameMotion<double>& target = at_.vehicle[kTarget];
    if (at_.target) {
      Vec6<double> body;
      body << target.R.transpose() * twist.v, target.R.transpose() * twist.w;
      const Mat6<double> inertia = at_.target->mechanism.A_ind.topLeftCorner<6, 6>();
      return put_momentum(kTarget, inertia * body, lane);
    }
    const Vec3<double> linear = model_.vehicle[kTarget].mass * twist.v;
    const Vec3<double> spin =
        model_.vehicle[kTarget].inertia * Vec3<double>(target.R.transpose() * twist.w);
    put_momentum(kTarget, linear, target.R * spin, lane);
  }

 private:
  /// Vehicle whose motion changes x: the target, unless it is fixed.
  int mover() const { return model_.moves[kTarget] ? kTarget : kChaser; }

  /// Motion of this vehicle for xi = 1 in this direction, axes of O.
  Twist<double> find_twist(int direction) const {
    const Vec6<double> x = geometry_.L.col(direction - model_.layout.mechanism_nv);
    const double sign = mover() == kTarget ? 1.0 : -1.0;
    const Vec3<double> w = sign * (geometry_.R * x.tail<3>());
    const Vec3<double> v = sign * (geometry_.R * x.head<3>());
    return {w, v + w.cross(at_.vehicle[mover()].p - at_.capture.p)};
  }

  /// @param momentum  about the vehicle's origin, its axes
  void put_momentum(int vehicle, const Vec6<double>& momentum, int lane) {
    const Mat3<double>& R = at_.vehicle[vehicle].R;
    put_momentum(vehicle, R * momentum.head<3>(), R * momentum.tail<3>(), lane);
  }

  /// @param spin  about the vehicle's origin; axes of O
  void put_momentum(int vehicle, const Vec3<double>& linear, const Vec3<double>& spin, int lane) {
    const int momentum = model_.layout.momentum[vehicle];
    add<3>(momentum, lane, linear);
    add<3>(momentum + 3, lane, spin + at_.vehicle[vehicle].p.cross(linear));
  }

  template <int N>
  void add(int at, int lane, const Eigen::Matrix<double, N, 1>& weights) {
    for (int i = 0; i < N; ++i) seeded_[at + i].d[lane] += weights[i];
  }

  const DockingModel& model_;
  const DockingData<double>& at_;
  const Interface& geometry_;
  const double* y_;
  std::vector<Derivative>& seeded_;
};

/// Forces of the directions seeded into columns `first` and following, with the sign of a stiffness
/// or damping: on the mechanism's coordinates, and on P about G in axes of the chaser.
void read_forces(const DockingModel& model, const Interface& geometry,
                 const DockingData<Derivative>& data, int first, int count, MatX<double>& out) {
  const int n = model.layout.mechanism_nv;
  const int skipped = static_cast<int>(data.mechanism.b_ind.size()) - n;  // the vehicle's own
  const FrameMotion<Derivative>& chaser = data.vehicle[kChaser];
  const Mat3<Derivative> R = chaser.R.transpose();
  const Vec3<Derivative> moved =
      R * (data.capture.p - chaser.p) - geometry.arm.cast<Derivative>();  // G goes with q
  Vec3<Derivative> force = R * data.on_passive.f;
  Vec3<Derivative> moment = R * data.on_passive.t + moved.cross(force);
  if (model.acts_across()) {  // it acts on the chaser itself, about A
    const Vec3<Derivative> across = R * data.on_target.f;
    const Vec3<Derivative> arm =
        R * (data.interface[kChaser].p - chaser.p) - geometry.arm.cast<Derivative>();
    force += across;
    moment += R * data.on_target.t + arm.cross(across);
  }
  for (int lane = 0; lane < count; ++lane) {
    for (int i = 0; i < n; ++i) {
      out(i, first + lane) = -data.mechanism.b_ind[skipped + i].d[lane];
    }
    Vec6<double> load;
    for (int i = 0; i < 3; ++i) {
      load[i] = force[i].d[lane];
      load[3 + i] = moment[i].d[lane];
    }
    out.col(first + lane).tail<6>() = -(geometry.L.transpose() * load);
  }
}

/// C, motion of G, and rates of the bristles.
Status calc_damping(const DockingModel& model, const DiscreteState& discrete,
                    const ContactMemory& memory, const DockingData<double>& at,
                    const Interface& geometry, const Loads& loads, double t, const double* y,
                    InterfaceWorkspace& work) {
  const int n = model.layout.mechanism_nv, bristles = model.layout.element_bristles;
  DockingPass& pass = work.pass;
  Seeds seeds(model, at, geometry, y, pass.y);
  for (int first = 0; first < n + 6; first += kLanes) {
    const int count = std::min(kLanes, n + 6 - first);
    start_docking_pass(model, loads, t, y, pass);
    for (int lane = 0; lane < count; ++lane) seeds.put_velocity(first + lane, lane);
    const Status status = calc_docking_pass(model, discrete, memory, at, pass);
    if (!status.ok()) return status;
    read_forces(model, geometry, pass.data, first, count, work.damping);
    for (int lane = 0; lane < count; ++lane) {
      const int column = first + lane;
      for (int i = 0; i < work.bristle_rate.rows(); ++i) {
        work.bristle_rate(i, column) = pass.ydot[bristles + i].d[lane];
      }
      if (column >= n) continue;
      Vec3<double> v, w;
      for (int i = 0; i < 3; ++i) {
        v[i] = pass.data.capture.v[i].d[lane];
        w[i] = pass.data.capture.w[i].d[lane];
      }
      Vec6<double> motion;
      motion << geometry.R.transpose() * v, geometry.R.transpose() * w;
      geometry.L.triangularView<Eigen::Lower>().solveInPlace(motion);
      work.capture.col(column) = motion;
    }
  }
  return {};
}

/// K, at zero velocities. @pre calc_damping
Status calc_stiffness(const DockingModel& model, const DiscreteState& discrete,
                      const ContactMemory& memory, const DockingData<double>& at,
                      const Interface& geometry, const Loads& loads, double t, const double* y,
                      InterfaceWorkspace& work) {
  const StateLayout& layout = model.layout;
  const int n = layout.mechanism_nv;
  DockingPass& pass = work.pass;
  Seeds seeds(model, at, geometry, y, pass.y);
  const auto stop = [&pass](int from, int count) {
    for (int i = from; i < from + count; ++i) pass.y[i] = Derivative(0.0);
  };
  for (int first = 0; first < n + 6; first += kLanes) {
    const int count = std::min(kLanes, n + 6 - first);
    start_docking_pass(model, loads, t, y, pass);
    stop(layout.mechanism_v, n);
    for (int i : {kChaser, kTarget}) {
      if (layout.momentum[i] >= 0) stop(layout.momentum[i], 6);
    }
    for (int lane = 0; lane < count; ++lane) {
      seeds.put_displacement(first + lane, lane);
      for (int i = 0; i < work.bristle_rate.rows(); ++i) {
        pass.y[layout.element_bristles + i].d[lane] = work.bristle_rate(i, first + lane);
      }
    }
    const Status status = calc_docking_pass(model, discrete, memory, at, pass);
    if (!status.ok()) return status;
    read_forces(model, geometry, pass.data, first, count, work.stiffness);
  }
  return {};
}

/// Does a contact or latch hold P at G? A force between the vehicles counts where nothing else can.
bool is_held(const DockingModel& model, const DiscreteState& discrete,
             const DockingData<double>& at) {
  if (!model.contact.empty() && at.contact.active_count > 0) return true;
  const bool can_be_held =
      !model.contact.empty() || model.latches.count() > 0 || !model.hard_dock.empty();
  if (!model.hard_dock.empty() && !at.hard_dock.on_passive.f.isZero(0.0)) return true;
  if (!can_be_held && !at.on_target.f.isZero(0.0)) return true;
  for (int i = 0; i < model.latches.count(); ++i) {
    const LatchMode mode = discrete.latch[i].mode;
    const bool grips = mode == LatchMode::kHeld || mode == LatchMode::kReleasing;
    if (grips && at.latch.force[i] != 0.0) return true;
  }
  return false;
}

/// Join G and P by a spring whose squared frequency is the same in all directions.
/// @return this squared frequency [rad2/s2]; 0 if no coordinate that moves G has a spring
double add_link(InterfaceWorkspace& work) {
  const int n = static_cast<int>(work.capture.cols());
  double largest = 0.0;
  for (int i = 0; i < n; ++i) {
    const double square = work.capture.col(i).squaredNorm();
    if (square > 0.0) largest = std::max(largest, work.stiffness(i, i) / square);
  }
  const double link = kLink * largest;
  MatX<double>& K = work.stiffness;
  K.topLeftCorner(n, n) += link * work.capture.transpose().lazyProduct(work.capture);
  K.topRightCorner(n, 6) -= link * work.capture.transpose();
  K.bottomLeftCorner(6, n) -= link * work.capture;
  K.bottomRightCorner<6, 6>() += link * Mat6<double>::Identity();
  return link;
}

void make_symmetric_part(MatX<double>& K) {
  for (int i = 0; i < K.rows(); ++i) {
    for (int j = 0; j < i; ++j) K(i, j) = K(j, i) = 0.5 * (K(i, j) + K(j, i));
  }
}

/// K + i w C without the coordinates of the mechanism: Gauss elimination, the pivot with the least
/// cancellation first. A coordinate with a pivot of rounding size, or not positive, is held.
/// @return its last six rows and columns
Mat6<Complex> condense(double w, InterfaceWorkspace& work) {
  const int n = static_cast<int>(work.diagonal.size());
  MatX<Complex>& D = work.dynamic;
  D.real() = work.stiffness;
  D.imag() = w * work.damping;
  for (int i = 0; i < n; ++i) work.diagonal[i] = std::abs(D(i, i));
  std::fill(work.eliminated.begin(), work.eliminated.end(), 0);
  for (;;) {
    int best = -1;
    double largest = kLimp;
    for (int i = 0; i < n; ++i) {
      if (work.eliminated[i] || !(work.diagonal[i] > 0.0)) continue;
      const double left = (D(i, i).real() + D(i, i).imag()) / work.diagonal[i];
      if (!(left > largest)) continue;
      best = i;
      largest = left;
    }
    if (best < 0) return D.bottomRightCorner<6, 6>();
    work.eliminated[best] = 1;
    for (int j = 0; j < n + 6; ++j) {
      if (j < n && work.eliminated[j]) continue;
      const Complex part = D(j, best) / D(best, best);
      D.row(j) -= part * D.row(best);
    }
  }
}

/// Eigenvalues of the symmetric part, ascending; zero if they are not finite.
Vec6<double> find_symmetric_eigenvalues(const Mat6<double>& matrix) {
  if (!matrix.allFinite()) return Vec6<double>::Zero();
  return find_eigenvalues(Mat6<double>(0.5 * (matrix + matrix.transpose())));
}

}  // namespace

InterfaceWorkspace::InterfaceWorkspace(const DockingModel& model) : pass(model) {
  const int n = model.layout.mechanism_nv;
  stiffness.setZero(n + 6, n + 6);
  damping.setZero(n + 6, n + 6);
  capture.setZero(6, n);
  bristle_rate.setZero(model.layout.element_bristle_count + model.layout.bristle_count, n + 6);
  dynamic.setZero(n + 6, n + 6);
  column[kChaser].setZero(static_cast<int>(model.mechanism.plan.ind_v.size()));
  if (model.target) column[kTarget].setZero(static_cast<int>(model.target->plan.ind_v.size()));
  diagonal.setZero(n);
  eliminated.assign(static_cast<size_t>(n), 0);
}

double find_interface_frequency(const DockingModel& model, const DiscreteState& discrete,
                                const ContactMemory& memory, const DockingData<double>& at,
                                const Loads& loads, double t, const double* y,
                                InterfaceWorkspace& work) {
  work.squared_frequency.setZero();
  work.damping_rate.setZero();
  work.hosts.setZero();
  if (!model.present[kTarget] || !(model.moves[kChaser] || model.moves[kTarget])) return 0.0;
  if (at.locked && at.locked->has_target) return 0.0;  // no relative motion

  Interface geometry;
  geometry.R = at.vehicle[kChaser].R;
  geometry.arm = geometry.R.transpose() * (at.capture.p - at.vehicle[kChaser].p);
  Mat6<double> hosts;
  geometry.L = find_cholesky_factor(find_mobility(model, at, geometry, work.column, hosts));
  Status status = calc_damping(model, discrete, memory, at, geometry, loads, t, y, work);
  if (!status.ok()) return 0.0;
  status = calc_stiffness(model, discrete, memory, at, geometry, loads, t, y, work);
  if (!status.ok()) return 0.0;

  make_symmetric_part(work.stiffness);
  make_symmetric_part(work.damping);
  const double rigid =
      is_held(model, discrete, at) ? std::numeric_limits<double>::infinity() : 0.5 * add_link(work);
  work.rigid = rigid;
  geometry.L.triangularView<Eigen::Lower>().solveInPlace(hosts);
  work.hosts = hosts.transpose();
  geometry.L.triangularView<Eigen::Lower>().solveInPlace(work.hosts);
  double w = kSlow;
  for (int i = 0; i < kIterations; ++i) {
    const Mat6<Complex> condensed = condense(w, work);
    work.squared_frequency = find_symmetric_eigenvalues(condensed.real());
    work.damping_rate = find_symmetric_eigenvalues(condensed.imag()) / w;
    for (double& square : work.squared_frequency) {
      if (!(square < rigid)) square = 0.0;
    }
    const double frequency = std::sqrt(std::max(0.0, work.squared_frequency.maxCoeff()));
    const double rate = std::max(frequency, work.damping_rate[5]);
    const bool settled = std::abs(rate - w) <= kSettled * w;
    w = settled || i < kFullSteps ? rate : std::sqrt(w * rate);
    if (settled || !(w > 0.0)) break;
  }
  return w;
}

double find_largest_delay(double k, double c, double share, double& w) {
  // s^2 - b s + (1 - 2 share) k^2 = 0 for s = w^2
  const double rest = 1.0 - 2.0 * share, b = 2.0 * (1.0 - share) * k - rest * c * c;
  const double root = b * b - 4.0 * rest * k * k;
  double least = kNoDelayLimit;
  w = 0.0;
  if (!(root >= 0.0)) return least;
  for (const double sign : {1.0, -1.0}) {
    const double s = 0.5 * (b + sign * std::sqrt(root));
    if (!(s > 0.0)) continue;
    const double at = std::sqrt(s);
    double angle = -std::arg(s / Complex(k, at * c) - (1.0 - share));
    if (angle < 0.0) angle += 2.0 * static_cast<double>(EIGEN_PI);
    if (!(angle / at < least)) continue;
    least = angle / at;
    w = at;
  }
  return least;
}

double find_largest_delay(InterfaceWorkspace& work) {
  if (!(work.hosts.trace() > 0.0)) return 0.0;
  double least = kNoDelayLimit;
  bool is_connected = false;
  for (int mode = 0; mode < 6; ++mode) {
    double w = kSlow;
    for (int i = 0; i < kIterations; ++i) {
      const Mat6<Complex> condensed = condense(w, work);
      const Mat6<double> K = condensed.real(), C = condensed.imag() / w;
      if (!K.allFinite() || !C.allFinite()) break;
      const PrincipalAxes modes = find_principal_axes(Mat6<double>(0.5 * (K + K.transpose())));
      const Vec6<double> u = modes.axis.col(mode);
      const double k = modes.value[mode];
      if (!(k > kSlow * kSlow) || !(k < work.rigid)) break;
      is_connected = true;
      double next = 0.0;
      const double delay = find_largest_delay(k, std::max(u.dot(C * u), 0.0),
                                              std::min(u.dot(work.hosts * u), 1.0), next);
      const bool settled = std::abs(next - w) <= kSettled * w;
      if (settled || !(next > 0.0) || i + 1 == kIterations) least = std::min(least, delay);
      if (settled || !(next > 0.0)) break;
      w = i < kFullSteps ? next : std::sqrt(w * next);
    }
  }
  return is_connected ? least : 0.0;
}

}  // namespace dockloop
