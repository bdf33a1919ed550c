// A mechanism of STATES.json (pinocchio_bench.cpp) as a tree of Pinocchio, and its states.
#pragma once

#include <array>
#include <fstream>
#include <nlohmann/json.hpp>
#include <pinocchio/multibody.hpp>
#include <string>
#include <vector>

namespace dockloop {

namespace pin = pinocchio;
using nlohmann::json;
using Vector = Eigen::VectorXd;

inline Eigen::Vector3d read_vector(const json& at, const char* key) {
  if (!at.contains(key)) return Eigen::Vector3d::Zero();
  const auto x = at[key].get<std::array<double, 3>>();
  return {x[0], x[1], x[2]};
}

inline Eigen::Matrix3d read_matrix(const json& at, const char* key,
                                   const Eigen::Matrix3d& otherwise) {
  if (!at.contains(key)) return otherwise;
  Eigen::Matrix3d m;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) m(i, j) = at[key][static_cast<size_t>(i)][static_cast<size_t>(j)];
  }
  return m;
}

inline Vector read_values(const json& at) {
  const auto x = at.get<std::vector<double>>();
  return Eigen::Map<const Vector>(x.data(), static_cast<Eigen::Index>(x.size()));
}

struct State {
  Vector q, v, tau, expected;
};

/// The tree of bodies, with the states to evaluate. Loops and gears are not in it.
class PeerTree {
 public:
  explicit PeerTree(const std::string& file)
      : document_(read_document(file)), name(document_.at("name")) {
    const json& mechanism = document_.at("mechanism");
    model.gravity.linear(read_vector(mechanism, "gravity"));
    for (const json& body : mechanism.at("bodies")) add_body(body);
    data = pin::Data(model);
    for (const json& state : document_.at("states")) {
      State s{read_values(state.at("q")), read_values(state.at("expected").at("v")),
              read_values(state.at("tau")), read_values(state.at("expected").at("a"))};
      if (has_free_joint_) reorder_quaternion(s.q);
      states.push_back(s);
    }
  }

  const json& document() const { return document_; }

  pin::JointIndex find_joint(const std::string& body) const {
    return body == "base" ? pin::JointIndex(0) : model.getJointId(body);
  }

  /// Largest difference of an acceleration from the expected one, over the largest expected.
  template <class Accelerations>
  double find_worst_error(Accelerations calc) const {
    double worst = 0.0;
    for (const State& s : states) {
      const Vector& a = calc(s);
      if (!a.allFinite()) return std::numeric_limits<double>::infinity();
      worst = std::max(worst,
                       (a - s.expected).cwiseAbs().maxCoeff() / s.expected.cwiseAbs().maxCoeff());
    }
    return worst;
  }

 private:
  static json read_document(const std::string& file) {
    std::ifstream stream(file);
    return json::parse(stream);
  }

  void add_body(const json& body) {
    const json& joint = body.at("joint");
    const std::string type = joint.at("type"), parent = body.at("parent");
    const pin::SE3 placement(read_matrix(joint, "rotation", Eigen::Matrix3d::Identity()),
                             read_vector(joint, "position"));
    const pin::JointIndex up = find_joint(parent);
    const Eigen::Vector3d axis = read_vector(joint, "axis");
    const auto put = [&](const auto& kind) {
      return model.addJoint(up, kind, placement, body.at("name"));
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
    model.appendBodyToJoint(index,
                            pin::Inertia(body.value("mass", 0.0), read_vector(body, "com"),
                                         read_matrix(body, "inertia", Eigen::Matrix3d::Zero())),
                            pin::SE3::Identity());
  }

  /// Free joint first, if there is one: (w, x, y, z) becomes (x, y, z, w).
  static void reorder_quaternion(Vector& q) {
    const double w = q[3];
    q.segment<3>(3) = q.segment<3>(4).eval();
    q[6] = w;
  }

  json document_;
  bool has_free_joint_ = false;

 public:
  std::string name;
  pin::Model model;
  pin::Data data;
  std::vector<State> states;
};

}  // namespace dockloop
