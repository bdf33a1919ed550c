// How the fuzzer varies a JSON document: mostly by one change to its tree (another number, a member
// less, an element twice, a part in the place of another), sometimes by bytes.
//
// Byte mutations alone rarely leave a document that still reads, so they would test the parser and
// little behind it.
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

extern "C" size_t LLVMFuzzerMutate(std::uint8_t* data, size_t size, size_t max_size);

namespace {

using nlohmann::json;
using Random = std::minstd_rand;

size_t choose(Random& random, size_t count) { return static_cast<size_t>(random()) % count; }

void collect(json& node, std::vector<json*>& nodes) {
  nodes.push_back(&node);
  if (!node.is_structured()) return;
  for (json& child : node) collect(child, nodes);
}

void change_number(json& node, Random& random) {
  const double x = node.get<double>();
  const std::vector<json> choices = {0,
                                     1,
                                     -1,
                                     2,
                                     x * 1.01,
                                     -x,
                                     x * 10,
                                     x * 0.1,
                                     0.5,
                                     1e-9,
                                     1e9,
                                     1e-300,
                                     1e300,
                                     -1e300,
                                     5e-324,
                                     1e154,
                                     1e20,
                                     2147483648u,
                                     100000,
                                     4294967296,
                                     x + 1,
                                     x * 1e-3,
                                     x * 1e3,
                                     3.141592653589793,
                                     -0.0,
                                     0.99999999,
                                     7,
                                     16,
                                     1.5707963267948966};
  node = choices[choose(random, choices.size())];
}

void change_text(json& node, const std::vector<json*>& nodes, Random& random) {
  static const std::vector<std::string> kWords = {"base",
                                                  "free",
                                                  "driven",
                                                  "fixed",
                                                  "revolute",
                                                  "prismatic",
                                                  "R1",
                                                  "R2",
                                                  "R3",
                                                  "R1_planar",
                                                  "newton",
                                                  "R2P1R3",
                                                  "R2C2R2",
                                                  "R1R2R3",
                                                  "P1R2R3",
                                                  "R2R1R3",
                                                  "R1P1R1",
                                                  "R1R1R1",
                                                  "P1R1R1",
                                                  "absorber",
                                                  "guide_ring",
                                                  "automatic",
                                                  "first_contact",
                                                  "start",
                                                  "",
                                                  "joint_spring_damper"};
  std::vector<const json*> texts;
  for (const json* other : nodes) {
    if (other->is_string()) texts.push_back(other);
  }
  const size_t i = choose(random, kWords.size() + texts.size());
  node = i < kWords.size() ? json(kWords[i]) : json(*texts[i - kWords.size()]);
}

void change_list(json& node, Random& random) {
  if (node.empty()) return;
  const size_t i = choose(random, node.size()), j = choose(random, node.size());
  switch (choose(random, 4)) {
    case 0:
      node.erase(i);
      break;
    case 1:
      node.push_back(json(node[i]));
      break;
    case 2:
      std::swap(node[i], node[j]);
      break;
    default:
      node[i] = json(node[j]);
      break;
  }
}

void change_object(json& node, Random& random) {
  if (node.empty()) return;
  auto member = node.begin();
  std::advance(member, static_cast<long>(choose(random, node.size())));
  node.erase(member);
}

void wrap(json& node, Random& random) {
  for (size_t depth = size_t(1) << choose(random, 10); depth > 0; --depth) {
    json outer = json::array();
    outer.push_back(std::move(node));
    node = std::move(outer);
  }
}

void change_document(json& document, Random& random) {
  std::vector<json*> nodes;
  collect(document, nodes);
  json& node = *nodes[choose(random, nodes.size())];
  const size_t kind = choose(random, 16);
  if (kind == 0) {
    const json copy = *nodes[choose(random, nodes.size())];  // may contain this one
    node = copy;
  } else if (kind == 1) {
    const std::vector<json> others = {nullptr, true, false, json::object(), json::array(), "x", 3};
    node = others[choose(random, others.size())];
  } else if (kind == 2 && choose(random, 8) == 0) {
    wrap(node, random);
  } else if (node.is_number()) {
    change_number(node, random);
  } else if (node.is_string()) {
    change_text(node, nodes, random);
  } else if (node.is_array()) {
    change_list(node, random);
  } else if (node.is_object()) {
    change_object(node, random);
  } else if (node.is_boolean()) {
    node = !node.get<bool>();
  }
}

/// A member that the other document has, in the place of the one of the same name, or next to it.
void take_part(json& document, json& other, Random& random) {
  std::vector<json*> here, there;
  collect(document, here);
  collect(other, there);
  json& target = *here[choose(random, here.size())];
  json& source = *there[choose(random, there.size())];
  if (target.is_object() && source.is_object() && !source.empty()) {
    auto member = source.begin();
    std::advance(member, static_cast<long>(choose(random, source.size())));
    target[member.key()] = member.value();
  } else if (target.is_array() && source.is_array()) {
    for (const json& element : source) target.push_back(element);
  } else {
    target = source;
  }
}

size_t write(const json& document, std::uint8_t* out, size_t max_size) {
  const std::string text = document.dump(-1, ' ', false, json::error_handler_t::replace);
  if (text.size() > max_size) return 0;
  std::memcpy(out, text.data(), text.size());
  return text.size();
}

}  // namespace

extern "C" size_t LLVMFuzzerCustomMutator(std::uint8_t* data, size_t size, size_t max_size,
                                          unsigned int seed) {
  Random random(seed + 1);
  if (choose(random, 16) == 0) return LLVMFuzzerMutate(data, size, max_size);
  json document = json::parse(data, data + size, nullptr, false);
  if (document.is_discarded()) return LLVMFuzzerMutate(data, size, max_size);
  for (size_t changes = 1 + choose(random, 3); changes > 0; --changes) {
    change_document(document, random);
  }
  const size_t written = write(document, data, max_size);
  return written > 0 ? written : LLVMFuzzerMutate(data, size, max_size);
}

extern "C" size_t LLVMFuzzerCustomCrossOver(const std::uint8_t* data1, size_t size1,
                                            const std::uint8_t* data2, size_t size2,
                                            std::uint8_t* out, size_t max_size, unsigned int seed) {
  Random random(seed + 1);
  json document = json::parse(data1, data1 + size1, nullptr, false);
  json other = json::parse(data2, data2 + size2, nullptr, false);
  if (document.is_discarded() || other.is_discarded()) return 0;
  take_part(document, other, random);
  return write(document, out, max_size);
}
