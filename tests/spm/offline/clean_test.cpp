#include "spm/offline/clean.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {
namespace {

TriangleMesh one_triangle() { return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}}; }

/// Adds a face with exactly collinear corners. The products of their coordinates need more bits than a double has.
void add_collinear_face(TriangleMesh& mesh) {
  const std::array<float, 3> step{1.0000001f, 0.33333334f, 16777215.0f};
  for (const float k : {1.0f, 2.0f, 4.0f}) mesh.positions.push_back({k * step[0], k * step[1], k * step[2]});
  mesh.faces.push_back({3, 4, 5});
}

TEST(Clean, DoesNotChangeACleanMesh) {
  TriangleMesh mesh = one_triangle();
  clean(mesh);
  EXPECT_EQ(mesh.positions, one_triangle().positions);
  EXPECT_EQ(mesh.faces, one_triangle().faces);
}

TEST(Clean, WeldsEqualPositionsAndReplacesMinusZeroByZero) {
  TriangleMesh mesh = one_triangle();
  mesh.positions.insert(mesh.positions.end(), {{-0.0f, 0, 0}, {0, -1, 0}});
  mesh.faces.push_back({3, 4, 1});
  const CleanReport report = clean(mesh);
  EXPECT_EQ(report.welded_vertices, 1u);
  EXPECT_EQ(mesh.faces[1][0], 0u);
  EXPECT_FALSE(std::signbit(mesh.positions[0][0]));
}

TEST(Clean, RemovesAFaceWithCollinearCorners) {
  TriangleMesh mesh = one_triangle();
  add_collinear_face(mesh);
  EXPECT_EQ(clean(mesh).zero_area_faces, 1u);
}

TEST(Clean, RetainsAFaceWithACornerThatIsOneBitOffTheLine) {
  TriangleMesh mesh = one_triangle();
  add_collinear_face(mesh);
  mesh.positions.back()[1] = std::nextafter(mesh.positions.back()[1], 2.0f);
  EXPECT_EQ(clean(mesh).zero_area_faces, 0u);
}

TEST(Clean, RemovesADuplicateFaceButNotTheFaceWithTheOppositeOrientation) {
  TriangleMesh mesh = one_triangle();
  mesh.faces.push_back({2, 0, 1});
  mesh.faces.push_back({0, 2, 1});
  const CleanReport report = clean(mesh);
  EXPECT_EQ(report.duplicate_faces, 1u);
  EXPECT_EQ(mesh.faces.size(), 2u);
}

TEST(Clean, RemovesFacesWithRepeatedCornersAndWithInfinitePositions) {
  TriangleMesh mesh = one_triangle();
  mesh.positions.push_back({std::numeric_limits<float>::infinity(), 0, 0});
  mesh.faces.push_back({0, 1, 3});
  mesh.faces.push_back({0, 1, 1});
  const CleanReport report = clean(mesh);
  EXPECT_EQ(report.non_finite_faces, 1u);
  EXPECT_EQ(report.repeated_corner_faces, 1u);
  EXPECT_EQ(report.unreferenced_vertices, 1u);
  EXPECT_EQ(mesh.faces, one_triangle().faces);
}

TEST(Clean, DistributesHashesOfAnyWidthOverTheTables) {
  // The hashes have 32 bits, as on machines with a size_t of 32 bits.
  EXPECT_EQ(range_of_hash(~0u, 7), 6u);
  EXPECT_EQ(range_of_hash(1u << 31, 4), 2u);
  EXPECT_EQ(range_of_hash((1u << 31) - 1, 4), 1u);
  EXPECT_EQ(range_of_hash(0, 4), 0u);
}

TEST(Clean, NumbersTheRemainingVerticesInTheirOriginalOrder) {
  TriangleMesh mesh{{{9, 9, 9}, {0, 0, 0}, {8, 8, 8}, {1, 0, 0}, {0, 1, 0}}, {{1, 3, 4}}};
  EXPECT_EQ(clean(mesh).unreferenced_vertices, 2u);
  EXPECT_EQ(mesh.positions, one_triangle().positions);
  EXPECT_EQ(mesh.faces, one_triangle().faces);
}

}  // namespace
}  // namespace tactus::spm::offline
