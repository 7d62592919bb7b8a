#include "spm/fcl/fixed_mesh.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "spm/triangle.hpp"
#include "spm/triangle_pair.hpp"

namespace tactus::spm::fcl {
namespace {

using testing::ElementsAreArray;

constexpr unsigned kMeshSeed = 48246;

struct Mesh {
  std::vector<FixedMesh::Position> vertices;
  std::vector<FixedMesh::Face> faces;

  [[nodiscard]] double distance(std::size_t face, const Vec3d& point) const {
    const auto corner = [&](int i) {
      const FixedMesh::Position& p = vertices[faces[face][i]];
      return Vec3d{p[0], p[1], p[2]};
    };
    return std::sqrt(closest_point(point, corner(0), corner(1), corner(2)).squared_distance);
  }

  [[nodiscard]] double distance(const Vec3d& point) const {
    double min = std::numeric_limits<double>::infinity();
    for (std::size_t f = 0; f < faces.size(); ++f) min = std::min(min, distance(f, point));
    return min;
  }
};

/// Returns a random height field on the unit square: n x n cells of two faces each, with a border.
Mesh bumpy_square(std::uint32_t n, std::mt19937& rng) {
  std::uniform_real_distribution<float> height{0.0f, 0.05f};
  Mesh mesh;
  for (std::uint32_t y = 0; y <= n; ++y) {
    for (std::uint32_t x = 0; x <= n; ++x) {
      mesh.vertices.push_back(
          {static_cast<float>(x) / static_cast<float>(n), static_cast<float>(y) / static_cast<float>(n), height(rng)});
    }
  }
  for (std::uint32_t y = 0; y < n; ++y) {
    for (std::uint32_t x = 0; x < n; ++x) {
      const std::uint32_t a = y * (n + 1) + x;
      mesh.faces.push_back({a, a + 1, a + n + 2});
      mesh.faces.push_back({a, a + n + 2, a + n + 1});
    }
  }
  return mesh;
}

/// Accepts either result for a face whose distance from the centre differs from the radius only by rounding.
void expect_touching_equals_brute_force(const FixedMesh& fixed, const Mesh& mesh, std::mt19937& rng, int queries) {
  constexpr double kTangencyTolerance = 1e-9;
  std::uniform_real_distribution<double> coordinate{-0.05, 1.05};
  std::uniform_real_distribution<double> height{-0.05, 0.12};
  std::uniform_real_distribution<double> radius{0.005, 0.1};
  std::vector<std::uint32_t> touching;
  std::size_t total = 0;
  for (int i = 0; i < queries; ++i) {
    const Vec3d centre{coordinate(rng), coordinate(rng), height(rng)};
    const double query_radius = radius(rng);
    fixed.find_touched_faces(centre, query_radius, touching);
    std::sort(touching.begin(), touching.end());
    std::vector<std::uint32_t> expected;
    for (std::uint32_t f = 0; f < mesh.faces.size(); ++f) {
      const double distance = mesh.distance(f, centre);
      const bool is_reported = std::binary_search(touching.begin(), touching.end(), f);
      const bool is_tangent = std::abs(distance - query_radius) < kTangencyTolerance;
      if (is_tangent ? is_reported : distance <= query_radius) expected.push_back(f);
    }
    ASSERT_THAT(touching, ElementsAreArray(expected)) << "query " << i;
    total += expected.size();
  }
  EXPECT_GT(total, static_cast<std::size_t>(queries));
}

TEST(FixedMesh, FindsTheSameTouchingTrianglesAsBruteForce) {
  SCOPED_TRACE("seed " + std::to_string(kMeshSeed));
  std::mt19937 rng{kMeshSeed};
  const Mesh mesh = bumpy_square(24, rng);
  const FixedMesh fixed{mesh.vertices, mesh.faces};
  expect_touching_equals_brute_force(fixed, mesh, rng, 300);
}

TEST(FixedMesh, ReturnsTheDistanceOfTheNearestTriangle) {
  SCOPED_TRACE("seed " + std::to_string(kMeshSeed));
  std::mt19937 rng{kMeshSeed};
  const Mesh mesh = bumpy_square(24, rng);
  const FixedMesh fixed{mesh.vertices, mesh.faces};
  std::uniform_real_distribution<double> coordinate{-1, 2};
  for (int i = 0; i < 300; ++i) {
    const Vec3d point{coordinate(rng), coordinate(rng), coordinate(rng)};
    ASSERT_NEAR(fixed.distance(point), mesh.distance(point), 1e-7) << "query " << i;
  }
}

TEST(FixedMesh, SearchesTheMovedMeshAfterARefitAndAfterARebuild) {
  SCOPED_TRACE("seed " + std::to_string(kMeshSeed));
  std::mt19937 rng{kMeshSeed};
  Mesh mesh = bumpy_square(16, rng);
  FixedMesh fixed{mesh.vertices, mesh.faces};
  const auto move_vertices = [&] {
    std::uniform_real_distribution<float> displacement{-0.03f, 0.03f};
    for (auto& p : mesh.vertices) {
      for (float& x : p) x += displacement(rng);
    }
    fixed.move(mesh.vertices);
  };
  move_vertices();
  fixed.refit();
  expect_touching_equals_brute_force(fixed, mesh, rng, 100);
  move_vertices();
  fixed.rebuild();
  expect_touching_equals_brute_force(fixed, mesh, rng, 100);
}

TEST(FixedMesh, RefusesAMeshWithoutFacesAMissingVertexAndAnotherNumberOfVertices) {
  const std::vector<FixedMesh::Position> vertices{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  EXPECT_THROW((FixedMesh{vertices, {}}), std::invalid_argument);
  const std::vector<FixedMesh::Face> outside{{0, 1, 3}};
  EXPECT_THROW((FixedMesh{vertices, outside}), std::invalid_argument);
  const std::vector<FixedMesh::Face> good{{0, 1, 2}};
  FixedMesh fixed{vertices, good};
  const std::vector<FixedMesh::Position> fewer{{0, 0, 0}, {1, 0, 0}};
  EXPECT_THROW(fixed.move(fewer), std::invalid_argument);
}

TEST(FixedMesh, FindsAllPairsOfIntersectingTriangles) {
  std::mt19937 rng{kMeshSeed};
  const Mesh low = bumpy_square(12, rng);
  Mesh high = bumpy_square(9, rng);
  std::vector<std::array<std::uint32_t, 2>> expected, found;
  for (std::uint32_t f = 0; f < low.faces.size(); ++f)
    for (std::uint32_t g = 0; g < high.faces.size(); ++g) {
      const auto triangle = [](const Mesh& mesh, std::uint32_t face) {
        Triangle3d corners;
        for (std::size_t i = 0; i < 3; ++i) {
          const FixedMesh::Position& p = mesh.vertices[mesh.faces[face][i]];
          corners[i] = {p[0], p[1], p[2]};
        }
        return corners;
      };
      PairContact contact;
      if (intersect(triangle(low, f), triangle(high, g), contact)) expected.push_back({f, g});
    }
  ASSERT_GT(expected.size(), 50u);

  FixedMesh{low.vertices, low.faces}.intersecting(FixedMesh{high.vertices, high.faces}, found);

  std::sort(found.begin(), found.end());
  EXPECT_THAT(found, ElementsAreArray(expected));
}

}  // namespace
}  // namespace tactus::spm::fcl
