// DOCK_ASSERT: a precondition that does not hold aborts with file, line and condition. In a release
// the condition is not evaluated.
#include "math/dock_assert.hpp"

#include <gtest/gtest.h>

#include "contact/cores.hpp"

namespace dockloop {
namespace {

#ifdef NDEBUG

TEST(DockAssert, ReleaseDoesNotEvaluateTheCondition) {
  int evaluated = 0;
  const auto never_holds = [&evaluated] { return ++evaluated < 0; };
  DOCK_ASSERT(never_holds());
  EXPECT_EQ(evaluated, 0);
  EXPECT_FALSE(never_holds());
}

#else

TEST(DockAssertDeathTest, NamesFileAndCondition) {
  const Core point = make_point("tip", Vec3<double>::Zero(), 0.01);
  ASSERT_FALSE(is_annulus(point));
  EXPECT_DEATH(get_annulus(point),
               "src/contact/cores.cpp:[0-9]+: precondition does not hold: is_annulus\\(core\\)");
}

TEST(DockAssert, DoesNothingWhereTheConditionHolds) {
  int evaluated = 0;
  DOCK_ASSERT(++evaluated == 1);
  EXPECT_EQ(evaluated, 1);
}

#endif

}  // namespace
}  // namespace dockloop
