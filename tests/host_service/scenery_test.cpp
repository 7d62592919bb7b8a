#include "host_service/scenery.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "host_service/object_authority.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/damaged_model.hpp"

namespace tactus::host_service {
namespace {

using haptics::Vec3d;

constexpr std::uint32_t kFaces = 40'000;

/// The generated organ at the origin, 20 cm long.
struct Organ {
  spm::offline::TriangleMesh mesh = spm::offline::generate(spm::offline::Shape::kOrgan, kFaces);
  spm::offline::BuiltModel built{spm::offline::build_model(mesh)};
  spm::codec::EncodedModel encoded{built.model()};
  double scale = 1;
  std::vector<Vec3d> vertices;  // m

  Organ() {
    const spm::ModelSummary& summary = encoded.compressed().summary();
    double longest = 0;
    for (int axis = 0; axis < 3; ++axis)
      longest = std::max(longest, double{summary.bounds_max[axis]} - double{summary.bounds_min[axis]});
    scale = 0.2 / longest;
    for (const auto& position : mesh.positions)
      vertices.push_back(scale * Vec3d{position[0], position[1], position[2]});
  }
  [[nodiscard]] StaticObject object() const { return {{}, scale, &encoded.compressed()}; }
  [[nodiscard]] Vec3d top() const {
    return *std::max_element(vertices.begin(), vertices.end(),
                             [](const Vec3d& a, const Vec3d& b) { return a.z() < b.z(); });
  }
};
const Organ& organ() {
  static const Organ kOrgan;
  return kOrgan;
}

/// A box of 0.2 kg. `half_mm`: half edge lengths, mm. `centre`: m. The ground is 1 m below the origin.
session::CatalogueEntry box(const Vec3d& half_mm, const Vec3d& centre, double friction) {
  session::CatalogueEntry entry;
  entry.origin.session = 1;
  entry.origin.participant = 100;
  entry.origin.incarnation = 1000;
  entry.object_id = 5;
  for (int axis = 0; axis < 3; ++axis) {
    entry.summary.bounds_max[axis] = static_cast<float>(half_mm[axis]);
    entry.summary.bounds_min[axis] = -entry.summary.bounds_max[axis];
  }
  entry.scale = 0.001;
  entry.pose.position = {centre.x(), centre.y(), centre.z()};
  entry.body = {0.2, sharing::inertia_of_bounds(entry.summary, entry.scale, 0.2), friction, -1};
  return entry;
}

/// Simulates the fall of the box. Returns its pose after 4 s, when it must be at rest.
session::Pose pose_after_drop(const session::CatalogueEntry& entry, Scenery& scenery) {
  ObjectAuthority object_authority{entry.origin};
  object_authority.set_scenery(&scenery);
  object_authority.add(entry, 0);
  session::Pose pose = entry.pose;
  for (std::int64_t now = kMs; now < 4000 * kMs; now += kMs)
    for (const session::ObjectPose& published : object_authority.tick(now, now).poses) pose = published.pose;
  EXPECT_FALSE(object_authority.busy());
  return pose;
}

TEST(Scenery, ABoxDroppedOnTheOrganComesToRestOnItsFinestMesh) {
  const Vec3d half{0.02, 0.015, 0.01};
  Scenery scenery{{organ().object()}};
  const session::CatalogueEntry entry = box(1e3 * half, organ().top() + Vec3d{0, 0, 0.04}, 0.9);
  const session::Pose pose = pose_after_drop(entry, scenery);
  const haptics::BodyState state = sharing::state_at(pose, Vec3d::Zero());
  EXPECT_GT(state.position.z(), organ().top().z() - 0.005);

  double min_distance = 1;  // of a vertex from the box, m; negative inside
  for (const Vec3d& vertex : organ().vertices) {
    const Vec3d distance = state.to_body(vertex).cwiseAbs() - half;
    min_distance = std::min(min_distance, distance.maxCoeff());
  }
  EXPECT_GT(min_distance, -3e-4) << "a vertex of the finest mesh is more than 0.3 mm inside the box";
  EXPECT_LT(min_distance, 3e-4) << "no vertex is within 0.3 mm of the box";
  EXPECT_GT(scenery.regions_loaded(), 0u);
  EXPECT_TRUE(scenery.is_exact(state.position - Vec3d{0, 0, half.z()}, 0.003));
}

TEST(Scenery, ABoxComesToRestOnACoarserMeshWhenSlotsAreTooFew) {
  Scenery scenery{{organ().object()}, 200};
  const session::CatalogueEntry entry = box({20, 15, 10}, organ().top() + Vec3d{0, 0, 0.03}, 0.9);
  const session::Pose pose = pose_after_drop(entry, scenery);
  EXPECT_NEAR(pose.position[2], organ().top().z() + 0.01, 0.004);
}

TEST(Scenery, ShowsTheBaseMeshesOfManyObjects) {
  std::vector<StaticObject> objects(40, organ().object());
  for (std::size_t i = 0; i < objects.size(); ++i) objects[i].pose.position[0] = static_cast<double>(i);
  const Scenery alone{{organ().object()}, 200}, scenery{objects, 200};
  for (std::size_t i = 0; i < organ().vertices.size(); i += 997) {
    haptics::SurfaceHit expected, found;
    ASSERT_TRUE(alone.surface().closest(organ().vertices[i], 0.1, expected));
    for (const StaticObject& object : objects) {
      const Vec3d offset{object.pose.position[0], 0, 0};
      ASSERT_TRUE(scenery.surface().closest(organ().vertices[i] + offset, 0.1, found)) << offset.x();
      EXPECT_LT((found.point - offset - expected.point).norm(), 1e-9) << offset.x();
    }
  }
}

TEST(Scenery, DamagedRegionsStayCoarseAndDoNotKeepOthersFromBeingLoaded) {
  const spm::codec::CompressedModel& sound = test_support::organ_of_several_blocks().compressed();
  const test_support::DamagedModel damaged{sound};
  const auto loaded = [](const spm::codec::CompressedModel& model) {
    Scenery scenery{{StaticObject{{}, 1, &model}}};
    std::vector<Vec3d> points;
    for (const auto& vertex : model.base().positions) points.push_back(Vec3d{vertex[0], vertex[1], vertex[2]});
    for (int call = 0; call < 200; ++call) scenery.refine_around(points);
    return scenery.regions_loaded();
  };
  const std::uint64_t all = loaded(sound), some = loaded(damaged.compressed());
  EXPECT_GT(some, 0u);
  EXPECT_LT(some, all);
  EXPECT_GT(some, all / 8) << "only few of the regions need the damaged block";
}

TEST(Scenery, ADamagedRegionIsDecodedOnce) {
  const test_support::DamagedModel damaged{test_support::organ_of_several_blocks().compressed()};
  const spm::codec::CompressedModel& model = damaged.compressed();
  std::uint64_t damaged_regions = 0;
  for (std::uint32_t region = 0; region < model.summary().regions; ++region)
    damaged_regions += damaged.is_damaged(region) ? 1 : 0;
  Scenery scenery{{StaticObject{{}, 1, &model}}};
  std::vector<Vec3d> points;
  for (const auto& vertex : model.base().positions) points.push_back(Vec3d{vertex[0], vertex[1], vertex[2]});

  for (int call = 0; call < 200; ++call) scenery.refine_around(points);

  EXPECT_GT(scenery.regions_damaged(), 0u);
  EXPECT_LE(scenery.regions_damaged(), damaged_regions);
}

TEST(Scenery, RegionsWithoutContactsFreeTheirSlotsForOthers) {
  Scenery scenery{{organ().object()}, 6000};
  std::uint64_t exact = 0, requested = 0;
  for (std::size_t i = 0; i < organ().vertices.size(); i += 211) {
    for (int round = 0; round < 12; ++round) scenery.refine_around({organ().vertices[i]});
    ++requested;
    exact += scenery.is_exact(organ().vertices[i], 0.002) ? 1 : 0;
  }
  EXPECT_EQ(exact, requested);
  EXPECT_GT(scenery.regions_loaded(), organ().encoded.compressed().summary().regions / 3);
}

}  // namespace
}  // namespace tactus::host_service
