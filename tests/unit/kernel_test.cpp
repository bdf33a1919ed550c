// Generated kernels: the same results as the general code, or no results.
//
// The build makes the kernels (CMakeLists.txt); without a C compiler there are none, and the tests
// are not compiled. Mechanisms: legs in closed form, twelve nested loops, planar loops, the same by
// Newton iteration, a ring on legs on a vehicle that floats.
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>

#include "benchmarks/kernel_states.hpp"
#include "unit/allocations.hpp"

namespace dockloop {
namespace {

Mechanism read_case(const std::string& name) {
  const auto ends = [&](const std::string& end) {
    return name.size() > end.size() && name.substr(name.size() - end.size()) == end;
  };
  const std::string folder = DOCKLOOP_TEST_DATA;
  if (ends("_newton")) {
    return read_closed_mechanism(folder + "/" + name.substr(0, name.size() - 7) + ".json", true);
  }
  if (!ends("_vehicle")) return read_closed_mechanism(folder + "/" + name + ".json");
  const Mechanism alone =
      read_closed_mechanism(folder + "/" + name.substr(0, name.size() - 8) + ".json");
  VehicleBody body;
  body.mass = 2500.0;
  body.com = Vec3<double>(0.1, -0.2, 0.3);
  body.inertia = Vec3<double>(4e3, 5e3, 6e3).asDiagonal();
  Mechanism attached(attach_vehicle(alone.model, body, Pose<double>()));
  attached.vehicle = 0;
  return attached;
}

std::shared_ptr<const KernelLibrary> open_case(const std::string& name) {
  return std::make_shared<const KernelLibrary>(std::string(DOCKLOOP_TEST_KERNELS) + "/" + name +
                                               ".so");
}

/// As the generator makes them.
KernelScope find_scope(const Mechanism& mechanism) {
  return mechanism.vehicle == kBase ? KernelScope::kAny : KernelScope::kDocking;
}

class EveryKernel : public ::testing::TestWithParam<const char*> {
 protected:
  const std::string name = GetParam();
  const Mechanism mechanism = read_case(name);
  const KernelScope scope = find_scope(mechanism);
  const std::shared_ptr<const KernelLibrary> library = open_case(name);
  KernelComparison make_comparison() const {
    return {mechanism, std::make_shared<GeneratedKernel>(mechanism, library), scope};
  }
};

TEST_P(EveryKernel, WasMadeForItsMechanism) {
  EXPECT_EQ(library->hash(), find_kernel_hash(mechanism, scope));
}

// Worst measured 2.2e-14 (planar_two_loop), of the accelerations.
TEST_P(EveryKernel, AgreesWithTheGeneralCode) {
  KernelComparison comparison = make_comparison();
  double worst = 0.0;
  for (unsigned i = 0; i < 100; ++i) {
    comparison.take_state(i);
    worst = std::max(worst, comparison.find_error());
  }
  EXPECT_LT(worst, 1e-13);
  EXPECT_GT(worst, 0.0) << "the general code was compared with itself";
}

TEST_P(EveryKernel, RepeatsBitForBit) {
  KernelComparison once = make_comparison(), again = make_comparison();
  for (unsigned i = 0; i < 20; ++i) {
    once.take_state(i);
    again.take_state(i + 100);  // what came before does not matter
    again.find_error();
    again.take_state(i);
    once.find_error();
    again.find_error();
    EXPECT_EQ(0, std::memcmp(once.special.vdot.data(), again.special.vdot.data(),
                             sizeof(double) * static_cast<size_t>(mechanism.model.nv)));
  }
}

#ifdef DOCKLOOP_COUNTS_ALLOCATIONS
TEST_P(EveryKernel, EvaluatesWithoutAllocating) {
  KernelComparison comparison = make_comparison();
  comparison.take_state(1);
  MechanismData<double>& data = comparison.special;
  EXPECT_EQ(0, count_allocations([&] {
              calc_position(mechanism, data, Need::kRates);
              calc_velocity(mechanism, comparison.base, data);
              calc_acceleration(mechanism, comparison.base, data);
            }));
  EXPECT_EQ(data.found, Need::kRates);
}
#endif

// Nothing is known of a pose that no accepted one leads to, or that is near a singular one.
TEST_P(EveryKernel, LeavesDoubtToTheGeneralCode) {
  KernelComparison comparison = make_comparison();
  MechanismData<double>& data = comparison.special;
  comparison.take_state(1);
  data.loops.reference.valid = false;
  EXPECT_TRUE(calc_position(mechanism, data, Need::kRates).ok());
  EXPECT_EQ(data.found, Need::kState);
  data.loops.reference.valid = true;
  data.loops.reference.margin[0] = 0.01;
  EXPECT_TRUE(calc_position(mechanism, data, Need::kRates).ok());
  EXPECT_EQ(data.found, Need::kState);
  calc_velocity(mechanism, comparison.base, data);
  calc_acceleration(mechanism, comparison.base, data);
  calc_position(mechanism, comparison.general, Need::kRates);
  calc_velocity(mechanism, comparison.base, comparison.general);
  calc_acceleration(mechanism, comparison.base, comparison.general);
  EXPECT_EQ(data.vdot, comparison.general.vdot);
  data.loops.reference.margin[0] = 1.0;
  EXPECT_TRUE(calc_position(mechanism, data, Need::kRates).ok());
  EXPECT_EQ(data.found, Need::kRates);
}

// What a kernel does not fill is found by the general code.
TEST_P(EveryKernel, IsNotUsedWhereMoreIsNeeded) {
  KernelComparison comparison = make_comparison();
  comparison.take_state(1);
  MechanismData<double>& data = comparison.special;
  for (const Need need : {Need::kState, Need::kEverything}) {
    EXPECT_TRUE(calc_position(mechanism, data, need).ok());
    EXPECT_EQ(data.found, need);
  }
}

TEST_P(EveryKernel, FailsWhereTheGeneralCodeFails) {
  KernelComparison comparison = make_comparison();
  int failures = 0;
  for (unsigned i = 0; i < 300; ++i) {
    comparison.take_state(i, i < 200 ? 0.05 + 0.001 * i : 0.6);
    const Status general = calc_position(mechanism, comparison.general, Need::kRates);
    const Status special = calc_position(mechanism, comparison.special, Need::kRates);
    EXPECT_EQ(general.code, special.code) << "state " << i;
    failures += general.ok() ? 0 : 1;
    if (!special.ok() || comparison.special.found != Need::kRates) continue;
    EXPECT_TRUE(comparison.special.A_ind.allFinite());
    EXPECT_LT((comparison.special.A_ind - comparison.general.A_ind).norm(),
              1e-9 * comparison.general.A_ind.norm())
        << "state " << i << " lies on another branch";
  }
  EXPECT_TRUE(failures > 10 || name != "crank_nested");
}

INSTANTIATE_TEST_SUITE_P(Kernels, EveryKernel,
                         ::testing::Values("hexapod_r2p1r3", "crank_nested", "planar_two_loop",
                                           "planar_two_loop_newton", "hexapod_r2p1r3_newton",
                                           "hexapod_r2p1r3_vehicle"),
                         [](const auto& at) { return std::string(at.param); });

TEST(Kernel, TakesTheMassOfTheVehicleAsItIs) {
  Mechanism mechanism = read_case("hexapod_r2p1r3_vehicle");
  const auto library = open_case("hexapod_r2p1r3_vehicle");
  Body& vehicle = mechanism.model.bodies[0];
  vehicle.mass = 77.0;
  vehicle.com = Vec3<double>(0.0, 0.02, -0.03);
  vehicle.inertia << 30.0, 1.0, 2.0, 1.0, 40.0, 3.0, 2.0, 3.0, 50.0;
  const std::shared_ptr<MechanismKernel> kernel = make_generated_kernel(mechanism, library);
  ASSERT_TRUE(kernel);
  KernelComparison comparison(mechanism, kernel, KernelScope::kDocking);
  comparison.take_state(3);
  EXPECT_LT(comparison.find_error(), 1e-13);
}

TEST(Kernel, IsNotUsedForAnotherMechanism) {
  Mechanism mechanism = read_case("crank_nested");
  const auto library = open_case("crank_nested");
  for (Body& body : mechanism.model.bodies) body.mass *= 1.0 + 1e-15;
  EXPECT_NE(library->hash(), find_kernel_hash(mechanism, KernelScope::kAny));
  EXPECT_EQ(make_generated_kernel(mechanism, library), nullptr);
  EXPECT_EQ(make_generated_kernel(mechanism, nullptr), nullptr);
}

TEST(Kernel, IsRefusedByNameIfItIsNone) {
  const std::string file = ::testing::TempDir() + "no_kernel.so";
  std::ofstream(file) << "not a library";
  try {
    KernelLibrary library(file);
    FAIL();
  } catch (const ModelError& error) {
    EXPECT_NE(std::string(error.what()).find("no_kernel.so"), std::string::npos);
  }
}

// + - * / and roots of an evaluation with moving base and all loads, linear momentum included, as
// `dockloop-kernel` prints them; the general code makes several times as many
// (tests/unit/operation_counts_test.cpp).
TEST(Kernel, HasNoMoreOperationsThanItHad) {
  EXPECT_LE(open_case("hexapod_r2p1r3")->counts().operations, 6434);
  EXPECT_LE(open_case("crank_nested")->counts().operations, 15062);
  EXPECT_LE(open_case("planar_two_loop")->counts().operations, 676);
}

}  // namespace
}  // namespace dockloop
