#include "spm/offline/generate.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "spm/model.hpp"
#include "spm/offline/clean.hpp"

namespace tactus::spm::offline {
namespace {

/// Counts the uses of each directed edge.
std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const Triangle& f : mesh.faces) {
    for (std::size_t k = 0; k < 3; ++k) ++uses[{f[k], f[(k + 1) % 3]}];
  }
  return uses;
}

bool closed_and_oriented(const TriangleMesh& mesh) {
  const auto uses = edges(mesh);
  return std::all_of(uses.begin(), uses.end(), [&uses](const auto& use) {
    return use.second == 1 && uses.count({use.first.second, use.first.first}) == 1;
  });
}

double volume(const TriangleMesh& mesh) {
  double sum = 0;
  for (const Triangle& f : mesh.faces) {
    const auto &a = mesh.positions[f[0]], &b = mesh.positions[f[1]], &c = mesh.positions[f[2]];
    sum += double{a[0]} * (double{b[1]} * c[2] - double{b[2]} * c[1]) +
           double{a[1]} * (double{b[2]} * c[0] - double{b[0]} * c[2]) +
           double{a[2]} * (double{b[0]} * c[1] - double{b[1]} * c[0]);
  }
  return sum / 6;
}

TEST(Generate, SphereAndOrganHaveExactlyTheEvenNumberOfFacesRequested) {
  for (const std::uint32_t faces : {8u, 10u, 96u, 1000u, 4096u, 50002u}) {
    EXPECT_EQ(generate(Shape::kSphere, faces).faces.size(), faces);
    EXPECT_EQ(generate(Shape::kOrgan, faces).faces.size(), faces);
  }
}

TEST(Generate, TorusAndTerrainHaveTheRequestedNumberOfFacesWithin1Percent) {
  for (const std::uint32_t faces : {1000u, 4096u, 50001u}) {
    EXPECT_NEAR(static_cast<double>(generate(Shape::kTorus, faces).faces.size()), faces, 0.01 * faces);
    EXPECT_NEAR(static_cast<double>(generate(Shape::kTerrain, faces).faces.size()), faces, 0.01 * faces);
  }
}

TEST(Generate, AllButTheTerrainAreClosedAndFaceOutward) {
  for (const Shape shape : {Shape::kSphere, Shape::kTorus, Shape::kOrgan, Shape::kWall, Shape::kBox}) {
    for (const std::uint32_t faces : {18u, 100u, 4096u, 20000u}) {
      const TriangleMesh mesh = generate(shape, faces);
      EXPECT_TRUE(closed_and_oriented(mesh)) << faces;
      EXPECT_GT(volume(mesh), 0) << faces;
    }
  }
}

TEST(Generate, TheSphereHasTheVolumeOfASphere) {
  const double exact = 4.0 / 3 * 3.14159265358979 * 0.05 * 0.05 * 0.05;
  EXPECT_NEAR(volume(generate(Shape::kSphere, 20000)), exact, 0.002 * exact);
}

TEST(Generate, TheWallIsABlock) {
  const TriangleMesh mesh = generate(Shape::kWall, 14'000);
  EXPECT_EQ(mesh.faces.size(), 14'000u);
  EXPECT_NEAR(volume(mesh), 0.1 * 0.1 * 0.02, 1e-9);
  for (const std::array<float, 3>& p : mesh.positions)
    EXPECT_TRUE(std::abs(p[0]) == 0.05f || std::abs(p[1]) == 0.05f || std::abs(p[2]) == 0.01f);
}

TEST(Generate, TheTerrainHasOneBorder) {
  const TriangleMesh mesh = generate(Shape::kTerrain, 800);
  const auto uses = edges(mesh);
  const auto border = std::count_if(uses.begin(), uses.end(), [&uses](const auto& use) {
    return uses.count({use.first.second, use.first.first}) == 0;
  });
  EXPECT_EQ(border, 80);
}

TEST(Generate, CleaningRemovesNothing) {
  for (const Shape shape : {Shape::kSphere, Shape::kTorus, Shape::kOrgan, Shape::kTerrain, Shape::kWall, Shape::kBox}) {
    TriangleMesh mesh = generate(shape, 30000);
    const std::size_t vertices = mesh.positions.size(), faces = mesh.faces.size();
    clean(mesh);
    EXPECT_EQ(mesh.positions.size(), vertices);
    EXPECT_EQ(mesh.faces.size(), faces);
  }
}

TEST(Generate, AnotherSeedGivesAnotherOrgan) {
  EXPECT_NE(generate(Shape::kOrgan, 1000, 1).positions, generate(Shape::kOrgan, 1000, 2).positions);
  EXPECT_EQ(generate(Shape::kOrgan, 1000, 2).positions, generate(Shape::kOrgan, 1000, 2).positions);
}

TEST(Generate, RefusesTooFewOrTooManyFacesAndUnknownShapes) {
  EXPECT_THROW(static_cast<void>(generate(Shape::kSphere, 7)), ModelError);
  for (const std::string_view name : shape_names())
    EXPECT_THROW(static_cast<void>(generate(shape_from_name(name), kMaxBuiltFaces)), ModelError) << name;
  EXPECT_THROW(static_cast<void>(shape_from_name("cube")), ModelError);
}

TEST(Generate, EveryShapeIsFoundByItsName) {
  for (const std::string_view name : shape_names()) EXPECT_NO_THROW(static_cast<void>(shape_from_name(name)));
}

TEST(Generate, TheStylusIsClosedAndConvexWithItsTipAroundTheOrigin) {
  const TriangleMesh mesh = stylus();
  EXPECT_EQ(mesh.faces.size(), 720u);
  EXPECT_EQ(mesh.positions.size(), 362u);
  EXPECT_TRUE(closed_and_oriented(mesh));
  const double rounding = 1e-9;
  for (const Triangle& f : mesh.faces) {
    const auto position = [&](std::uint32_t v) {
      return Vec3d{mesh.positions[v][0], mesh.positions[v][1], mesh.positions[v][2]};
    };
    const Vec3d a = position(f[0]), normal = (position(f[1]) - a).cross(position(f[2]) - a).normalized();
    for (std::uint32_t v = 0; v < mesh.positions.size(); ++v) ASSERT_LT(normal.dot(position(v) - a), rounding);
  }
  for (const auto& p : mesh.positions) {
    const double from_axis = std::hypot(p[0], p[1]), from_tip = std::hypot(from_axis, std::min(p[2], 0.0f));
    EXPECT_LE(from_tip, 0.003 + rounding);
    EXPECT_LE(p[2], 0.025f);
  }
}

}  // namespace
}  // namespace tactus::spm::offline
