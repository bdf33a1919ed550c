// Slices of a trace as C; see printer.hpp.
#include "codegen/printer.hpp"

#include <algorithm>
#include <cstdio>
#include <functional>
#include <set>

namespace dockloop {
namespace {

class Printer {
 public:
  Printer(const Trace& trace, const std::vector<TraceFunction>& functions)
      : trace_(trace), functions_(functions), home_(trace.nodes.size(), -1), slot_(home_) {
    for (size_t f = 0; f < functions.size(); ++f) needed_.push_back(find_needed(f));
    // What a function has from an earlier one goes through the work array.
    for (size_t f = 0; f < functions.size(); ++f) {
      if (!functions[f].shares) continue;
      for (int i = 0; i < trace.size(); ++i) {
        if (needed_[f][i] && home_[i] < 0) home_[i] = static_cast<int>(f);
      }
    }
    for (size_t f = 0; f < functions.size(); ++f) {
      if (!functions[f].shares) continue;
      for (int i = 0; i < trace.size(); ++i) {
        if (home_[i] == static_cast<int>(f)) {
          for (int operand : operands(i)) share(operand, f);
        }
      }
      for (const TraceOutput& output : functions[f].outputs) share(output.node, f);
      for (const Guard& guard : functions[f].guards) {
        share(guard.big, f);
        share(guard.small, f);
      }
    }
  }

  std::string print() {
    std::string text;
    for (size_t f = 0; f < functions_.size(); ++f) text += print_function(f);
    return text;
  }
  int work() const { return slots_; }
  int operations() const { return operations_; }

 private:
  std::vector<int> operands(int i) const {
    const Node& n = trace_.nodes[i];
    if (is_given(i)) return {};
    if (n.b < 0) return {n.a};
    return {n.a, n.b};
  }
  bool is_given(int i) const { return trace_.is_constant(i) || trace_.nodes[i].op == Op::kInput; }

  std::vector<char> find_needed(size_t f) const {
    std::vector<char> needed(trace_.nodes.size(), 0);
    for (const TraceOutput& output : functions_[f].outputs) needed[output.node] = 1;
    for (const Guard& guard : functions_[f].guards) needed[guard.big] = needed[guard.small] = 1;
    for (int i = trace_.size(); i-- > 0;) {
      if (!needed[i]) continue;
      for (int operand : operands(i)) needed[operand] = 1;
    }
    return needed;
  }

  /// Function f reads this node.
  void share(int node, size_t f) {
    if (!is_given(node) && home_[node] != static_cast<int>(f) && slot_[node] < 0)
      slot_[node] = slots_++;
  }

  std::string name(int i) const {
    const Node& n = trace_.nodes[i];
    char text[40];
    if (trace_.is_constant(i)) {
      std::snprintf(text, sizeof text, n.value[0] < 0.0 ? "(%.17g)" : "%.17g", n.value[0]);
      return text;  // an integer becomes a double where it meets one
    }
    std::snprintf(text, sizeof text, "t%d", i);
    return text;
  }

  std::string print_operation(int i) {
    const Node& n = trace_.nodes[i];
    const auto call = [&](const char* function) {
      return std::string(function) + "(" + name(n.a) + (n.b < 0 ? "" : ", " + name(n.b)) + ")";
    };
    switch (n.op) {
      case Op::kConstant:
        return name(i);
      case Op::kInput:
        return "x" + std::to_string(n.a) + "[" + std::to_string(n.b) + "]";
      case Op::kNegative:
        return "-" + name(n.a);
      case Op::kAdd:
        return name(n.a) + " + " + name(n.b);
      case Op::kSubtract:
        return name(n.a) + " - " + name(n.b);
      case Op::kMultiply:
        return name(n.a) + " * " + name(n.b);
      case Op::kInverse:
        return "1.0 / " + name(n.a);
      case Op::kSqrt:
        return call("sqrt");
      case Op::kSin:
        return call("sin");
      case Op::kCos:
        return call("cos");
      case Op::kAtan2:
        return call("atan2");
      case Op::kFloor:
        return call("floor");
      case Op::kAbs:
        return call("fabs");
    }
    return "";
  }

  std::string print_function(size_t f) {
    const TraceFunction& function = functions_[f];
    std::vector<char> declared(trace_.nodes.size(), 0);
    std::set<int> arrays;
    std::string body;
    const auto put = [&](int i, const std::string& expression) {
      body += "  const double " + name(i) + " = " + expression + ";\n";
      declared[i] = 1;
    };
    // Inputs and shared numbers are read where they are first needed.
    const auto fetch = [&](int i) {
      if (declared[i] || trace_.is_constant(i)) return;
      if (trace_.nodes[i].op == Op::kInput) {
        arrays.insert(trace_.nodes[i].a);
        put(i, print_operation(i));
      } else {
        put(i, "work[" + std::to_string(slot_[i]) + "]");
      }
    };
    const auto makes = [&](int i) {
      return needed_[f][i] && !is_given(i) && (!function.shares || home_[i] == static_cast<int>(f));
    };
    std::vector<std::vector<const TraceOutput*>> writes(trace_.nodes.size());
    for (const TraceOutput& output : function.outputs) writes[output.node].push_back(&output);
    const auto write = [&](int i) {
      for (const TraceOutput* output : writes[i]) {
        arrays.insert(output->array);
        body += "  x" + std::to_string(output->array) + "[" + std::to_string(output->index) +
                "] = " + name(i) + ";\n";
      }
    };
    // Every result is followed back to what it needs: little is alive at a time.
    const std::function<void(int)> compute = [&](int i) {
      if (!makes(i) || declared[i]) return;
      for (int operand : operands(i)) compute(operand);
      for (int operand : operands(i)) fetch(operand);
      put(i, print_operation(i));
      const Op op = trace_.nodes[i].op;
      if (function.shares && op != Op::kNegative && op != Op::kAbs && op != Op::kFloor)
        ++operations_;
      if (function.shares && slot_[i] >= 0)
        body += "  work[" + std::to_string(slot_[i]) + "] = " + name(i) + ";\n";
      write(i);
    };
    for (int i = 0; i < trace_.size(); ++i) {
      if (!writes[i].empty() || slot_[i] >= 0) compute(i);
    }
    for (const Guard& guard : function.guards) {
      compute(guard.big);
      compute(guard.small);
    }
    for (int i = 0; i < trace_.size(); ++i) {
      if (writes[i].empty() || makes(i)) continue;
      fetch(i);
      write(i);
    }
    if (!function.guards.empty()) body += "  int holds = 1;\n";
    for (const Guard& guard : function.guards) {
      fetch(guard.big);
      fetch(guard.small);
      const std::string big = name(guard.big), small = name(guard.small);
      char factor[40] = "";
      if (guard.factor != 1.0) std::snprintf(factor, sizeof factor, "%.17g * ", guard.factor);
      body += "  holds &= " + std::string(factor) + small + " <= " + (guard.sign < 0 ? "-" : "") +
              big + ";\n";
    }
    body += function.guards.empty() ? "  return 1;\n" : "  return holds;\n";
    std::string head = "EXPORT CLONED int dockloop_kernel_" + function.name +
                       "(double* const* x, double* restrict work) {\n";
    for (int array : arrays) {
      head += "  double* restrict const x" + std::to_string(array) + " = x[" +
              std::to_string(array) + "];\n";
    }
    return head + "  (void)x;\n  (void)work;\n" + body + "}\n\n";
  }

  const Trace& trace_;
  const std::vector<TraceFunction>& functions_;
  std::vector<int> home_, slot_;           // per node: function that makes it, place in `work`
  std::vector<std::vector<char>> needed_;  // per function and node
  int slots_ = 0, operations_ = 0;
};

}  // namespace

std::string print_functions(const Trace& trace, const std::vector<TraceFunction>& functions,
                            int& work, int& operations) {
  Printer printer(trace, functions);
  std::string text = printer.print();
  work = printer.work();
  operations = printer.operations();
  return text;
}

}  // namespace dockloop
