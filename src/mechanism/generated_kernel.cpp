// What a kernel is made from, its library, and how it is called; see generated_kernel.hpp.
#include "mechanism/generated_kernel.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "model/text_hash.hpp"

#ifdef _WIN32
#include <windows.h>

#include <filesystem>
#else
#include <dlfcn.h>
#endif

namespace dockloop {
namespace {

/// Text of numbers that differ in any bit differs.
class Text {
 public:
  Text& operator<<(const std::string& word) {
    text_ += word + ' ';
    return *this;
  }
  Text& operator<<(int number) { return *this << std::to_string(number); }
  Text& operator<<(double number) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.17g", number);
    return *this << std::string(digits);
  }
  template <class Derived>
  Text& operator<<(const Eigen::MatrixBase<Derived>& matrix) {
    for (int j = 0; j < matrix.cols(); ++j) {
      for (int i = 0; i < matrix.rows(); ++i) *this << static_cast<double>(matrix(i, j));
    }
    return *this;
  }
  Text& operator<<(const std::vector<int>& list) {
    *this << static_cast<int>(list.size());
    for (int number : list) *this << number;
    return *this;
  }
  Text& operator<<(const Pose<double>& pose) { return *this << pose.R << pose.p; }
  const std::string& get() const { return text_; }

 private:
  std::string text_;
};

void describe(const Loop& loop, Text& text) {
  text << "loop" << loop.root << loop.first << loop.terminal << loop.closing
       << static_cast<int>(loop.cut) << loop.point_on_terminal << loop.point_on_closing
       << loop.axis_on_terminal << loop.axis_on_closing << loop.plane_axes_in_root << loop.offset
       << loop.rate << loop.dependent << loop.redundant;
  for (const CouplingTerm& term : loop.terms) text << term.body << term.ratio;
}

void describe(const ClosedForm& form, Text& text) {
  text << "form" << static_cast<int>(form.kind) << form.shape.l1 << form.shape.l2
       << form.shape.height << form.shape.tip << form.shape.slide << form.branch.elbow
       << form.branch.flip << form.in_parent << form.parent_on_terminal;
  for (const JointMap& joint : form.joint) {
    text << joint.body << joint.row << joint.sign << joint.c << joint.s;
  }
  if (form.spin) text << "spin" << form.spin->body << form.spin->cross_axis << form.spin->branch;
}

}  // namespace

std::string describe_kernel_source(const Mechanism& mechanism, KernelScope scope) {
  const MechanismModel& model = mechanism.model;
  Text text;
  text << "dockloop-kernel" << kKernelFormat << static_cast<int>(scope) << mechanism.vehicle
       << model.capture_body;
  for (const int body : model.contact_bodies) text << "contact" << body;
  for (size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    text << "body" << body.parent << static_cast<int>(body.joint) << body.axis << body.placement;
    if (body.joint == JointType::kMode) text << body.axis_of_rotation;
    if (static_cast<int>(i) != mechanism.vehicle) text << body.mass << body.com << body.inertia;
  }
  for (const Loop& loop : model.loops) describe(loop, text);
  for (const LoopBlock& block : mechanism.plan.blocks) {
    text << "block" << block.loops << block.dep << block.low;
    if (block.form()) describe(*block.form(), text);
  }
  if (model.carrier != mechanism.vehicle) text << "carrier" << model.carrier;
  const KernelBodies bodies(mechanism, scope);
  text << "bodies" << bodies.loaded << bodies.forced << bodies.sprung;
  return text.get();
}

std::string find_kernel_hash(const Mechanism& mechanism, KernelScope scope) {
  return hash_text(describe_kernel_source(mechanism, scope));
}

std::string find_kernel_obstacle(const Mechanism& mechanism) {
  if (mechanism.plan.ind_v.empty()) return "nothing moves";
  if (mechanism.plan.is_driven) return "a joint is driven, and its forces are needed everywhere";
  return "";
}

KernelBodies::KernelBodies(const Mechanism& mechanism, KernelScope scope) {
  const MechanismModel& model = mechanism.model;
  const auto add = [](std::vector<int>& list, int body) {
    if (body != kBase && std::find(list.begin(), list.end(), body) == list.end())
      list.push_back(body);
  };
  moving = mechanism.plan.ind_bodies;
  const auto add_contact_bodies = [&](std::vector<int>& list) {
    add(list, model.capture_body);
    for (const int body : model.contact_bodies) add(list, body);
  };
  add_contact_bodies(moving);
  add(moving, model.carrier);
  for (const JointForce& force : model.forces) add(sprung, force.body);
  for (const ForceElement& element : model.elements) {
    for (const ElementTerm& term : element.along) add(sprung, term.body);
  }
  if (scope == KernelScope::kAny) {
    loaded = moving;
    for (int i = 0; i < static_cast<int>(model.bodies.size()); ++i) forced.push_back(i);
  } else {
    add(loaded, mechanism.vehicle);
    add(loaded, model.carrier);
    add_contact_bodies(loaded);
    forced = sprung;
  }
}

// ---------------------------------------------------------------- the library

KernelLibrary::KernelLibrary(const std::string& file) : file_(file) {
#ifdef _WIN32
  const HMODULE handle = LoadLibraryW(std::filesystem::u8path(file).c_str());
  if (!handle) throw ModelError(file + ": cannot be loaded");
  handle_ = {handle, [](void* h) { FreeLibrary(static_cast<HMODULE>(h)); }};
#else
  void* handle = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle) throw ModelError(file + ": cannot be loaded: " + dlerror());
  handle_ = {handle, [](void* h) { dlclose(h); }};
#endif
  const int format = *static_cast<const int*>(find("dockloop_kernel_format"));
  if (format != kKernelFormat) {
    throw ModelError(file + ": is a kernel of format " + std::to_string(format) +
                     ", this is format " + std::to_string(kKernelFormat));
  }
  hash_ = static_cast<const char*>(find("dockloop_kernel_hash"));
  const int* counts = static_cast<const int*>(find("dockloop_kernel_counts"));
  counts_ = {counts[0], counts[1], counts[2]};
  const auto function = [this](const char* symbol) {
    return reinterpret_cast<Function>(find(symbol));
  };
  iterate = function("dockloop_kernel_iterate");
  position = function("dockloop_kernel_position");
  velocity = function("dockloop_kernel_velocity");
  acceleration = function("dockloop_kernel_acceleration");
}

void* KernelLibrary::find(const char* symbol) const {
#ifdef _WIN32
  void* found =
      reinterpret_cast<void*>(GetProcAddress(static_cast<HMODULE>(handle_.get()), symbol));
#else
  void* found = dlsym(handle_.get(), symbol);
#endif
  if (!found) throw ModelError(file_ + ": is no kernel: it has no " + std::string(symbol));
  return found;
}

// ---------------------------------------------------------------- calls

GeneratedKernel::GeneratedKernel(const Mechanism& mechanism,
                                 std::shared_ptr<const KernelLibrary> library)
    : library_(std::move(library)),
      near_(static_cast<size_t>(mechanism.model.nq), 0.0),
      next_(near_),
      vehicle_(10, 0.0),
      work_(static_cast<size_t>(library_->counts().work), 0.0),
      array_(kKernelArrayCount, nullptr) {
  for (const LoopBlock& b : mechanism.plan.blocks) {
    Block block{!b.form() && !b.is_coupling, {}, {}, {}, 1};
    if (b.form()) block.branch = b.form()->branch;
    if (b.form() && b.form()->spin) block.spin_branch = b.form()->spin->branch;
    for (int i = 0; block.iterates && i < b.size(); ++i) {
      block.q.push_back(mechanism.model.bodies[b.dep_bodies[i]].q_index);
      block.scale.push_back(b.dep_scale[i]);
    }
    iterates_ = iterates_ || block.iterates;
    blocks_.push_back(block);
  }
  constexpr double kFarthest = 0.1;  // rad, or part of the largest loop
  double size = 0.0;
  for (const double length : mechanism.plan.loop_size) size = std::max(size, length);
  for (int i : mechanism.plan.ind_bodies) {
    if (i == mechanism.vehicle) continue;
    const Body& body = mechanism.model.bodies[i];
    for (int j = 0; j < body.nq(); ++j) {
      const bool is_angle = body.joint == JointType::kRevolute;
      const bool is_quaternion = body.joint == JointType::kFree && j >= 3;
      ind_q_.push_back(body.q_index + j);
      farthest_.push_back(kFarthest * (is_angle ? 1.0 : is_quaternion ? 0.5 : size));
    }
  }
  if (mechanism.vehicle != kBase) {
    set_vehicle(mechanism.model.bodies[mechanism.vehicle]);
  }
}

void GeneratedKernel::set_vehicle(const Body& vehicle) {
  Eigen::Map<Eigen::Matrix<double, 10, 1>>(vehicle_.data()) << vehicle.mass, vehicle.com,
      get_components(vehicle.inertia);
}

/// Is the accepted pose far from every singular one, on the branch that the kernel was made for,
/// and so near that the mechanism has stayed on it?
bool GeneratedKernel::is_near_accepted_pose(const MechanismData<double>& data) const {
  constexpr double kMargin = 0.1;
  const LoopReference<double>& reference = data.loops.reference;
  if (blocks_.empty()) return true;
  if (!reference.valid) return false;
  for (size_t b = 0; b < blocks_.size(); ++b) {
    if (!(reference.margin[b] >= kMargin)) return false;
    if (reference.branch[b].elbow != blocks_[b].branch.elbow ||
        reference.branch[b].flip != blocks_[b].branch.flip ||
        reference.spin_branch[b] != blocks_[b].spin_branch)
      return false;
  }
  for (size_t i = 0; i < ind_q_.size(); ++i) {
    const int at = ind_q_[i];
    if (!(std::abs(data.tree.q[at] - reference.q[at]) <= farthest_[i])) return false;
  }
  return true;
}

/// Newton iteration, until one more step (which `position` makes) reaches rounding.
bool GeneratedKernel::close_by_iteration() {
  constexpr int kIterations = 8;
  constexpr double kNearly = 1e-8, kFarthest = 0.3;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    library_->iterate(array_.data(), work_.data());
    double moved = 0.0;
    for (const Block& block : blocks_) {
      for (size_t i = 0; i < block.q.size(); ++i) {
        const int at = block.q[i];
        moved = std::max(moved, std::abs(next_[at] - near_[at]) / block.scale[i]);
        near_[at] = next_[at];
      }
    }
    if (!(moved <= kFarthest)) return false;
    if (moved <= kNearly) return true;
  }
  return false;
}

bool GeneratedKernel::calc_position(MechanismData<double>& data) {
  static_assert(sizeof(Vec3<double>) == 3 * sizeof(double), "arrays of vectors are plain");
  static_assert(sizeof(Mat3<double>) == 9 * sizeof(double), "arrays of matrices are plain");
  static_assert(sizeof(Wrench<double>) == 6 * sizeof(double), "arrays of wrenches are plain");
  if (!is_near_accepted_pose(data)) return false;
  std::copy_n(data.loops.reference.q.data(), near_.size(), near_.begin());
  TreeData<double>& tree = data.tree;
  const auto put = [this](KernelArray array, double* at) { array_[array] = at; };
  put(kKernelQ, tree.q.data());
  put(kKernelNear, near_.data());
  put(kKernelNext, next_.data());
  put(kKernelTime, &tree.time);
  put(kKernelVehicle, vehicle_.data());
  put(kKernelV, tree.v.data());
  put(kKernelBaseW, base_.w.data());
  put(kKernelBaseAlpha, base_.alpha.data());
  put(kKernelBaseA, base_.a.data());
  put(kKernelGravity, base_.gravity.data());
  put(kKernelTau, data.tau.data());
  put(kKernelExternal, tree.external.data()->f.data());
  put(kKernelR, tree.R.data()->data());
  put(kKernelArm, tree.r.data()->data());
  put(kKernelP, tree.p.data()->data());
  put(kKernelMSum, tree.m_sum.data());
  put(kKernelHSum, tree.h_sum.data()->data());
  put(kKernelInertia, data.A_ind.data());
  put(kKernelFactor, data.factor.data());
  put(kKernelW, tree.w.data()->data());
  put(kKernelU, tree.u.data()->data());
  put(kKernelVdot, data.vdot.data());
  put(kKernelMomentum, data.linear_momentum.data());
  if (iterates_ && !close_by_iteration()) return false;
  return library_->position(array_.data(), work_.data()) != 0;
}

void GeneratedKernel::calc_velocity(const BaseMotion<double>& base, MechanismData<double>&) {
  base_ = base;
  library_->velocity(array_.data(), work_.data());
}

void GeneratedKernel::calc_acceleration(const BaseMotion<double>& base, MechanismData<double>&) {
  base_ = base;
  library_->acceleration(array_.data(), work_.data());
}

}  // namespace dockloop
