#include "spm/mesh_probe.hpp"

#include <gtest/gtest.h>

#include "spm/offline/generate.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/support/shown_mesh.hpp"

namespace tactus::spm {
namespace {

TEST(MeshProbeAllocation, NothingIsAllocatedWhileAProbeIsPlacedAndQueried) {
  const offline::TriangleMesh organ = offline::generate(offline::Shape::kOrgan, 20000), tool = offline::stylus();
  const test_support::ShownMesh shown{organ};
  const MeshProbe stylus{tool.positions, tool.faces};
  PlacedProbe placed{stylus};
  std::vector<MeshContact> contacts(10000);
  std::uint64_t allocations = 0, found = 0;
  for (std::size_t v = 0; v < organ.positions.size(); v += 100) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    for (int axis = 0; axis < 3; ++axis) pose.translation()[axis] = organ.positions[v][axis];
    const test_support::AllocationCounter guard;
    placed.set_pose(pose);
    found += placed.find_contacts(shown.tree(), contacts.data(), 10000).contacts;
    allocations += guard.count();
  }
  EXPECT_EQ(allocations, 0u);
  EXPECT_GT(found, 1000u);
}

}  // namespace
}  // namespace tactus::spm
