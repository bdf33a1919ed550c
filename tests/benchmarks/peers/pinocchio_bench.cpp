// The same mechanisms in Pinocchio: loops are constraints on the tree.
//
//   pinocchio_bench [--motion REFERENCE.json] STATES.json... [--benchmark_... options]
//
// STATES.json has the format of tests/data/crank_nested.json (mechanism in bodies and loops;
// states with q, v, tau, expected accelerations; scripts/bench makes them from dockloop), and may
// have `forces`: body, stiffness, damping of springs along joints. Evaluations take turns at its
// states; the counter `error` is the largest difference of an acceleration from the expected one,
// over the largest expected. With --motion the first file is also moved through the reference
// motion, from its first state.
//
// Proximal settings are the cheapest that are accurate to 1e-9 (choose_settings).
// A planar cut leaves two equations; Pinocchio has the three of a point, which say the same and are
// redundant. Universal cuts it has not: such mechanisms are refused.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <deque>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/loop-constrained-aba.hpp>
#include <string>
#include <vector>

#include "benchmarks/reference_motion.hpp"

namespace pin = pinocchio;

namespace {

using nlohmann::json;
using Vector = Eigen::VectorXd;

Eigen::Vector3d read_vector(const json& at, const char* key) {
  if (!at.contains(key)) return Eigen::Vector3d::Zero();
  const auto x = at[key].get<std::array<double, 3>>();
  return {x[0], x[1], x[2]};
}

Eigen::Matrix3d read_matrix(const json& at, const char* key, const Eigen::Matrix3d& otherwise) {
  if (!at.contains(key)) return otherwise;
  Eigen::Matrix3d m;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) m(i, j) = at[key][static_cast<size_t>(i)][static_cast<size_t>(j)];
  }
  return m;
}

Vector read_values(const json& at) {
  const auto x = at.get<std::vector<double>>();
  return Eigen::Map<const Vector>(x.data(), static_cast<Eigen::Index>(x.size()));
}

enum class Algorithm { kConstraintDynamics, kLcaba };

struct State {
  Vector q, v, tau, expected;
};

class Peer {
 public:
  Peer(const std::string& file, Algorithm algorithm) : algorithm_(algorithm) {
    std::ifstream stream(file);
    const json document = json::parse(stream);
    const json& mechanism = document.at("mechanism");
    name = document.at("name");
    model_.gravity.linear(read_vector(mechanism, "gravity"));
    for (const json& body : mechanism.at("bodies")) add_body(body);
    for (const json& loop : mechanism.at("loops")) add_loop(loop);
    data_ = pin::Data(model_);
    for (const auto& constraint : constraints_) constraint_data_.emplace_back(constraint);
    if (algorithm_ == Algorithm::kLcaba) {
      pin::computeJointMinimalOrdering(model_, data_, constraints_);
    } else {
      pin::initConstraintDynamics(model_, data_, constraints_, constraint_data_);
    }
    for (const json& force : document.value("forces", json::array())) {
      const pin::JointIndex joint = model_.getJointId(force.at("body"));
      forces_.push_back({model_.joints[joint].idx_q(), model_.joints[joint].idx_v(),
                         force.at("stiffness"), force.at("damping")});
    }
    for (const json& state : document.at("states")) {
      State s{read_values(state.at("q")), read_values(state.at("expected").at("v")),
              read_values(state.at("tau")), read_values(state.at("expected").at("a"))};
      if (has_free_joint_) reorder_quaternion(s.q);
      states.push_back(s);
    }
    choose_settings();
  }

  const Vector& calc_accelerations(const Vector& q, const Vector& v, const Vector& tau) {
    if (algorithm_ == Algorithm::kLcaba) {
      return pin::lcaba(model_, data_, q, v, tau, constraints_, constraint_data_, settings_);
    }
    return pin::constraintDynamics(model_, data_, q, v, tau, constraints_, constraint_data_,
                                   settings_);
  }

  /// tau of the springs and dampers.
  void calc_forces(const Vector& q, const Vector& v, Vector& tau) const {
    tau.setZero();
    for (const Force& f : forces_) tau[f.v] = -f.stiffness * q[f.q] - f.damping * v[f.v];
  }

  double find_worst_error() {
    double worst = 0.0;
    for (const State& s : states) {
      const Vector& a = calc_accelerations(s.q, s.v, s.tau);
      if (!a.allFinite()) return std::numeric_limits<double>::infinity();
      worst = std::max(worst,
                       (a - s.expected).cwiseAbs().maxCoeff() / s.expected.cwiseAbs().maxCoeff());
    }
    return worst;
  }

  double mu() const { return settings_.mu; }
  int iterations() const { return settings_.max_iter; }
  int nq() const { return model_.nq; }
  int nv() const { return model_.nv; }
  pin::SE3 home() const { return model_.jointPlacements[1]; }

  std::string name;
  std::vector<State> states;

 private:
  struct Force {
    int q, v;
    double stiffness, damping;
  };

  /// The fewest proximal iterations with which accelerations are right to kAccurate; if none are,
  /// the settings that come nearest.
  void choose_settings() {
    constexpr double kAccurate = 1e-9;
    double best = 1e300;
    pin::ProximalSettings choice;
    for (const int iterations : {1, 2, 3, 4, 6, 10, 20, 50}) {
      for (const double mu : {0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4}) {
        if (mu == 0.0 && (algorithm_ == Algorithm::kLcaba || iterations > 1)) continue;
        settings_ = pin::ProximalSettings(0.0, mu, iterations);
        const double error = find_worst_error();
        if (!(error < best)) continue;
        best = error;
        choice = settings_;
      }
      if (best < kAccurate) break;
    }
    settings_ = choice;
  }

  void add_body(const json& body) {
    const json& joint = body.at("joint");
    const std::string type = joint.at("type"), parent = body.at("parent");
    const pin::SE3 placement(read_matrix(joint, "rotation", Eigen::Matrix3d::Identity()),
                             read_vector(joint, "position"));
    const pin::JointIndex up = parent == "base" ? 0 : model_.getJointId(parent);
    const Eigen::Vector3d axis = read_vector(joint, "axis");
    const auto put = [&](const auto& kind) {
      return model_.addJoint(up, kind, placement, body.at("name"));
    };
    // Joints about an axis of their frame have code of their own.
    pin::JointIndex index = 0;
    if (type == "free") {
      index = put(pin::JointModelFreeFlyer());
      has_free_joint_ = true;
    } else if (type == "revolute") {
      index = axis.x() == 1.0   ? put(pin::JointModelRX())
              : axis.y() == 1.0 ? put(pin::JointModelRY())
              : axis.z() == 1.0 ? put(pin::JointModelRZ())
                                : put(pin::JointModelRevoluteUnaligned(axis));
    } else {
      index = axis.x() == 1.0   ? put(pin::JointModelPX())
              : axis.y() == 1.0 ? put(pin::JointModelPY())
              : axis.z() == 1.0 ? put(pin::JointModelPZ())
                                : put(pin::JointModelPrismaticUnaligned(axis));
    }
    model_.appendBodyToJoint(index,
                             pin::Inertia(body.value("mass", 0.0), read_vector(body, "com"),
                                          read_matrix(body, "inertia", Eigen::Matrix3d::Zero())),
                             pin::SE3::Identity());
  }

  void add_loop(const json& loop) {
    const json& cut = loop.at("cut");
    const std::string type = cut.at("type");
    if (type != "R3" && type != "R1_planar") throw std::runtime_error("cut " + type);
    const auto joint = [&](const char* key) {
      const std::string body = loop.at(key);
      return body == "base" ? pin::JointIndex(0) : model_.getJointId(body);
    };
    const auto point = [&](const char* key) {
      return pin::SE3(Eigen::Matrix3d::Identity(), read_vector(cut, key));
    };
    constraints_.emplace_back(pin::CONTACT_3D, model_, joint("closing"), point("point_on_closing"),
                              joint("terminal"), point("point_on_terminal"), pin::LOCAL);
  }

  /// Free joint first, if there is one: (w, x, y, z) becomes (x, y, z, w).
  static void reorder_quaternion(Vector& q) {
    const double w = q[3];
    q.segment<3>(3) = q.segment<3>(4).eval();
    q[6] = w;
  }

  Algorithm algorithm_;
  pin::Model model_;
  pin::Data data_;
  std::vector<pin::RigidConstraintModel, Eigen::aligned_allocator<pin::RigidConstraintModel>>
      constraints_;
  std::vector<pin::RigidConstraintData, Eigen::aligned_allocator<pin::RigidConstraintData>>
      constraint_data_;
  pin::ProximalSettings settings_;
  std::vector<Force> forces_;
  bool has_free_joint_ = false;
};

constexpr int kQ = 25, kV = 24;  // of hexapod_bench

void add_motion(const std::string& name, const dockloop::ReferenceMotion& reference, Peer& peer) {
  if (peer.nq() != kQ || peer.nv() != kV) throw std::runtime_error("not the mechanism that moves");
  const auto rates = [&peer, q = Vector(kQ), v = Vector(kV), tau = Vector(kV)](const double* y,
                                                                               double* dy) mutable {
    q = Eigen::Map<const Vector>(y, kQ);
    v = Eigen::Map<const Vector>(y + kQ, kV);
    q.segment<4>(3).normalize();
    const Eigen::Quaterniond turn(q[6], q[3], q[4], q[5]);
    peer.calc_forces(q, v, tau);
    Eigen::Map<Vector>(dy + kQ, kV) = peer.calc_accelerations(q, v, tau);
    Eigen::Map<Eigen::Vector3d>(dy, 3) = turn * v.head<3>();
    const Eigen::Quaterniond rate = turn * Eigen::Quaterniond(0.0, v[3], v[4], v[5]);
    Eigen::Map<Eigen::Vector4d>(dy + 3, 4) = 0.5 * rate.coeffs();
    Eigen::Map<Vector>(dy + 7, kQ - 7) = v.tail<kQ - 7>();
  };
  const Eigen::Vector3d home = peer.home().translation();
  dockloop::add_motions<kQ + kV>(
      name, reference,
      [&peer](const dockloop::ReferenceMotion&) {
        std::array<double, kQ + kV> y;
        Eigen::Map<Vector>(y.data(), kQ) = peer.states[0].q;
        Eigen::Map<Vector>(y.data() + kQ, kV) = peer.states[0].v;
        return y;
      },
      rates,
      [home](const double* y) {
        return Eigen::Vector3d(home + Eigen::Map<const Eigen::Vector3d>(y));
      });
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  try {
    int first = 1;
    std::optional<dockloop::ReferenceMotion> reference;
    if (argc > 2 && std::string(argv[1]) == "--motion") {
      reference.emplace(argv[2]);
      first = 3;
    }
    if (first >= argc) throw std::runtime_error("no STATES.json given");
    std::deque<Peer> peers;
    for (int i = first; i < argc; ++i) {
      for (const Algorithm algorithm : {Algorithm::kConstraintDynamics, Algorithm::kLcaba}) {
        Peer& peer = peers.emplace_back(argv[i], algorithm);
        const std::string code =
            algorithm == Algorithm::kLcaba ? "Pinocchio lcaba" : "Pinocchio constraintDynamics";
        benchmark::RegisterBenchmark(
            (peer.name + "/" + code + "/with reactions").c_str(), [&peer](benchmark::State& state) {
              size_t k = 0;
              for ([[maybe_unused]] auto _ : state) {
                const State& s = peer.states[k++ % peer.states.size()];
                benchmark::DoNotOptimize(peer.calc_accelerations(s.q, s.v, s.tau).data());
              }
              state.counters["error"] = peer.find_worst_error();
              state.counters["mu"] = peer.mu();
              state.counters["iterations_inside"] = peer.iterations();
            });
        if (reference && i == first) add_motion(code, *reference, peer);
      }
    }
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "pinocchio_bench: %s\n", error.what());
    return 1;
  }
  return 0;
}
