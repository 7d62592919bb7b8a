#include "bench/surface_path.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "spm/fcl/fixed_mesh.hpp"
#include "spm/offline/generate.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;
using spm::offline::Shape;

constexpr double kRadius = 0.003;
constexpr double kDepth = 0.0002;
constexpr double kStep = 0.00005;

class SurfacePath : public testing::TestWithParam<Shape> {};

TEST_P(SurfacePath, HasConstantSpeedAndTouchesTheSurfaceInEveryPose) {
  const spm::offline::TriangleMesh mesh = spm::offline::generate(GetParam(), 4000, 3);
  const spm::fcl::FixedMesh fixed{mesh.positions, mesh.faces};
  const auto distance = [&](const Vec3d& p) { return fixed.distance(p); };
  const auto path = surface_path(mesh.positions, mesh.faces, {kRadius, kDepth, kStep, 4000, 11}, distance);
  ASSERT_EQ(path.size(), 4000u);
  std::size_t shallow = 0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    // The distance of two poses is the step, or shorter where the path has a corner between them.
    const double step = (path[i] - path[i - 1]).norm();
    ASSERT_LE(step, kStep * (1 + 1e-9)) << "pose " << i;
    const double height = distance(path[i]);
    ASSERT_LT(height, kRadius) << "pose " << i << " does not touch";
    shallow += height > kRadius - 2 * kDepth ? 1 : 0;
  }
  EXPECT_GT(shallow, path.size() * 95 / 100);
}

INSTANTIATE_TEST_SUITE_P(Shapes, SurfacePath, testing::Values(Shape::kSphere, Shape::kTorus, Shape::kTerrain));

TEST(SurfacePathWalk, TurnsBackAtTheBorderOfASingleTriangle) {
  const std::vector<std::array<float, 3>> vertices{{0, 0, 0}, {0.01f, 0, 0}, {0, 0.01f, 0}};
  const std::vector<std::array<std::uint32_t, 3>> faces{{0, 1, 2}};
  const spm::fcl::FixedMesh fixed{vertices, faces};
  const auto path = surface_path(vertices, faces, {kRadius, kDepth, kStep, 2000, 5},
                                 [&](const Vec3d& p) { return fixed.distance(p); });
  for (const Vec3d& p : path) {
    ASSERT_GE(p.x(), -1e-9);
    ASSERT_GE(p.y(), -1e-9);
    ASSERT_LE(p.x() + p.y(), 0.01 + 1e-8);
    ASSERT_NEAR(p.z(), kRadius - kDepth, 1e-9);
  }
}

}  // namespace
}  // namespace tactus::bench
