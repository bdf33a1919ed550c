// The hand-written hexapod, by which benchmarks measure the core, is the same mechanism.
// 1. accelerations of the ring, cut forces and the load on the base are those of the core.
#include <gtest/gtest.h>

#include "benchmarks/hand_written_hexapod.hpp"
#include "benchmarks/mechanism_evaluation.hpp"
#include "unit/test_helpers.hpp"

namespace dockloop {
namespace {

constexpr double kSame = 3e-13;  // worst residual 2.3e-14

TEST(HandWrittenHexapod, moves_and_loads_its_base_like_the_core) {
  MechanismEvaluation core(DOCKLOOP_MODELS "/mechanisms/hexapod_bench.json");
  HandWrittenHexapod hexapod(core.mechanism);
  Residual difference;
  for (int k = 0; k < MechanismEvaluation::kStates; ++k) {
    core.put_next_state();
    ASSERT_TRUE(core.calc_accelerations());
    calc_reactions(core.mechanism, core.base, kBase, core.data);
    double y[HandWrittenHexapod::kStates], dy[HandWrittenHexapod::kStates];
    HandWrittenHexapod::Reactions reactions;
    HandWrittenHexapod::get_state(core.data.tree, y);
    hexapod.calc_rates<true>(y, dy, &reactions);

    // A free joint has its velocities in body axes.
    const TreeData<double>& tree = core.data.tree;
    const Vec3<double> v = tree.v.segment<3>(0), w = tree.v.segment<3>(3);
    const Vec3<double> a = tree.R[0] * (core.data.vdot.segment<3>(0) + w.cross(v));
    const Vec3<double> alpha = tree.R[0] * core.data.vdot.segment<3>(3);
    difference.add(find_relative_error(Eigen::Map<Vec3<double>>(dy + 7), a), "acceleration");
    difference.add(find_relative_error(Eigen::Map<Vec3<double>>(dy + 10), alpha), "turning");
    difference.add(find_relative_error(reactions.force, core.data.on_base.f), "force on the base");
    difference.add(find_relative_error(reactions.torque, core.data.on_base.t), "moment on it");
    for (int i = 0; i < HandWrittenHexapod::kLegs; ++i) {
      Vec3<double> cut;
      for (int j = 0; j < 3; ++j) {
        cut[j] = get_cut_force(core.mechanism.plan, core.data.loops, i, j);
      }
      difference.add(find_relative_error(reactions.cut_force[i], cut), "cut force");
    }
  }
  EXPECT_RESIDUAL_BELOW(difference, kSame);
}

}  // namespace
}  // namespace dockloop
