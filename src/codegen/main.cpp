// dockloop-kernel: writes the kernel of a mechanism as C, by running the algorithms of the core
// with a number that remembers how it was computed (trace.hpp). What a kernel is:
// src/mechanism/README.md.
//
// The algorithms are templates that the library holds for its own scalars only; their definitions
// (*_body.hpp) are therefore included here, with the list of scalars replaced.
#include "codegen/trace.hpp"

#define DOCK_INSTANTIATE_FOR_SCALARS(X) X(Symbolic)

#include <fstream>
#include <iostream>
#include <iterator>

#include "codegen/printer.hpp"
#include "docking/scene_mechanism.hpp"
#include "loops/closed_form_body.hpp"
#include "loops/leg_geometry_body.hpp"
#include "loops/leg_platforms_body.hpp"
#include "loops/loop_equations_body.hpp"
#include "loops/loop_position_body.hpp"
#include "loops/loop_reduction_body.hpp"
#include "mechanism/generated_kernel.hpp"
#include "mechanism/mechanism_dynamics_body.hpp"
#include "tree/tree_body.hpp"

namespace dockloop {
namespace {

const char* const kUsage =
    "usage: dockloop-kernel scene MODEL.json\n"
    "         the mechanism of a scene, as its simulation has it\n"
    "       dockloop-kernel mechanism FILE.json [newton|vehicle]\n"
    "         by itself, on a base that moves, with any loads; the same without closed forms; or "
    "on\n"
    "         a vehicle that floats, loaded as in a docking\n"
    "prints C on standard output; exit status 1: no kernel can be made, 2: bad usage or file\n";

Symbolic make_input(KernelArray array, int index, double home, double way) {
  return Symbolic::at(current_trace->make_input(array, index, home, way));
}

template <class Vector>
void make_inputs(KernelArray array, int first, Vector&& v) {
  for (int j = 0; j < v.size(); ++j) v[j] = make_input(array, first + j, 0.3 + 0.1 * j, 1.0);
}

/// Mass properties that no other number equals: wherever one turns up, it is the input.
void mark_vehicle(Mechanism& mechanism) {
  if (mechanism.vehicle == kBase) return;
  Body& body = mechanism.model.bodies[mechanism.vehicle];
  const auto mark = [](int index, double value) {
    const double odd = value * (1.0 + 1e-3 * std::sqrt(2.0 + index));
    current_trace->mark_input(odd, kKernelVehicle, index);
    return odd;
  };
  body.mass = mark(0, 1e4);
  for (int j = 0; j < 3; ++j) body.com[j] = mark(1 + j, 0.1);
  Vec6<double> inertia;
  for (int j = 0; j < 6; ++j) inertia[j] = mark(4 + j, j < 3 ? 1e5 : 1e3);
  body.inertia = make_symmetric(inertia);
}

/// Runs the three stages at the home pose and collects what each has to write.
///
/// A vehicle on a base at rest may stand anywhere: inertia and accelerations, in body axes, are the
/// same. The stages then run in its axes (it stands at zero), and what comes in and goes out is
/// turned.
class Recorder {
 public:
  Recorder(const Mechanism& mechanism, KernelScope scope)
      : mechanism_(mechanism), bodies_(mechanism, scope), data_(mechanism) {
    if (scope == KernelScope::kAny) {
      make_inputs(kKernelBaseW, 0, base_.w);
      make_inputs(kKernelBaseAlpha, 0, base_.alpha);
      make_inputs(kKernelBaseA, 0, base_.a);
    }
    in_vehicle_axes_ = scope == KernelScope::kDocking && mechanism.vehicle != kBase;
    make_inputs(kKernelGravity, 0, base_.gravity);
  }

  std::vector<TraceFunction> record() {
    std::vector<TraceFunction> functions(4);
    record_position(functions[0], functions[1]);
    record_velocity(functions[2]);
    record_acceleration(functions[3]);
    return functions;
  }

 private:
  void record_position(TraceFunction& iterate, TraceFunction& position) {
    const MechanismModel& model = mechanism_.model;
    TreeData<Symbolic>& tree = data_.tree;
    for (int i = 0; i < model.nq; ++i) {
      tree.q[i] = make_input(kKernelNear, i, model.home_q[i], 0.02);
    }
    for (int i : mechanism_.plan.ind_q) tree.q[i] = make_input(kKernelQ, i, model.home_q[i], 0.02);
    if (in_vehicle_axes_) {
      vehicle_ = {quat_to_matrix<Symbolic>(tree.q.segment<4>(3)), tree.q.head<3>()};
      base_.gravity = (vehicle_.R.transpose() * base_.gravity).eval();
      for (int i = 0; i < 7; ++i) tree.q[i] = Symbolic(i == 3 ? 1.0 : 0.0);
    }
    tree.time = make_input(kKernelTime, 0, 0.0, 1.0);
    const Status status = calc_position(mechanism_, data_, Need::kRates);
    if (!status.ok()) throw ModelError("the mechanism cannot be evaluated at home");
    iterate.name = "iterate";
    iterate.shares = false;
    for (const LoopBlock& block : mechanism_.plan.blocks) {
      if (block.form() || block.is_coupling) continue;
      for (int body : block.dep_bodies) {
        const int q = model.bodies[body].q_index;
        iterate.outputs.push_back({kKernelNext, q, tree.q[q].node});
      }
    }
    position.name = "position";
    position.guards = current_trace->guards;
    for (int i : bodies_.sprung) {
      if (!is_independent(i)) add(position, kKernelQ, model.bodies[i].q_index, tree.q);
    }
    for (int i : bodies_.moving) {
      const Mat3<Symbolic> R = vehicle_.R * tree.R[i];
      for (int j = 0; j < 9; ++j) {
        position.outputs.push_back({kKernelR, 9 * i + j, R(j % 3, j / 3).node});
      }
      const bool is_vehicle = in_vehicle_axes_ && i == mechanism_.vehicle;
      add(position, kKernelArm, 3 * i, is_vehicle ? vehicle_.p : turn(tree.r[i]));
      add(position, kKernelP, 3 * i, Vec3<Symbolic>(vehicle_.p + turn(tree.p[i])));
    }
    if (mechanism_.vehicle != kBase) {
      position.outputs.push_back({kKernelMSum, 0, tree.m_sum[0].node});
      add(position, kKernelHSum, 0, turn(tree.h_sum[0]));
    }
    const int n = static_cast<int>(data_.A_ind.rows());
    for (int j = 0; j < n; ++j) {
      for (int i = 0; i < n; ++i) {
        position.outputs.push_back({kKernelInertia, n * j + i, data_.A_ind(i, j).node});
        if (i < j) continue;
        position.outputs.push_back({kKernelFactor, n * j + i, data_.factor.matrixLLT()(i, j).node});
      }
    }
  }

  void record_velocity(TraceFunction& velocity) {
    TreeData<Symbolic>& tree = data_.tree;
    for (int i : mechanism_.plan.ind_v) tree.v[i] = make_input(kKernelV, i, 0.1, 1.0);
    calc_velocity(mechanism_, base_, data_);
    velocity.name = "velocity";
    for (int i : bodies_.sprung) {
      if (!is_independent(i)) add(velocity, kKernelV, mechanism_.model.bodies[i].v_index, tree.v);
    }
    for (int i : bodies_.moving) {
      add(velocity, kKernelW, 3 * i, turn(tree.w[i]));
      add(velocity, kKernelU, 3 * i, turn(tree.u[i]));
    }
  }

  void record_acceleration(TraceFunction& acceleration) {
    const MechanismModel& model = mechanism_.model;
    data_.tau.setZero();
    for (int i : bodies_.forced) {
      const Body& body = model.bodies[i];
      for (int j = 0; j < body.nv(); ++j) {
        data_.tau[body.v_index + j] = make_input(kKernelTau, body.v_index + j, 1.0, 1.0);
      }
    }
    for (int i : bodies_.loaded) {
      Wrench<Symbolic> load;
      make_inputs(kKernelExternal, 6 * i, load.f);
      make_inputs(kKernelExternal, 6 * i + 3, load.t);
      data_.tree.external[i] = {vehicle_.R.transpose() * load.f, vehicle_.R.transpose() * load.t};
    }
    calc_acceleration(mechanism_, base_, data_);
    acceleration.name = "acceleration";
    for (int i : mechanism_.plan.ind_v) {
      acceleration.outputs.push_back({kKernelVdot, i, data_.vdot[i].node});
    }
    if (mechanism_.vehicle == kBase) {
      add(acceleration, kKernelMomentum, 0, data_.linear_momentum);
    }
  }

  Vec3<Symbolic> turn(const Vec3<Symbolic>& v) const { return vehicle_.R * v; }
  bool is_independent(int body) const {
    const std::vector<int>& ind = mechanism_.plan.ind_bodies;
    return std::find(ind.begin(), ind.end(), body) != ind.end();
  }
  static void add(TraceFunction& function, KernelArray array, int first, const Vec3<Symbolic>& v) {
    for (int j = 0; j < 3; ++j) function.outputs.push_back({array, first + j, v[j].node});
  }
  static void add(TraceFunction& function, KernelArray array, int index,
                  const VecX<Symbolic>& all) {
    function.outputs.push_back({array, index, all[index].node});
  }

  const Mechanism& mechanism_;
  KernelBodies bodies_;
  MechanismData<Symbolic> data_;
  BaseMotion<Symbolic> base_;
  bool in_vehicle_axes_ = false;
  Pose<Symbolic> vehicle_;  // pose of the vehicle then, else nothing
};

std::string write_kernel(Mechanism mechanism, KernelScope scope) {
  const std::string obstacle = find_kernel_obstacle(mechanism);
  if (!obstacle.empty()) throw ModelError(obstacle);
  const std::string hash = find_kernel_hash(mechanism, scope);
  Trace made;
  current_trace = &made;
  mark_vehicle(mechanism);
  const std::vector<TraceFunction> functions = Recorder(mechanism, scope).record();
  int work = 0, operations = 0;
  const std::string body = print_functions(made, functions, work, operations);
  const int guards = static_cast<int>(functions[1].guards.size());
  std::cerr << "operations " << operations << ", guards " << guards << ", work " << work << "\n";
  return "/* Kernel of a mechanism, written by dockloop-kernel; see src/mechanism/README.md. */\n"
         "#include <math.h>\n\n"
         "#ifdef _WIN32\n#define EXPORT __declspec(dllexport)\n#else\n"
         "#define EXPORT __attribute__((visibility(\"default\")))\n#endif\n\n"
         "/* Once more for new processors; the same operations, and so the same bits. */\n"
         "#if defined(__x86_64__) && defined(__GLIBC__) && !defined(__clang__) && __GNUC__ >= 12\n"
         "#define CLONED __attribute__((target_clones(\"arch=x86-64-v3\", \"default\")))\n"
         "#else\n#define CLONED\n#endif\n\n"
         "EXPORT const int dockloop_kernel_format = " +
         std::to_string(kKernelFormat) + ";\nEXPORT const char dockloop_kernel_hash[] = \"" + hash +
         "\";\nEXPORT const int dockloop_kernel_counts[] = {" + std::to_string(work) + ", " +
         std::to_string(operations) + ", " + std::to_string(guards) + "};\n\n" + body;
}

std::string read_file(const std::string& name) {
  std::ifstream stream(name, std::ios::binary);
  if (!stream) throw ModelError("cannot read " + name);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

int run(const std::vector<std::string>& arguments) {
  if (arguments.size() == 2 && arguments[0] == "scene") {
    const Scene scene = read_scene(read_file(arguments[1]), arguments[1]);
    Mechanism mechanism = make_scene_mechanism(scene);
    std::cout << write_kernel(std::move(mechanism), KernelScope::kDocking);
    return 0;
  }
  if (arguments.size() >= 2 && arguments[0] == "mechanism") {
    const std::string form = arguments.size() > 2 ? arguments[2] : "";
    KernelScope scope = KernelScope::kAny;
    Mechanism mechanism(read_mechanism(read_file(arguments[1]), arguments[1]), form == "newton");
    close_home(mechanism, arguments[1]);
    if (form == "vehicle") {
      mechanism = Mechanism(attach_vehicle(mechanism.model, {}, {}));
      mechanism.vehicle = 0;
      scope = KernelScope::kDocking;
    }
    std::cout << write_kernel(std::move(mechanism), scope);
    return 0;
  }
  std::cerr << kUsage;
  return 2;
}

}  // namespace
}  // namespace dockloop

int main(int argc, char** argv) {
  try {
    return dockloop::run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
