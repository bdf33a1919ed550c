// A mechanism with gears (rows among joints: screws, differentials) by Pinocchio.
//
// Pinocchio's constraints are contacts between frames. It has no row among joint coordinates of
// several joints. So Pinocchio gives inertia, Jacobian, bias forces and bias accelerations of the
// tree, and this file solves with them, in one of two ways:
//
// * multipliers: all rows of loops and gears, dense, by Cholesky factors of the inertia and of the
//   Schur complement. Any mechanism can be solved like that.
// * reduced: gears are constant sums of other joints; each loop gives its own three joints from
//   those of the free body by a matrix of 3 x 3. What is left is 6 x 6. This uses all that is known
//   of a platform on legs, as dockloop does. It finds no cut forces.
#pragma once

#include <fstream>
#include <map>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "benchmarks/peers/pinocchio_model.hpp"

namespace dockloop {

enum class Solution { kReduced, kMultipliers };

/// Has the mechanism of a file gears?
inline bool has_gears(const std::string& file) {
  std::ifstream stream(file);
  return json::parse(stream).at("mechanism").contains("couplings");
}

class GearedPeer : public PeerTree {
 public:
  GearedPeer(const std::string& file, Solution solution) : PeerTree(file), solution_(solution) {
    const json& mechanism = document().at("mechanism");
    for (const json& row : mechanism.at("couplings")) add_gear(row);
    for (const json& loop : mechanism.at("loops")) add_loop(loop);
    choose_columns();
    a_.setZero(model.nv);
    tau_ = a_;
  }

  /// Code and what it computes, as in names of benchmarks.
  std::string find_code() const {
    return solution_ == Solution::kReduced ? "Pinocchio, reduced by hand/accelerations"
                                           : "Pinocchio, multipliers by hand/with reactions";
  }

  const Vector& calc_accelerations(const State& s) {
    pin::crba(model, data, s.q, pin::Convention::WORLD);  // inertia (upper half) and Jacobian
    pin::nonLinearEffects(model, data, s.q, s.v);         // bias forces, velocities, accelerations
    data.M.triangularView<Eigen::StrictlyLower>() = data.M.transpose();
    tau_ = s.tau - data.nle;
    for (Loop& loop : loops_) calc_bias(loop);
    if (solution_ == Solution::kReduced) {
      solve_reduced();
    } else {
      solve_with_multipliers();
    }
    return a_;
  }

 private:
  using Sum = std::vector<std::pair<int, double>>;  // velocity of a joint, ratio
  static constexpr int kFree = 6;  // independent velocities: those of the free body

  struct Gear {
    int v;
    Sum terms;
  };
  struct Loop {
    pin::JointIndex closing, terminal;
    Eigen::Vector3d on_closing, on_terminal;
    std::vector<std::pair<int, double>> columns;  // of its rows: velocity, +1 or -1
    std::vector<int> own;                         // velocities that the loop determines
    Eigen::Vector3d point, bias;
  };

  int find_velocity(const std::string& body) const {
    return model.joints[model.getJointId(body)].idx_v();
  }

  void add_gear(const json& row) {
    Gear gear{find_velocity(row.at("dependent")), {}};
    for (const json& term : row.at("terms")) {
      gear.terms.emplace_back(find_velocity(term.at("joint")), term.at("ratio"));
    }
    gears_.push_back(gear);
  }

  void add_loop(const json& loop) {
    const json& cut = loop.at("cut");
    if (cut.at("type") != "R3") throw std::runtime_error("gears with another cut than R3");
    Loop made{find_joint(loop.at("closing")),
              find_joint(loop.at("terminal")),
              read_vector(cut, "point_on_closing"),
              read_vector(cut, "point_on_terminal"),
              {},
              {},
              {},
              {}};
    for (const json& body : loop.at("dependent")) made.own.push_back(find_velocity(body));
    std::map<int, double> sum;
    for (const auto& [end, sign] : {std::pair(made.closing, 1.0), std::pair(made.terminal, -1.0)}) {
      for (const pin::JointIndex joint : model.supports[end]) {
        if (joint == 0) continue;
        for (int k = 0; k < model.joints[joint].nv(); ++k) {
          sum[model.joints[joint].idx_v() + k] += sign;
        }
      }
    }
    for (const auto& [v, sign] : sum) {
      if (sign != 0.0) made.columns.emplace_back(v, sign);
    }
    loops_.push_back(made);
  }

  /// Order of the reduced unknowns: those of the loops, then the six of the free body. Every
  /// velocity that is no gear is one of them; gears move with them.
  void choose_columns() {
    std::map<int, Sum> by_gear;
    for (const Gear& gear : gears_) by_gear[gear.v] = gear.terms;
    for (const Loop& loop : loops_)
      unknowns_.insert(unknowns_.end(), loop.own.begin(), loop.own.end());
    for (int v = 0; v < kFree; ++v) unknowns_.push_back(v);
    if (unknowns_.size() + gears_.size() != static_cast<size_t>(model.nv)) {
      throw std::runtime_error("not a platform on legs with gears");
    }
    moved_.resize(unknowns_.size());
    for (size_t j = 0; j < unknowns_.size(); ++j) {
      moved_[j].emplace_back(unknowns_[j], 1.0);
      for (const Gear& gear : gears_) {
        const double ratio = find_ratio(by_gear, gear.v, unknowns_[j]);
        if (ratio != 0.0) moved_[j].emplace_back(gear.v, ratio);
      }
    }
    const auto size = static_cast<Eigen::Index>(unknowns_.size());
    half_.setZero(model.nv, size);
    inertia_.setZero(size, size);
    force_.setZero(size);
    follow_.setZero(size - kFree, kFree);
    offset_.setZero(size - kFree);
    const auto rows = static_cast<Eigen::Index>(3 * loops_.size() + gears_.size());
    rows_.setZero(model.nv, rows);
    right_.setZero(rows);
  }

  static double find_ratio(const std::map<int, Sum>& by_gear, int v, int unknown) {
    if (v == unknown) return 1.0;
    const auto gear = by_gear.find(v);
    if (gear == by_gear.end()) return 0.0;
    double sum = 0.0;
    for (const auto& [joint, ratio] : gear->second) {
      sum += ratio * find_ratio(by_gear, joint, unknown);
    }
    return sum;
  }

  /// Where the loop is cut, and how its ends accelerate apart at zero joint accelerations.
  void calc_bias(Loop& loop) {
    loop.point = data.oMi[loop.closing].act(loop.on_closing);
    loop.bias = find_acceleration(loop.closing, loop.on_closing) -
                find_acceleration(loop.terminal, loop.on_terminal);
  }

  /// Of a point of a body, with gravity, which cancels in differences.
  Eigen::Vector3d find_acceleration(pin::JointIndex joint, const Eigen::Vector3d& at) const {
    const pin::Motion& v = data.v[joint];
    const pin::Motion& a = data.a_gf[joint];
    const Eigen::Vector3d local =
        a.linear() + a.angular().cross(at) + v.angular().cross(v.linear() + v.angular().cross(at));
    return data.oMi[joint].rotation() * local;
  }

  /// Velocity of a point of the cut by one joint velocity.
  Eigen::Vector3d find_column(const Loop& loop, int v) const {
    return data.J.col(v).head<3>() + data.J.col(v).tail<3>().cross(loop.point);
  }

  // ---------------------------------------------------------------- reduced

  void solve_reduced() {
    reduce_gears();
    for (size_t i = 0; i < loops_.size(); ++i) follow_loop(loops_[i], static_cast<int>(3 * i));
    const auto n = follow_.rows();
    const auto dd = inertia_.topLeftCorner(n, n);
    const auto id = inertia_.bottomLeftCorner<kFree, Eigen::Dynamic>(kFree, n);
    const Eigen::Matrix<double, kFree, kFree> mixed = id * follow_;
    product_.noalias() = dd * follow_;
    Eigen::Matrix<double, kFree, kFree> a =
        inertia_.bottomRightCorner<kFree, kFree>() + mixed + mixed.transpose();
    a.noalias() += follow_.transpose() * product_;
    Eigen::Matrix<double, kFree, 1> b = force_.tail<kFree>() - id * offset_;
    rest_.noalias() = force_.head(n) - dd * offset_;
    b.noalias() += follow_.transpose() * rest_;
    const Eigen::Matrix<double, kFree, 1> free = a.llt().solve(b);
    rest_.noalias() = follow_ * free + offset_;
    a_.setZero();
    for (size_t j = 0; j < unknowns_.size(); ++j) {
      const auto k = static_cast<Eigen::Index>(j);
      const double value = k < n ? rest_[k] : free[k - n];
      for (const auto& [v, ratio] : moved_[j]) a_[v] += ratio * value;
    }
  }

  /// G'MG and G'tau, where G has a few entries in each column.
  void reduce_gears() {
    for (size_t j = 0; j < moved_.size(); ++j) {
      auto column = half_.col(static_cast<Eigen::Index>(j));
      column = data.M.col(moved_[j][0].first);
      for (size_t k = 1; k < moved_[j].size(); ++k) {
        column += moved_[j][k].second * data.M.col(moved_[j][k].first);
      }
    }
    for (size_t i = 0; i < moved_.size(); ++i) {
      auto row = inertia_.row(static_cast<Eigen::Index>(i));
      row.setZero();
      double force = 0.0;
      for (const auto& [v, ratio] : moved_[i]) {
        row += ratio * half_.row(v);
        force += ratio * tau_[v];
      }
      force_[static_cast<Eigen::Index>(i)] = force;
    }
  }

  void follow_loop(const Loop& loop, int first) {
    Eigen::Matrix3d own;
    for (int k = 0; k < 3; ++k) own.col(k) = find_column(loop, loop.own[static_cast<size_t>(k)]);
    Eigen::Matrix<double, 3, kFree> free;
    for (int k = 0; k < kFree; ++k) free.col(k) = find_column(loop, k);
    const Eigen::Matrix3d inverse = own.inverse();
    follow_.middleRows<3>(first) = inverse * free;  // terminal - closing = 0
    offset_.segment<3>(first) = inverse * loop.bias;
  }

  // ---------------------------------------------------------------- multipliers

  /// M a - C' lambda = tau, C a = right, by lambda = (C M^-1 C')^-1 (right - C M^-1 tau).
  void solve_with_multipliers() {
    fill_rows();
    factor_.compute(data.M);
    factor_.matrixL().solveInPlace(rows_);
    a_ = tau_;
    factor_.matrixL().solveInPlace(a_);
    schur_.noalias() = rows_.transpose() * rows_;
    right_.noalias() -= rows_.transpose() * a_;
    schur_factor_.compute(schur_);
    schur_factor_.solveInPlace(right_);
    a_.noalias() += rows_ * right_;
    factor_.matrixU().solveInPlace(a_);
  }

  void fill_rows() {
    rows_.setZero();
    Eigen::Index at = 0;
    for (const Loop& loop : loops_) {
      for (const auto& [v, sign] : loop.columns) {
        rows_.block<1, 3>(v, at) = sign * find_column(loop, v).transpose();
      }
      right_.segment<3>(at) = -loop.bias;
      at += 3;
    }
    for (const Gear& gear : gears_) {
      rows_(gear.v, at) = 1.0;
      for (const auto& [v, ratio] : gear.terms) rows_(v, at) -= ratio;
      right_[at++] = 0.0;
    }
  }

  Solution solution_;
  std::vector<Gear> gears_;
  std::vector<Loop> loops_;
  std::vector<int> unknowns_;
  std::vector<Sum> moved_;  // by each unknown
  Vector a_, tau_, force_, offset_, right_, rest_;
  Eigen::MatrixXd half_, inertia_, rows_, schur_;
  Eigen::Matrix<double, Eigen::Dynamic, kFree> follow_, product_;
  Eigen::LLT<Eigen::MatrixXd> factor_, schur_factor_;
};

}  // namespace dockloop
