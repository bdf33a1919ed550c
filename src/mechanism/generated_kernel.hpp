// A kernel made for one mechanism: straight-line code that the generator (src/codegen) has
// written and a C compiler has turned into a shared library.
//
// Library and mechanism meet in a hash of everything that the code was made from. What may change
// without a new kernel is an input of it: mass properties of the vehicle, gravity, loads, motion.
// Interface of the library (C, plain arrays of doubles):
//
//   const int dockloop_kernel_format;       kKernelFormat of the generator
//   const char dockloop_kernel_hash[];      of describe_kernel_source()
//   const int dockloop_kernel_counts[];     KernelCounts
//   int dockloop_kernel_NAME(double* const* array, double* work);
//
// NAME is `iterate` (one Newton step of all loops without a closed form), `position`, `velocity`,
// `acceleration`; `array` are the places of KernelArray, `work` what one stage leaves for the next.
// A function returns 0 if a guard has failed: what it was made for does not apply here.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "mechanism/mechanism_dynamics.hpp"

namespace dockloop {

constexpr int kKernelFormat = 2;  ///< of interface and code, to be raised with either

/// Arrays that a kernel reads and writes: members of TreeData, MechanismData and BaseMotion as they
/// lie in memory, and some of the kernel's own.
enum KernelArray {
  kKernelQ,        ///< tree.q
  kKernelNear,     ///< nq: reference pose; dependents of Newton loops: start of the step
  kKernelNext,     ///< nq: where the step leads
  kKernelTime,     ///< tree.time
  kKernelVehicle,  ///< mass, com (3), inertia (xx yy zz xy xz yz) of body 0, if it is the vehicle
  kKernelV,        ///< tree.v
  kKernelBaseW,    ///< motion of the base
  kKernelBaseAlpha,
  kKernelBaseA,
  kKernelGravity,
  kKernelTau,       ///< data.tau
  kKernelExternal,  ///< tree.external, 6 per body
  kKernelR,         ///< tree.R, 9 per body, by columns
  kKernelArm,       ///< tree.r
  kKernelP,         ///< tree.p
  kKernelMSum,      ///< tree.m_sum
  kKernelHSum,      ///< tree.h_sum
  kKernelInertia,   ///< data.A_ind, by columns
  kKernelFactor,    ///< matrix of data.factor, by columns
  kKernelW,         ///< tree.w
  kKernelU,         ///< tree.u
  kKernelVdot,      ///< data.vdot
  kKernelMomentum,  ///< data.linear_momentum
  kKernelArrayCount
};

/// What is known about a mechanism's surroundings when its kernel is made.
enum class KernelScope {
  kDocking,  ///< base at rest; loads on the vehicle, the capture body and joints with a force law
  kAny       ///< any motion of the base, loads on all independent bodies, forces in all joints
};

struct KernelCounts {
  int work = 0;        ///< doubles between the stages
  int operations = 0;  ///< + - * / and roots of position, velocity and acceleration
  int guards = 0;
};

/// Everything that a kernel depends on, as text: bodies without the vehicle's mass, loops, order,
/// closed forms and their branches, scope.
std::string describe_kernel_source(const Mechanism& mechanism, KernelScope scope);
/// 32 hexadecimal digits.
std::string find_kernel_hash(const Mechanism& mechanism, KernelScope scope);

/// Why there can be no kernel for this mechanism; empty if there can.
std::string find_kernel_obstacle(const Mechanism& mechanism);

/// Bodies whose motion a kernel finds, those that may be loaded, joints that may carry a force, and
/// joints whose coordinates the force laws read.
struct KernelBodies {
  KernelBodies(const Mechanism& mechanism, KernelScope scope);
  std::vector<int> moving, loaded, forced, sprung;
};

/// A shared library with a kernel; closed with the last kernel that uses it.
class KernelLibrary {
 public:
  using Function = int (*)(double* const*, double*);
  /// @throws ModelError if it cannot be opened, or is no kernel of this format
  explicit KernelLibrary(const std::string& file);
  const std::string& hash() const { return hash_; }
  const KernelCounts& counts() const { return counts_; }
  Function iterate, position, velocity, acceleration;

 private:
  void* find(const char* symbol) const;
  std::string file_;
  std::shared_ptr<void> handle_;  ///< of the system; closes the library
  std::string hash_;
  KernelCounts counts_;
};

/// The kernel of a library, with the workspace of one thread.
class GeneratedKernel : public MechanismKernel {
 public:
  /// @pre the hash of the library is that of the mechanism
  GeneratedKernel(const Mechanism& mechanism, std::shared_ptr<const KernelLibrary> library);
  bool calc_position(MechanismData<double>& data) override;
  void calc_velocity(const BaseMotion<double>& base, MechanismData<double>& data) override;
  void calc_acceleration(const BaseMotion<double>& base, MechanismData<double>& data) override;
  void set_vehicle(const Body& vehicle) override;

 private:
  struct Block {
    bool iterates;
    std::vector<int> q;         ///< dependents, of a Newton block
    std::vector<double> scale;  ///< their units
    LegBranch branch;
    int spin_branch;
  };
  bool is_near_accepted_pose(const MechanismData<double>& data) const;
  bool close_by_iteration();
  std::shared_ptr<const KernelLibrary> library_;
  std::vector<Block> blocks_;
  std::vector<int> ind_q_;        ///< independent coordinates of the mechanism
  std::vector<double> farthest_;  ///< how far each may be from the accepted pose
  bool iterates_ = false;
  std::vector<double> near_, next_, vehicle_, work_;
  BaseMotion<double> base_;
  std::vector<double*> array_;
};

}  // namespace dockloop
