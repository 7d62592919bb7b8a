#include <gtest/gtest.h>

#include <cmath>

#include "haptics/rigid_body.hpp"
#include "tests/haptics/tool_shapes.hpp"
#include "tests/support/allocation_counter.hpp"

namespace tactus::haptics {
namespace {

TEST(ToolAllocation, NothingIsAllocatedInAToolsStepsInAndOutOfContact) {
  const testing::TriangleMesh organ = spm::offline::generate(spm::offline::Shape::kOrgan, 20000);
  const testing::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  const test_support::ShownMesh shown{organ};
  Tool tool{probe};
  const ToolObject object = testing::object_of(shown, 0.3);
  int contacts = 0;
  std::uint64_t allocations = 0;
  {
    const test_support::AllocationCounter guard;
    for (int ms = 0; ms < 2000; ++ms) {
      const double t = ms * 1e-3;
      const ToolPose device{{0.02 * std::sin(9 * t), 0.01 * std::cos(5 * t), 0.08 - 0.06 * std::sin(t)},
                            exp_map({2 * t, std::sin(7 * t), t})};
      contacts += tool.step(device, 1e-3, {&object, 1}, ms % 3 == 0).in_contact ? 1 : 0;
    }
    allocations = guard.count();
  }
  EXPECT_EQ(allocations, 0u);
  EXPECT_GT(contacts, 200);
}

}  // namespace
}  // namespace tactus::haptics
