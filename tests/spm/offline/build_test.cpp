#include "spm/offline/build.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <random>
#include <set>

#include "spm/offline/face_order.hpp"
#include "spm/offline/generate.hpp"
#include "spm/surface_points.hpp"
#include "spm/triangle.hpp"
#include "tests/support/mesh_zoo.hpp"
#include "tests/support/reference_mesh.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::mesh_zoo;
using test_support::ReferenceMesh;
using test_support::sorted_faces;
using test_support::ZooMesh;
using ::testing::IsEmpty;

/// The simplification treats a mesh as a whole, in blocks, in blocks of several tiles, or as a whole with contractions
/// of near vertex pairs.
enum class Simplification { kWhole, kBlocks, kTiles, kPairs };

BuildOptions small_options(Simplification simplification, unsigned threads = 2) {
  BuildOptions options;
  options.threads = threads;
  const bool in_tiles = simplification == Simplification::kTiles;
  if (in_tiles || simplification == Simplification::kBlocks) options.simplify.block_faces = 64;
  if (in_tiles) options.simplify.tile_faces = 256;
  if (simplification == Simplification::kPairs) options.simplify.pair_distance = 0.5;
  options.simplify.base_faces = 12;
  options.partition.cell_faces = 40;
  options.partition.max_cell_faces = 80;
  return options;
}

class EveryMesh : public ::testing::TestWithParam<std::tuple<ZooMesh, Simplification>> {
 protected:
  EveryMesh()
      : zoo_{std::get<0>(GetParam())},
        simplification_{std::get<1>(GetParam())},
        built_{build_model(zoo_.mesh, small_options(simplification_))},
        finest_{finest_faces(built_.model())} {}

  /// False with pairs, because contracted pairs can join several sheets at one edge.
  bool manifold() const { return zoo_.manifold && simplification_ != Simplification::kPairs; }

  /// Returns the radius of a vertex from the record that adds it, or from the base mesh.
  static float radius(const Model& model, std::uint32_t vertex) {
    const std::uint32_t base = model.summary.base_vertices;
    return radius_of(vertex < base ? model.base_radii[vertex] : model.first_part(RecordId{vertex - base}).radius);
  }

  ZooMesh zoo_;
  Simplification simplification_;
  BuiltModel built_;
  std::vector<Triangle> finest_;
};

std::string name_of(const ::testing::TestParamInfo<std::tuple<ZooMesh, Simplification>>& test) {
  constexpr std::array<const char*, 4> kSuffixes{"Whole", "InBlocks", "InTiles", "WithPairs"};
  return std::get<0>(test.param).name + kSuffixes[static_cast<std::size_t>(std::get<1>(test.param))];
}

INSTANTIATE_TEST_SUITE_P(Zoo, EveryMesh,
                         ::testing::Combine(::testing::ValuesIn(mesh_zoo()),
                                            ::testing::Values(Simplification::kWhole, Simplification::kBlocks,
                                                              Simplification::kTiles, Simplification::kPairs)),
                         name_of);

TEST_P(EveryMesh, GivesAModelWithoutViolations) { EXPECT_THAT(violations(built_.model()), IsEmpty()); }

TEST_P(EveryMesh, GivesABaseMeshWithoutViolations) { EXPECT_THAT(violations(base_mesh_of(built_.model())), IsEmpty()); }

TEST_P(EveryMesh, SurfacePointsLieOnTheFinestSurfaceWithinTheirSpacingOfEveryFace) {
  const Model model = built_.model();
  const SurfacePoints found = surface_points(base_mesh_of(model), 6);
  ASSERT_FALSE(found.points.empty());
  EXPECT_LE(found.points.size(), 6u);
  const auto vector = [](const std::array<float, 3>& p) { return Vec3d{double{p[0]}, double{p[1]}, double{p[2]}}; };
  const double rounding = 1e-6 * (vector(model.summary.bounds_max) - vector(model.summary.bounds_min)).norm();
  std::vector<double> distances(found.points.size(), 1e300);  // of each point from the finest surface
  std::mt19937_64 random{7};
  std::uniform_real_distribution<double> share{0, 1};
  for (const Triangle& face : finest_) {
    const Vec3d a = vector(model.positions[face[0]]), b = vector(model.positions[face[1]]);
    const Vec3d c = vector(model.positions[face[2]]);
    for (std::size_t i = 0; i < found.points.size(); ++i)
      distances[i] =
          std::min(distances[i], std::sqrt(closest_point(vector(found.points[i].position), a, b, c).squared_distance));
    double u = share(random), v = share(random);
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const Vec3d point_on_face = a + u * (b - a) + v * (c - a);
    double nearest = 1e300;
    for (const SurfacePoint& point : found.points)
      nearest = std::min(nearest, (vector(point.position) - point_on_face).norm());
    ASSERT_LE(nearest, found.spacing + rounding);
  }
  for (const double distance : distances) EXPECT_LE(distance, rounding);
}

TEST_P(EveryMesh, ApplyingAllRecordsRestoresTheCleanedInputToTheBit) {
  TriangleMesh cleaned = zoo_.mesh;
  clean(cleaned);
  const Model model = built_.model();
  ReferenceMesh mesh{model};
  for (std::uint32_t r = 0; r < model.summary.records; ++r) ASSERT_TRUE(mesh.apply(r)) << "record " << r;
  std::vector<Triangle> faces;
  for (std::uint32_t f = 0; f < model.summary.faces; ++f) {
    ASSERT_TRUE(mesh.finest(f)) << "face " << f;
    faces.push_back(mesh.corners(f));
  }
  EXPECT_EQ(sorted_faces(model.positions, faces), sorted_faces(cleaned.positions, cleaned.faces));
  EXPECT_EQ(faces, finest_);
}

TEST_P(EveryMesh, EveryShownCornerIsWithinItsRadiusOfItsPositionInTheFinestMesh) {
  const Model model = built_.model();
  ReferenceMesh mesh{model};
  std::uint32_t moved = 0;
  for (std::uint32_t r = 0; r <= model.summary.records; ++r) {
    for (std::uint32_t f = 0; f < model.summary.faces; ++f) {
      if (!mesh.shown(f)) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t v = mesh.corners(f)[k];
        const auto &from = model.positions[v], &to = model.positions[finest_[f][k]];
        const double distance = std::hypot(double{from[0]} - to[0], double{from[1]} - to[1], double{from[2]} - to[2]);
        ASSERT_LE(distance, radius(model, v)) << "face " << f << ", vertex " << v;
        ASSERT_LE(radius(model, v), model.summary.deviation);
        moved += distance > 0;
      }
    }
    if (r < model.summary.records) {
      ASSERT_TRUE(mesh.apply(r));
    }
  }
  EXPECT_TRUE(moved > 0 || model.summary.records == 0);
}

TEST_P(EveryMesh, AnyTopologicalOrderOfTheRecordsGivesTheSameMesh) {
  const Model model = built_.model();
  ReferenceMesh ascending{model};
  for (std::uint32_t r = 0; r < model.summary.records; ++r) ASSERT_TRUE(ascending.apply(r));
  for (std::uint32_t seed = 1; seed <= 5; ++seed) {
    // Tries the records in random order. Records that cannot be applied yet are tried again in the next pass.
    std::mt19937 random{seed};
    std::vector<std::uint32_t> waiting(model.summary.records);
    for (std::uint32_t r = 0; r < waiting.size(); ++r) waiting[r] = r;
    ReferenceMesh mesh{model};
    while (!waiting.empty()) {
      std::shuffle(waiting.begin(), waiting.end(), random);
      const std::size_t before = waiting.size();
      waiting.erase(std::remove_if(waiting.begin(), waiting.end(), [&](std::uint32_t r) { return mesh.apply(r); }),
                    waiting.end());
      ASSERT_LT(waiting.size(), before) << "seed " << seed;
    }
    EXPECT_TRUE(mesh == ascending) << "seed " << seed;
  }
}

TEST_P(EveryMesh, EveryPrefixInRecordOrderIsAValidMesh) {
  const Model model = built_.model();
  ReferenceMesh mesh{model};
  const std::uint32_t step = model.summary.records / 50 + 1;
  for (std::uint32_t r = 0; r < model.summary.records; ++r) {
    if (r % step == 0) {
      ASSERT_THAT(mesh.defects(finest_, manifold()), IsEmpty()) << "before record " << r;
    }
    ASSERT_TRUE(mesh.apply(r));
  }
  EXPECT_THAT(mesh.defects(finest_, manifold()), IsEmpty());
}

TEST_P(EveryMesh, AnyUnionOfRegionsIsAValidMesh) {
  const Model model = built_.model();
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    std::mt19937 random{seed};
    ReferenceMesh mesh{model};
    const std::size_t regions = 1 + random() % std::min(6u, model.summary.regions);
    for (std::size_t i = 0; i < regions; ++i) {
      ASSERT_TRUE(mesh.apply_region(static_cast<std::uint32_t>(random() % model.summary.regions))) << "seed " << seed;
    }
    ASSERT_THAT(mesh.defects(finest_, manifold()), IsEmpty()) << "seed " << seed;
  }
}

TEST_P(EveryMesh, ARandomClosedSetOfRecordsIsAValidMesh) {
  // Omits random records and applies the others in ascending order, unless they depend on an omitted record.
  const Model model = built_.model();
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    std::mt19937 random{seed};
    ReferenceMesh mesh{model};
    const std::size_t one_in = 2 + random() % 30;
    for (std::uint32_t r = 0; r < model.summary.records; ++r) {
      if (random() % one_in != 0) static_cast<void>(mesh.apply(r));
    }
    ASSERT_THAT(mesh.defects(finest_, manifold()), IsEmpty()) << "seed " << seed;
  }
}

template <class Item>
bool same_bytes(const std::vector<Item>& a, const std::vector<Item>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(Item)) == 0);
}

void expect_same_bytes(const BuiltModel& a, const BuiltModel& b) {
  EXPECT_EQ(std::memcmp(&a.summary, &b.summary, sizeof a.summary), 0);
  EXPECT_TRUE(same_bytes(a.positions, b.positions));
  EXPECT_TRUE(same_bytes(a.base_faces, b.base_faces));
  EXPECT_TRUE(same_bytes(a.parts, b.parts));
  EXPECT_TRUE(same_bytes(a.regions, b.regions));
  EXPECT_TRUE(same_bytes(a.intervals, b.intervals));
}

TEST_P(EveryMesh, GivesTheSameBytesWithAnyNumberOfThreads) {
  for (const unsigned threads : {1u, 2u, 3u}) {
    expect_same_bytes(build_model(zoo_.mesh, small_options(simplification_, threads)), built_);
  }
}

TEST(Build, ALargeMeshGivesTheSameBytesWithAnyNumberOfThreads) {
  const TriangleMesh mesh = generate(Shape::kOrgan, 150000, 5);
  BuildOptions options;
  options.threads = 1;
  const BuiltModel with_one_thread = build_model(mesh, options);
  for (const unsigned threads : {2u, 5u}) {
    options.threads = threads;
    expect_same_bytes(build_model(mesh, options), with_one_thread);
  }
}

TEST(Build, BlocksLengthenTheClosedListsByAtMost10Percent) {
  const TriangleMesh mesh = generate(Shape::kOrgan, 60000, 3);
  const auto listed_records = [&](std::uint32_t block_faces) {
    BuildOptions options;
    options.simplify.block_faces = block_faces;
    std::uint64_t sum = 0;
    for (const Region& region : build_model(mesh, options).regions) sum += region.record_count;
    return sum;
  };
  const std::uint64_t whole = listed_records(1u << 20), blocks = listed_records(1u << 12);
  EXPECT_LE(blocks * 100, whole * 110) << "whole " << whole << ", in blocks " << blocks;
}

TEST(Simplify, RetainsTheVerticesOfSeveralTilesInTheFirstThreeRounds) {
  constexpr std::uint32_t kTileFaces = 4096;
  TriangleMesh mesh = generate(Shape::kOrgan, 60000, 3);
  std::vector<Triangle> ordered;
  for (const std::uint32_t f : face_order(mesh)) ordered.push_back(mesh.faces[f]);
  mesh.faces = std::move(ordered);
  SimplifyOptions options;
  options.block_faces = 512;
  options.tile_faces = kTileFaces;
  const Collapses collapses = simplify(mesh, options);

  std::vector<std::set<std::uint32_t>> tiles(mesh.positions.size());  // by vertex
  for (std::uint32_t f = 0; f < mesh.faces.size(); ++f)
    for (const std::uint32_t v : mesh.faces[f]) tiles[v].insert(f / kTileFaces);
  std::size_t within_tiles = 0, between_tiles = 0;
  ASSERT_GT(collapses.rounds.size(), 4u);
  for (std::size_t s = 0; s < collapses.segments.size(); ++s) {
    const Segment& segment = collapses.segments[s];
    const bool is_early = s < collapses.rounds[3];
    for (std::uint32_t i = 0; i < segment.size(); ++i) {
      const Collapse& collapse = segment.sequence[i];
      const bool is_within = tiles[collapse.u].size() == 1 && tiles[collapse.u] == tiles[collapse.t];
      EXPECT_TRUE(is_within || !is_early) << "collapse of vertex " << collapse.u;
      ++(is_within ? within_tiles : between_tiles);
    }
  }
  EXPECT_GT(within_tiles, mesh.positions.size() / 2);
  EXPECT_GT(between_tiles, 0u) << "in later rounds";
}

TEST(Build, ReachesTheNumberOfBaseFacesRequestedOnASmoothSurface) {
  BuildOptions options;
  options.simplify.base_faces = 200;
  const BuiltModel built = build_model(generate(Shape::kOrgan, 20000), options);
  EXPECT_LE(built.summary.base_faces, 200u);
  EXPECT_GE(built.summary.base_faces, 198u);
}

/// Two neighbouring patches with a gap of 0.05 between them.
TriangleMesh patches_with_gap() {
  TriangleMesh mesh = test_support::grid_patch(8, 8), right = mesh;
  for (std::array<float, 3>& p : right.positions) p[0] += 8.05f;
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), right.positions.begin(), right.positions.end());
  for (const Triangle& f : right.faces) mesh.faces.push_back({f[0] + first, f[1] + first, f[2] + first});
  return mesh;
}

std::size_t components_of_base_mesh(const Model& model) {
  std::vector<std::uint32_t> component(model.summary.base_vertices);
  std::iota(component.begin(), component.end(), 0u);
  for (std::size_t pass = 0; pass < component.size(); ++pass) {
    for (const BaseFace& face : model.base_faces) {
      std::uint32_t min = component[index(face.corners[0])];
      for (const VertexId v : face.corners) min = std::min(min, component[index(v)]);
      for (const VertexId v : face.corners) component[index(v)] = min;
    }
  }
  return std::set<std::uint32_t>(component.begin(), component.end()).size();
}

TEST(Build, PairsAcrossAGapJoinTwoPatches) {
  BuildOptions options;
  options.simplify.base_faces = 2;
  const BuiltModel separate = build_model(patches_with_gap(), options);
  options.simplify.pair_distance = 0.1;
  const BuiltModel joined = build_model(patches_with_gap(), options);
  EXPECT_EQ(components_of_base_mesh(separate.model()), 2u);
  EXPECT_EQ(components_of_base_mesh(joined.model()), 1u);
  EXPECT_LT(joined.summary.base_vertices, separate.summary.base_vertices);
}

TEST(Build, APairDistanceBelowTheGapChangesNothing) {
  BuildOptions options;
  options.simplify.base_faces = 2;
  const BuiltModel without = build_model(patches_with_gap(), options);
  options.simplify.pair_distance = 0.04;
  expect_same_bytes(build_model(patches_with_gap(), options), without);
}

TEST(Build, PairsCloseTheHoleOfATorus) {
  TriangleMesh torus = generate(Shape::kTorus, 3000);  // its tube is 4 cm thick, its hole 6 cm wide
  BuildOptions options;
  options.simplify.base_faces = 4;
  const BuiltModel whole = build_model(torus, options);
  options.simplify.pair_distance = 0.05;
  const BuiltModel closed = build_model(torus, options);
  EXPECT_LT(closed.summary.base_faces, whole.summary.base_faces);
}

TEST(Build, RetainsTheCornersOfAFlatPatch) {
  BuildOptions options;
  options.simplify.base_faces = 2;
  const BuiltModel built = build_model(test_support::grid_patch(8, 8), options);
  std::vector<std::array<float, 3>> base{built.positions.begin(),
                                         built.positions.begin() + built.summary.base_vertices};
  for (const std::array<float, 3>& corner : {std::array<float, 3>{0, 0, 0}, {8, 0, 0}, {0, 8, 0}, {8, 8, 0}}) {
    EXPECT_THAT(base, ::testing::Contains(corner));
  }
}

TEST(Build, DoesNotSimplifyATetrahedron) {
  BuildOptions options;
  options.simplify.base_faces = 1;
  const BuiltModel built = build_model(test_support::mesh_zoo().front().mesh, options);
  EXPECT_EQ(built.summary.base_faces, 4u);
  EXPECT_EQ(built.summary.records, 0u);
}

TEST(Build, TheSizeIsTheLengthOfTheLongestSide) {
  BuildOptions options;
  options.size = 0.5;
  const BuiltModel built = build_model(test_support::grid_patch(8, 4), options);
  EXPECT_DOUBLE_EQ(built.summary.metres_per_unit, 0.5 / 8);
}

TEST(Build, RefusesAMeshWithoutASurface) {
  const TriangleMesh line{{{0, 0, 0}, {1, 1, 1}, {2, 2, 2}}, {{0, 1, 2}}};
  EXPECT_THROW(static_cast<void>(build_model(line)), ModelError);
  EXPECT_THROW(static_cast<void>(build_model(TriangleMesh{})), ModelError);
}

TEST(Build, RefusesTooManyFacesAndNamesTheLimit) {
  EXPECT_NO_THROW(require_face_count(kMaxBuiltFaces - 1));
  EXPECT_THAT([] { require_face_count(kMaxBuiltFaces); },
              ::testing::ThrowsMessage<ModelError>("too many faces: found 268435456, expected at most 268435455"));
}

TEST(Build, RefusesAFaceWithAVertexThatDoesNotExist) {
  const TriangleMesh damaged{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 3}}};
  EXPECT_THROW(static_cast<void>(build_model(damaged)), ModelError);
}

}  // namespace
}  // namespace tactus::spm::offline
