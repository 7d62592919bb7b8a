#include "spm/offline/clean.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {
namespace {

TriangleMesh one_triangle() { return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}}; }

TEST(Clean, LeavesAGoodMeshAlone) {
  TriangleMesh mesh = one_triangle();
  clean(mesh);
  EXPECT_EQ(mesh.positions, one_triangle().positions);
  EXPECT_EQ(mesh.faces, one_triangle().faces);
}

TEST(Clean, WeldsEqualPositionsAndTakesMinusZeroForZero) {
  TriangleMesh mesh = one_triangle();
  mesh.positions.insert(mesh.positions.end(), {{-0.0f, 0, 0}, {0, -1, 0}});
  mesh.faces.push_back({3, 4, 1});
  const CleanReport report = clean(mesh);
  EXPECT_EQ(report.welded_vertices, 1u);
  EXPECT_EQ(mesh.faces[1][0], 0u);
  EXPECT_FALSE(std::signbit(mesh.positions[0][0]));
}

TEST(Clean, DropsFacesOnOneLineHoweverTilted) {
  // The corners are exact multiples of one vector, whose products need more bits than a double has.
  const std::array<float, 3> step{1.0000001f, 0.33333334f, 16777215.0f};
  TriangleMesh mesh = one_triangle();
  for (const float k : {1.0f, 2.0f, 4.0f}) mesh.positions.push_back({k * step[0], k * step[1], k * step[2]});
  mesh.faces.push_back({3, 4, 5});
  EXPECT_EQ(clean(mesh).zero_area_faces, 1u);
}

TEST(Clean, KeepsAFaceThatIsOneBitOffTheLine) {
  const std::array<float, 3> step{1.0000001f, 0.33333334f, 16777215.0f};
  TriangleMesh mesh = one_triangle();
  for (const float k : {1.0f, 2.0f, 4.0f}) mesh.positions.push_back({k * step[0], k * step[1], k * step[2]});
  mesh.positions.back()[1] = std::nextafter(mesh.positions.back()[1], 2.0f);
  mesh.faces.push_back({3, 4, 5});
  EXPECT_EQ(clean(mesh).zero_area_faces, 0u);
}

TEST(Clean, KeepsTheOtherSideOfAFaceButNotItsDouble) {
  TriangleMesh mesh = one_triangle();
  mesh.faces.push_back({2, 0, 1});
  mesh.faces.push_back({0, 2, 1});
  const CleanReport report = clean(mesh);
  EXPECT_EQ(report.duplicate_faces, 1u);
  EXPECT_EQ(mesh.faces.size(), 2u);
}

TEST(Clean, DropsRepeatedCornersAndWhatIsNotFinite) {
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

TEST(Clean, HashesFallIntoAsManyRangesAsThereAreTables) {
  // Of types with 32 bits each, as on a machine whose size_t has no more.
  EXPECT_EQ(range_of_hash(~0u, 7), 6u);
  EXPECT_EQ(range_of_hash(1u << 31, 4), 2u);
  EXPECT_EQ(range_of_hash((1u << 31) - 1, 4), 1u);
  EXPECT_EQ(range_of_hash(0, 4), 0u);
}

TEST(Clean, NumbersTheRemainingVerticesInTheirOrder) {
  TriangleMesh mesh{{{9, 9, 9}, {0, 0, 0}, {8, 8, 8}, {1, 0, 0}, {0, 1, 0}}, {{1, 3, 4}}};
  EXPECT_EQ(clean(mesh).unreferenced_vertices, 2u);
  EXPECT_EQ(mesh.positions, one_triangle().positions);
  EXPECT_EQ(mesh.faces, one_triangle().faces);
}

}  // namespace
}  // namespace tactus::spm::offline
