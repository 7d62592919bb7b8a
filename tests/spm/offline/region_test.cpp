#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <vector>

#include "spm/morton.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/clean.hpp"
#include "spm/offline/partition.hpp"
#include "tests/support/mesh_zoo.hpp"
#include "tests/support/reference_mesh.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::mesh_zoo;
using test_support::ReferenceMesh;
using test_support::ZooMesh;

struct Box {
  Vec3d low, high;
};

Box box_of(const Model& model, const Region& region) {
  const double edge = std::ldexp(model.summary.grid.cell_size, -int{region.depth});
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<std::size_t>(axis);
    box.low[axis] = model.summary.grid.origin[k] + region.cell[k] * edge;
    box.high[axis] = box.low[axis] + edge;
  }
  return box;
}

/// Returns whether the polygon and the box intersect, by clipping the polygon against the six sides of the box.
bool intersects(std::vector<Vec3d> polygon, const Box& box) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {1.0, -1.0}) {
      const double limit = side > 0 ? box.high[axis] : -box.low[axis];
      std::vector<Vec3d> inside;
      for (std::size_t i = 0; i < polygon.size(); ++i) {
        const Vec3d &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
        const double da = limit - side * a[axis], db = limit - side * b[axis];
        if (da >= 0) inside.push_back(a);
        if ((da < 0) != (db < 0)) inside.push_back(a + (b - a) * (da / (da - db)));
      }
      polygon = std::move(inside);
    }
  }
  return !polygon.empty();
}

class EveryMeshInRegions : public ::testing::TestWithParam<ZooMesh> {
 protected:
  EveryMeshInRegions() {
    BuildOptions options;
    options.simplify.base_faces = 12;
    options.partition.cell_faces = 40;
    options.partition.max_cell_faces = 80;
    built_ = build_model(GetParam().mesh, options);
    finest_ = finest_faces(built_.model());
  }

  std::vector<Vec3d> triangle(std::uint32_t face) const {
    std::vector<Vec3d> corners;
    for (const std::uint32_t v : finest_[face]) {
      const std::array<float, 3>& p = built_.positions[v];
      corners.emplace_back(p[0], p[1], p[2]);
    }
    return corners;
  }

  BuiltModel built_;
  std::vector<Triangle> finest_;
};

INSTANTIATE_TEST_SUITE_P(Zoo, EveryMeshInRegions, ::testing::ValuesIn(mesh_zoo()),
                         [](const auto& test) { return test.param.name; });

TEST_P(EveryMeshInRegions, ARegionAloneShowsEveryFaceInItsCellAsInTheFinestMesh) {
  const Model model = built_.model();
  for (std::uint32_t i = 0; i < model.summary.regions; ++i) {
    ReferenceMesh mesh{model};
    ASSERT_TRUE(mesh.apply_region(i)) << "region " << i;
    const Box box = box_of(model, model.regions[i]);
    std::uint32_t intersecting = 0;
    for (std::uint32_t f = 0; f < model.summary.faces; ++f) {
      if (!intersects(triangle(f), box)) continue;
      ++intersecting;
      ASSERT_TRUE(mesh.finest(f)) << "region " << i << ", face " << f;
      ASSERT_EQ(mesh.corners(f), finest_[f]) << "region " << i << ", face " << f;
    }
    EXPECT_LE(intersecting, model.regions[i].face_count) << "region " << i;
  }
}

TEST_P(EveryMeshInRegions, RandomPointsOfEveryFaceLieInLabelledCells) {
  const Model model = built_.model();
  std::mt19937 random{11};
  std::uniform_real_distribution<double> share{0, 1};
  std::vector<Box> boxes;
  for (const Region& region : model.regions) boxes.push_back(box_of(model, region));
  for (std::uint32_t f = 0; f < model.summary.faces; ++f) {
    const std::vector<Vec3d> corners = triangle(f);
    double a = share(random), b = share(random);
    if (a + b > 1) a = 1 - a, b = 1 - b;
    const Vec3d inner = corners[0] + a * (corners[1] - corners[0]) + b * (corners[2] - corners[0]);
    for (const Vec3d& p : {corners[0], inner}) {
      const bool covered = std::any_of(boxes.begin(), boxes.end(), [&](const Box& box) {
        return (p.array() >= box.low.array()).all() && (p.array() <= box.high.array()).all();
      });
      ASSERT_TRUE(covered) << "face " << f;
    }
  }
}

TEST(Partition, DividesTheCellsWithTooManyFaces) {
  TriangleMesh mesh = test_support::grid_patch(40, 40);
  TriangleMesh dense = test_support::grid_patch(40, 40);
  for (std::array<float, 3>& p : dense.positions) p = {p[0] / 40, p[1] / 40, 1};
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), dense.positions.begin(), dense.positions.end());
  for (const Triangle& f : dense.faces) mesh.faces.push_back({f[0] + first, f[1] + first, f[2] + first});
  const Partition cells = partition(mesh, {200, 300});
  std::uint32_t shallow = 0, deep = 0;
  for (const Cell& cell : cells.cells) {
    EXPECT_LE(cell.face_count, 300u);
    ++(cell.depth == 0 ? shallow : deep);
  }
  EXPECT_GT(shallow, 4u);
  EXPECT_GT(deep, 8u);
}

TEST(Partition, DoesNotDivideCellsWhenDivisionRepeatsMostFaces) {
  TriangleMesh stack;
  for (std::uint32_t i = 0; i < 400; ++i) {
    const float z = static_cast<float>(i) * 1e-4f;
    stack.positions.insert(stack.positions.end(), {{0, 0, z}, {1, 0, z}, {0, 1, z}});
    stack.faces.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  const Partition cells = partition(stack, {100, 200});
  EXPECT_LE(cells.faces.size(), 16 * stack.faces.size());
}

/// Returns the partition without divided cells.
Partition even_partition(const TriangleMesh& mesh, std::uint32_t cell_faces) {
  return partition(mesh, {cell_faces, kNone}, 1);
}

/// Returns for each cell of the even grid with a face, by Morton code, the faces that intersect it. Tests each cell.
std::map<std::uint64_t, std::vector<std::uint32_t>> faces_by_cell(const TriangleMesh& mesh, const GridFrame& grid) {
  double largest = 0;
  for (const auto& p : mesh.positions)
    for (const float x : p) largest = std::max(largest, double{std::abs(x)});
  const double cell = grid.cell_size;
  const double margin = 1e-6 * cell + 4 * double{std::numeric_limits<float>::epsilon()} * largest;
  std::array<std::uint32_t, 3> count{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double high = grid.origin[axis];
    for (const auto& p : mesh.positions) high = std::max(high, double{p[axis]});
    count[axis] = static_cast<std::uint32_t>((high - grid.origin[axis]) / cell) + 1;
  }
  std::map<std::uint64_t, std::vector<std::uint32_t>> cells;
  for (std::uint32_t z = 0; z < count[2]; ++z)
    for (std::uint32_t y = 0; y < count[1]; ++y)
      for (std::uint32_t x = 0; x < count[0]; ++x)
        for (std::uint32_t f = 0; f < mesh.faces.size(); ++f) {
          std::array<Vec3d, 3> t;
          for (std::size_t k = 0; k < 3; ++k) {
            const auto& p = mesh.positions[mesh.faces[f][k]];
            t[k] = {p[0], p[1], p[2]};
          }
          const Vec3d centre{grid.origin[0] + (x + 0.5) * cell, grid.origin[1] + (y + 0.5) * cell,
                             grid.origin[2] + (z + 0.5) * cell};
          if (triangle_intersects_cube(t, centre, cell / 2 + margin)) cells[morton(x, y, z)].push_back(f);
        }
  return cells;
}

/// Adds a face with its own vertices.
void add_face(TriangleMesh& mesh, const std::array<std::array<float, 3>, 3>& corners) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), corners.begin(), corners.end());
  mesh.faces.push_back({first, first + 1, first + 2});
}

/// Adds `count` tiny faces near the origin, so that the cells of the partition are small.
void add_tiny_faces(TriangleMesh& mesh, int count) {
  constexpr float kTiny = 1e-5f;
  for (int i = 0; i < count; ++i) {
    const float at = kTiny * static_cast<float>(i % 100);
    add_face(mesh, {{{at, 0, 0}, {at + kTiny, 0, 0}, {at, kTiny, 0}}});
  }
}

TEST(Partition, ALargeFaceIsInTheCellsThatItIntersects) {
  std::mt19937 random{3};
  std::uniform_real_distribution<float> within{-1, 1};
  for (const ZooMesh& each : mesh_zoo()) {
    if (each.mesh.faces.size() > 100) continue;  // many small faces
    TriangleMesh mesh = each.mesh;
    clean(mesh);
    if (mesh.faces.empty()) continue;
    const std::array<float, 3> origin = mesh.positions[mesh.faces[0][0]];
    const auto at = [&](float x, float y, float z) {
      return std::array<float, 3>{origin[0] + x, origin[1] + y, origin[2] + z};
    };
    const auto anywhere = [&] { return at(within(random), within(random), within(random)); };
    for (int i = 0; i < 6; ++i) add_face(mesh, {anywhere(), anywhere(), anywhere()});
    add_face(mesh, {at(-1, -1, -1), at(1, 1, 1), at(1, 1, 1 - 0x1p-20f)});
    add_face(mesh, {at(-1, 1, 0), at(1, -1, 0), at(0.5f, 0.5f, 0)});  // in a plane between cells
    for (int i = 0; i < 120; ++i) add_face(mesh, {at(0, 0, 0), at(1e-3f, 0, 0), at(0, 1e-3f, 0)});

    const Partition found = even_partition(mesh, 1);

    const auto expected = faces_by_cell(mesh, found.grid);
    ASSERT_EQ(found.cells.size(), expected.size()) << each.name;
    auto cell = found.cells.begin();
    for (const auto& [code, faces] : expected) {
      ASSERT_EQ(morton(cell->at[0], cell->at[1], cell->at[2]), code) << each.name;
      const auto first = found.faces.begin() + cell->first_face;
      ASSERT_EQ(std::vector(first, first + cell->face_count), faces) << each.name;
      ++cell;
    }
  }
}

// A test of each cell in the bounding boxes of these faces would take minutes.
TEST(Partition, ALongThinFaceCostsNotAllCellsOfItsBoundingBox) {
  TriangleMesh mesh;
  add_tiny_faces(mesh, 2000);
  for (int i = 0; i < 3; ++i) add_face(mesh, {{{0, 0, 0}, {1, 1, 1}, {1, 1, 1 - 0x1p-24f}}});

  const Partition found = even_partition(mesh, 400);

  EXPECT_NEAR(found.grid.cell_size, 1e-3, 1e-9);
  EXPECT_GE(found.cells.size(), 1000u) << "the diagonal";
  EXPECT_LE(found.cells.size(), 10'000u);
}

}  // namespace
}  // namespace tactus::spm::offline
