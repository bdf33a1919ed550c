// Reading JSON with messages a user can act on: every error names file, path of the member, value
// and limit. A JsonReader is a cursor into a document that knows its own path.
#pragma once

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "math/law_number.hpp"
#include "math/status.hpp"
#include "math/types.hpp"

namespace dockloop {

constexpr int kMaxNesting = 64;      ///< of nested lists and objects
constexpr double kMaxNumber = 1e30;  ///< in SI units; products of larger numbers would overflow
constexpr double kLeastNumber =
    1e-100;                         ///< smaller numbers become 0; divisions by them would overflow
constexpr size_t kMaxItems = 1000;  ///< of a list that describes a model
constexpr size_t kMaxReason = 160;  ///< characters of the parser's own message
constexpr size_t kMaxShownText = 60;              ///< characters of a value that a message quotes
constexpr double kDegree = 0.017453292519943296;  ///< [rad]

/// Parse a document. @throws ModelError with the parser's own position.
inline nlohmann::json parse_json(const std::string& text, const std::string& source_name) {
  const auto check_nesting = [&](int depth, nlohmann::json::parse_event_t, nlohmann::json&) {
    if (depth > kMaxNesting) {
      throw ModelError(source_name + ": lists and objects are nested too deeply; the limit is " +
                       std::to_string(kMaxNesting));
    }
    return true;
  };
  try {
    return nlohmann::json::parse(text, check_nesting);
  } catch (const nlohmann::json::exception& error) {
    const std::string why = error.what();  // contains the last text read, of any length
    throw ModelError(source_name + ": not a JSON document: " + why.substr(0, kMaxReason));
  }
}

class JsonReader {
 public:
  JsonReader(const nlohmann::json& node, std::string source, std::string path = "")
      : node_(&node), source_(std::move(source)), path_(std::move(path)) {}

  const nlohmann::json& node() const { return *node_; }
  const std::string& path() const { return path_; }
  /// A null member counts as absent: its default holds.
  bool has(const std::string& key) const {
    return node_->is_object() && node_->contains(key) && !(*node_)[key].is_null();
  }

  /// The value as text for a message.
  std::string shown() const {
    const std::string text = node_->dump();
    return text.size() > kMaxShownText ? text.substr(0, kMaxShownText) + "..." : text;
  }

  [[noreturn]] void fail(const std::string& what) const {
    throw ModelError(source_ + ": " + (path_.empty() ? "document" : path_) + " " + what);
  }

  JsonReader at(const std::string& key) const {
    if (!node_->is_object()) fail("must be an object");
    if (!has(key)) fail("lacks the member '" + key + "'");
    return {(*node_)[key], source_, path_.empty() ? key : path_ + "." + key};
  }

  /// Elements of an array.
  std::vector<JsonReader> items(size_t most = std::numeric_limits<size_t>::max()) const {
    if (!node_->is_array()) fail("must be a list");
    if (node_->size() > most) {
      fail("has " + std::to_string(node_->size()) + " elements; the limit is " +
           std::to_string(most));
    }
    std::vector<JsonReader> items;
    for (size_t i = 0; i < node_->size(); ++i) {
      items.push_back({(*node_)[i], source_, path_ + "[" + std::to_string(i + 1) + "]"});
    }
    return items;
  }

  /// Elements of an array; empty if the member is absent.
  std::vector<JsonReader> list(const std::string& key,
                               size_t most = std::numeric_limits<size_t>::max()) const {
    return has(key) ? at(key).items(most) : std::vector<JsonReader>();
  }

  std::string text() const {
    if (!node_->is_string()) fail("must be a text, not " + shown());
    return node_->get<std::string>();
  }
  std::string text(const std::string& key, const std::string& fallback) const {
    return has(key) ? at(key).text() : fallback;
  }

  double number() const {
    if (!node_->is_number()) fail("must be a number, not " + shown());
    const double value = node_->get<double>();
    if (!(std::abs(value) <= kMaxNumber)) {
      fail("is " + shown() + "; its absolute value must be at most 1e30");
    }
    return std::abs(value) < kLeastNumber ? 0.0 : value;
  }
  double number(const std::string& key, double fallback) const {
    return has(key) ? at(key).number() : fallback;
  }
  double non_negative(const std::string& key, double fallback) const {
    const double value = number(key, fallback);
    if (value < 0.0) at(key).fail("is " + at(key).shown() + "; it must be 0 or more");
    return value;
  }
  double positive(const std::string& key) const {
    const double value = at(key).number();
    if (value <= 0.0) {
      const bool is_tiny = at(key).node_->get<double>() > 0.0;
      at(key).fail("is " + at(key).shown() + "; it must be above 0" +
                   (is_tiny ? ", and what is below 1e-100 counts as 0" : ""));
    }
    return value;
  }
  int whole(int least, int most) const {
    const double value = number();
    if (!(value >= least && value <= most) || value != std::floor(value)) {
      fail("is " + shown() + "; it must be a whole number from " + std::to_string(least) + " to " +
           std::to_string(most));
    }
    return static_cast<int>(value);
  }
  int whole(const std::string& key, int fallback, int least, int most) const {
    return has(key) ? at(key).whole(least, most) : fallback;
  }
  /// Angles [rad]: `key` of a document, or `key`_deg of a hand-written file.
  double angle(const std::string& key) const {
    return has(key + "_deg") ? kDegree * at(key + "_deg").number() : at(key).number();
  }
  std::vector<double> angles(const std::string& key, size_t most) const {
    const bool in_degrees = has(key + "_deg");
    std::vector<double> values;
    for (const JsonReader& item : list(in_degrees ? key + "_deg" : key, most)) {
      values.push_back(in_degrees ? kDegree * item.number() : item.number());
    }
    return values;
  }
  bool flag(const std::string& key, bool fallback) const {
    if (!has(key)) return fallback;
    if (!at(key).node().is_boolean()) at(key).fail("must be true or false");
    return at(key).node().get<bool>();
  }

  /// Unit quaternion (w, x, y, z); no turn if the member is absent.
  Vec4<double> quaternion(const std::string& key) const {
    const Vec4<double> q = vector<4>(key, Vec4<double>(1, 0, 0, 0));
    if (std::abs(q.norm() - 1.0) > 1e-3) {
      at(key).fail("must be a unit quaternion (w, x, y, z); its norm is " +
                   describe_number(q.norm()));
    }
    // A unit quaternion within rounding keeps its bits.
    return std::abs(q.norm() - 1.0) > 1e-15 ? Vec4<double>(q / q.norm()) : q;
  }

  template <int N>
  Eigen::Matrix<double, N, 1> vector() const {
    if (!node_->is_array() || node_->size() != static_cast<size_t>(N)) {
      fail("must be a list of " + std::to_string(N) + " numbers");
    }
    Eigen::Matrix<double, N, 1> v;
    for (int i = 0; i < N; ++i) {
      v[i] = JsonReader((*node_)[static_cast<size_t>(i)], source_,
                        path_ + "[" + std::to_string(i + 1) + "]")
                 .number();
    }
    return v;
  }
  template <int N>
  Eigen::Matrix<double, N, 1> vector(const std::string& key,
                                     const Eigen::Matrix<double, N, 1>& fallback) const {
    return has(key) ? at(key).template vector<N>() : fallback;
  }

  /// R x 3 matrix written as rows.
  template <int R>
  Eigen::Matrix<double, R, 3> matrix() const {
    if (!node_->is_array() || node_->size() != static_cast<size_t>(R)) {
      fail("must be a list of " + std::to_string(R) + " rows of 3 numbers");
    }
    Eigen::Matrix<double, R, 3> m;
    for (int i = 0; i < R; ++i) {
      m.row(i) = JsonReader((*node_)[static_cast<size_t>(i)], source_,
                            path_ + "[" + std::to_string(i + 1) + "]")
                     .template vector<3>()
                     .transpose();
    }
    return m;
  }

  Mat3<double> rotation() const {
    const Mat3<double> R = matrix<3>();
    if (!(R * R.transpose()).isIdentity(1e-9) || R.determinant() < 0.0) {
      fail("must be a rotation matrix (orthonormal rows, determinant +1, to 1e-9)");
    }
    return R;
  }

  /// Unit vector; a length error above 1e-6 is refused, a smaller error is normalised.
  Vec3<double> unit_vector() const {
    const Vec3<double> v = vector<3>();
    if (std::abs(v.norm() - 1.0) > 1e-6)
      fail("must be a unit vector; its length is " + std::to_string(v.norm()));
    return v.normalized();
  }

 private:
  const nlohmann::json* node_;
  std::string source_, path_;
};

template <class Law>
void read_number(const JsonReader& item, const LawNumber<Law>& number, Law& law) {
  const JsonReader at = item.at(number.name);
  law.*number.member = at.number();
  const std::string why = find_fault(law.*number.member, number.rule);
  if (!why.empty()) at.fail("is " + at.shown() + "; " + why);
}

/// The numbers of a law that an object states; others keep their values.
template <class Law, size_t n>
void read_numbers(const JsonReader& item, const LawNumber<Law> (&list)[n], Law& law) {
  for (const LawNumber<Law>& each : list) {
    if (each.is_required || item.has(each.name)) read_number(item, each, law);
  }
}

}  // namespace dockloop
