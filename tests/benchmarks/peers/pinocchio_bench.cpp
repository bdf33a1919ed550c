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
// redundant. Universal cuts it has not: such mechanisms are refused. Mechanisms with gears:
// pinocchio_geared.hpp.
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

#include "benchmarks/peers/pinocchio_geared.hpp"
#include "benchmarks/reference_motion.hpp"

namespace pin = pinocchio;

namespace {

using dockloop::json;
using dockloop::read_vector;
using dockloop::State;
using dockloop::Vector;

enum class Algorithm { kConstraintDynamics, kLcaba };

class Peer : public dockloop::PeerTree {
 public:
  Peer(const std::string& file, Algorithm algorithm) : PeerTree(file), algorithm_(algorithm) {
    for (const json& loop : document().at("mechanism").at("loops")) add_loop(loop);
    for (const auto& constraint : constraints_) constraint_data_.emplace_back(constraint);
    if (algorithm_ == Algorithm::kLcaba) {
      pin::computeJointMinimalOrdering(model, data, constraints_);
    } else {
      pin::initConstraintDynamics(model, data, constraints_, constraint_data_);
    }
    for (const json& force : document().value("forces", json::array())) {
      const pin::JointIndex joint = model.getJointId(force.at("body"));
      forces_.push_back({model.joints[joint].idx_q(), model.joints[joint].idx_v(),
                         force.at("stiffness"), force.at("damping")});
    }
    choose_settings();
  }

  const Vector& calc_accelerations(const Vector& q, const Vector& v, const Vector& tau) {
    if (algorithm_ == Algorithm::kLcaba) {
      return pin::lcaba(model, data, q, v, tau, constraints_, constraint_data_, settings_);
    }
    return pin::constraintDynamics(model, data, q, v, tau, constraints_, constraint_data_,
                                   settings_);
  }

  /// tau of the springs and dampers.
  void calc_forces(const Vector& q, const Vector& v, Vector& tau) const {
    tau.setZero();
    for (const Force& f : forces_) tau[f.v] = -f.stiffness * q[f.q] - f.damping * v[f.v];
  }

  double find_worst_error() {
    return PeerTree::find_worst_error(
        [this](const State& s) -> const Vector& { return calc_accelerations(s.q, s.v, s.tau); });
  }

  double mu() const { return settings_.mu; }
  int iterations() const { return settings_.max_iter; }
  int nq() const { return model.nq; }
  int nv() const { return model.nv; }
  pin::SE3 home() const { return model.jointPlacements[1]; }

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

  void add_loop(const json& loop) {
    const json& cut = loop.at("cut");
    const std::string type = cut.at("type");
    if (type != "R3" && type != "R1_planar") throw std::runtime_error("cut " + type);
    const auto joint = [&](const char* key) { return find_joint(loop.at(key)); };
    const auto point = [&](const char* key) {
      return pin::SE3(Eigen::Matrix3d::Identity(), read_vector(cut, key));
    };
    constraints_.emplace_back(pin::CONTACT_3D, model, joint("closing"), point("point_on_closing"),
                              joint("terminal"), point("point_on_terminal"), pin::LOCAL);
  }

  Algorithm algorithm_;
  std::vector<pin::RigidConstraintModel, Eigen::aligned_allocator<pin::RigidConstraintModel>>
      constraints_;
  std::vector<pin::RigidConstraintData, Eigen::aligned_allocator<pin::RigidConstraintData>>
      constraint_data_;
  pin::ProximalSettings settings_;
  std::vector<Force> forces_;
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

std::string find_code(Algorithm algorithm) {
  return algorithm == Algorithm::kLcaba ? "Pinocchio lcaba" : "Pinocchio constraintDynamics";
}

void add_evaluation(Peer& peer, Algorithm algorithm) {
  benchmark::RegisterBenchmark(
      (peer.name + "/" + find_code(algorithm) + "/with reactions").c_str(),
      [&peer](benchmark::State& state) {
        size_t k = 0;
        for ([[maybe_unused]] auto _ : state) {
          const State& s = peer.states[k++ % peer.states.size()];
          benchmark::DoNotOptimize(peer.calc_accelerations(s.q, s.v, s.tau).data());
        }
        state.counters["error"] = peer.find_worst_error();
        state.counters["mu"] = peer.mu();
        state.counters["iterations_inside"] = peer.iterations();
      });
}

void add_geared(dockloop::GearedPeer& peer) {
  benchmark::RegisterBenchmark(
      (peer.name + "/" + peer.find_code()).c_str(), [&peer](benchmark::State& state) {
        size_t k = 0;
        for ([[maybe_unused]] auto _ : state) {
          benchmark::DoNotOptimize(
              peer.calc_accelerations(peer.states[k++ % peer.states.size()]).data());
        }
        state.counters["error"] = peer.find_worst_error(
            [&peer](const State& s) -> const Vector& { return peer.calc_accelerations(s); });
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
    std::deque<dockloop::GearedPeer> geared;
    for (int i = first; i < argc; ++i) {
      if (dockloop::has_gears(argv[i])) {
        for (const auto solution : {dockloop::Solution::kReduced, dockloop::Solution::kMultipliers})
          add_geared(geared.emplace_back(argv[i], solution));
        continue;
      }
      for (const Algorithm algorithm : {Algorithm::kConstraintDynamics, Algorithm::kLcaba}) {
        Peer& peer = peers.emplace_back(argv[i], algorithm);
        add_evaluation(peer, algorithm);
        if (reference && i == first) add_motion(find_code(algorithm), *reference, peer);
      }
    }
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "pinocchio_bench: %s\n", error.what());
    return 1;
  }
  return 0;
}
