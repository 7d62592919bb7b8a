// Compares the contacts between a mesh probe and the shown faces with a search of all pairs.

#include "spm/mesh_probe.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <tuple>

#include "spm/offline/generate.hpp"
#include "spm/probe_spheres.hpp"
#include "tests/support/mesh_zoo.hpp"
#include "tests/support/shown_mesh.hpp"

namespace tactus::spm {
namespace {

using offline::TriangleMesh;
using Shown = test_support::ShownMesh;

using Found = std::vector<std::tuple<std::uint32_t, std::uint32_t, double, std::array<double, 6>>>;

std::array<double, 6> flat(const Vec3d& point, const Vec3d& normal) {
  return {point[0], point[1], point[2], normal[0], normal[1], normal[2]};
}

/// Only compares coordinates, so the result has no rounding error.
bool boxes_apart(const Triangle3d& a, const Triangle3d& b) {
  for (int axis = 0; axis < 3; ++axis) {
    const auto [a_low, a_high] = std::minmax({a[0][axis], a[1][axis], a[2][axis]});
    const auto [b_low, b_high] = std::minmax({b[0][axis], b[1][axis], b[2][axis]});
    if (a_high < b_low || b_high < a_low) return true;
  }
  return false;
}

Found all_pairs(const Shown& shown, const PlacedProbe& probe, std::uint32_t triangles) {
  std::vector<Triangle3d> tool;
  for (std::uint32_t t = 0; t < triangles; ++t) tool.push_back(probe.triangle(t));
  Found found;
  for (const LeafLane at : shown.tree().shown()) {
    const Triangle3d face = shown.triangle(at);
    for (std::uint32_t t = 0; t < triangles; ++t) {
      PairContact contact;
      if (!boxes_apart(face, tool[t]) && intersect(face, tool[t], contact))
        found.emplace_back(index(shown.tree().face(at)), t, contact.depth, flat(contact.point, contact.normal));
    }
  }
  std::sort(found.begin(), found.end());
  return found;
}

Found by_query(const Shown& shown, PlacedProbe& probe) {
  std::vector<MeshContact> contacts(1u << 16);
  const MeshQueryResult touch =
      probe.find_contacts(shown.tree(), contacts.data(), static_cast<std::uint32_t>(contacts.size()));
  EXPECT_TRUE(touch.complete);
  EXPECT_LE(touch.contacts, contacts.size());
  contacts.resize(touch.contacts);
  Found found;
  for (const MeshContact& c : contacts) {
    EXPECT_EQ(c.is_finest, index(c.face) % 2 == 1);
    found.emplace_back(index(c.face), c.triangle, c.depth, flat(c.point, c.normal));
  }
  std::sort(found.begin(), found.end());
  return found;
}

MeshProbe probe_of(const TriangleMesh& mesh) { return MeshProbe{mesh.positions, mesh.faces}; }

struct Extent {
  Vec3d low = Vec3d::Constant(1e300), high = Vec3d::Constant(-1e300);
  [[nodiscard]] double size() const { return (high - low).norm(); }
};

Extent extent(const TriangleMesh& mesh) {
  Extent e;
  for (const auto& p : mesh.positions) {
    e.low = e.low.cwiseMin(Vec3d{p[0], p[1], p[2]});
    e.high = e.high.cwiseMax(Vec3d{p[0], p[1], p[2]});
  }
  return e;
}

TriangleMesh scaled(TriangleMesh mesh, double factor) {
  for (auto& p : mesh.positions)
    for (float& x : p) x = static_cast<float>(x * factor);
  return mesh;
}

/// Returns a random orientation at a position near a random vertex.
Eigen::Isometry3d random_pose(std::mt19937_64& random, const TriangleMesh& mesh, double spread) {
  std::normal_distribution<double> normal;
  const auto& p = mesh.positions[random() % mesh.positions.size()];
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::Quaterniond{normal(random), normal(random), normal(random), normal(random)}
                      .normalized()
                      .toRotationMatrix();
  pose.translation() = Vec3d{p[0], p[1], p[2]} + spread * Vec3d{normal(random), normal(random), normal(random)};
  return pose;
}

/// Removes the faces with a vertex that does not exist or is not finite.
TriangleMesh with_finite_faces(TriangleMesh mesh) {
  const auto is_invalid = [&](const offline::Triangle& f) {
    return std::any_of(f.begin(), f.end(), [&](std::uint32_t v) {
      return v >= mesh.positions.size() ||
             !std::all_of(mesh.positions[v].begin(), mesh.positions[v].end(), [](float x) { return std::isfinite(x); });
    });
  };
  mesh.faces.erase(std::remove_if(mesh.faces.begin(), mesh.faces.end(), is_invalid), mesh.faces.end());
  for (auto& p : mesh.positions)
    for (float& x : p)
      if (!std::isfinite(x)) x = 0;
  return mesh;
}

TEST(MeshProbe, AgreesWithAllPairsOnTheZooInRandomPosesAndInTheIdentityPose) {
  std::mt19937_64 random{1};
  std::size_t contacts = 0;
  for (const test_support::ZooMesh& zoo : test_support::mesh_zoo()) {
    const TriangleMesh mesh = with_finite_faces(zoo.mesh);
    if (mesh.faces.empty()) continue;
    const Shown shown{mesh};
    const double size = extent(mesh).size();
    if (!(size > 0)) continue;
    for (const TriangleMesh& tool : {scaled(offline::stylus(), size / 0.05), mesh}) {
      if (mesh.faces.size() * tool.faces.size() > 3'000'000) continue;
      const MeshProbe probe = probe_of(tool);
      PlacedProbe placed{probe};
      for (int round = 0; round < 8; ++round) {
        SCOPED_TRACE(zoo.name + ", round " + std::to_string(round));
        // In the identity pose, a mesh lies exactly on itself, so that all degenerate contacts occur.
        if (round > 0) placed.set_pose(random_pose(random, mesh, 0.1 * size));
        const Found expected = all_pairs(shown, placed, probe.triangles());
        ASSERT_EQ(by_query(shown, placed), expected);
        contacts += expected.size();
      }
    }
  }
  EXPECT_GT(contacts, 10000u);
}

class MeshProbeOnOrgan : public ::testing::Test {
 protected:
  TriangleMesh organ_ = offline::generate(offline::Shape::kOrgan, 20000);
  Shown shown_{organ_};
  MeshProbe stylus_ = probe_of(offline::stylus());
  PlacedProbe placed_{stylus_};
  std::mt19937_64 random_{2};
};

TEST_F(MeshProbeOnOrgan, AgreesWithAllPairsInRandomPoses) {
  std::size_t contacts = 0;
  for (int round = 0; round < 12; ++round) {
    placed_.set_pose(random_pose(random_, organ_, 0.002));
    const Found expected = all_pairs(shown_, placed_, stylus_.triangles());
    ASSERT_EQ(by_query(shown_, placed_), expected) << "round " << round;
    contacts += expected.size();
  }
  EXPECT_GT(contacts, 200u);
}

TEST_F(MeshProbeOnOrgan, AgreesWithAllPairsWhileHalfOfTheFacesAreShown) {
  for (int round = 0; round < 6; ++round) {
    const std::uint64_t salt = random_();
    shown_.show([salt](std::uint32_t f) { return (f * 0x9e3779b97f4a7c15ull ^ salt) >> 13 & 1u; });
    placed_.set_pose(random_pose(random_, organ_, 0.002));
    ASSERT_EQ(by_query(shown_, placed_), all_pairs(shown_, placed_, stylus_.triangles())) << "round " << round;
  }
}

TEST_F(MeshProbeOnOrgan, GivesTheSameContactsInTheSameOrderForEveryInstructionSet) {
  PlacedProbe base{stylus_, Simd::kBase}, avx2{stylus_, std::min(Simd::kAvx2, best_simd())};
  std::vector<MeshContact> best_contacts(10000), base_contacts(10000), avx2_contacts(10000);
  for (int round = 0; round < 200; ++round) {
    const Eigen::Isometry3d pose = random_pose(random_, organ_, 0.002);
    placed_.set_pose(pose);
    base.set_pose(pose);
    avx2.set_pose(pose);
    const MeshQueryResult found = placed_.find_contacts(shown_.tree(), best_contacts.data(), 10000);
    ASSERT_EQ(base.find_contacts(shown_.tree(), base_contacts.data(), 10000).contacts, found.contacts);
    ASSERT_EQ(avx2.find_contacts(shown_.tree(), avx2_contacts.data(), 10000).contacts, found.contacts);
    for (std::uint32_t i = 0; i < found.contacts; ++i)
      for (const MeshContact* contact : {&base_contacts[i], &avx2_contacts[i]}) {
        ASSERT_EQ(best_contacts[i].face, contact->face);
        ASSERT_EQ(best_contacts[i].triangle, contact->triangle);
        ASSERT_EQ(best_contacts[i].point, contact->point);
        ASSERT_EQ(best_contacts[i].normal, contact->normal);
        ASSERT_EQ(best_contacts[i].depth, contact->depth);
      }
  }
}

TEST_F(MeshProbeOnOrgan, StopsAtItsCapacityOrItsLimitOfWorkAndReportsIt) {
  std::vector<MeshContact> all(10000), limited(10000);
  MeshQueryResult whole;
  while (whole.contacts < 20) {
    placed_.set_pose(random_pose(random_, organ_, 0.001));
    whole = placed_.find_contacts(shown_.tree(), all.data(), 10000);
  }
  limited[5].triangle = 12345;
  const MeshQueryResult truncated = placed_.find_contacts(shown_.tree(), limited.data(), 5);
  EXPECT_EQ(truncated.contacts, whole.contacts);
  EXPECT_TRUE(truncated.complete);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(limited[i].triangle, all[i].triangle);
  EXPECT_EQ(limited[5].triangle, 12345u);

  const MeshQueryResult cut = placed_.find_contacts(shown_.tree(), limited.data(), 10000, whole.work / 2);
  EXPECT_FALSE(cut.complete);
  EXPECT_LE(cut.work, whole.work / 2 + 64);
  ASSERT_LE(cut.contacts, whole.contacts);
  for (std::uint32_t i = 0; i < cut.contacts; ++i) EXPECT_EQ(limited[i].triangle, all[i].triangle);
}

TEST(MeshProbe, RefusesAMeshWithoutFacesWithAMissingVertexOrWithAnInfinitePosition) {
  const std::vector<std::array<float, 3>> corners{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const std::vector<std::array<std::uint32_t, 3>> no_faces, missing_vertex{{0, 1, 3}}, valid{{0, 1, 2}};
  EXPECT_THROW((MeshProbe{corners, no_faces}), std::invalid_argument);
  EXPECT_THROW((MeshProbe{corners, missing_vertex}), std::invalid_argument);
  std::vector<std::array<float, 3>> infinite_corners = corners;
  infinite_corners[1][0] = INFINITY;
  EXPECT_THROW((MeshProbe{infinite_corners, valid}), std::invalid_argument);
  EXPECT_EQ((MeshProbe{corners, valid}).triangles(), 1u);
}

TEST(ProbeSpheres, CoverEveryTriangleAndBeginAtTheTip) {
  const offline::TriangleMesh stylus = offline::stylus();
  const MeshProbe probe{stylus.positions, stylus.faces};
  const std::vector<ProbeSphere> spheres = spheres_of(probe, 8);
  ASSERT_EQ(spheres.size(), 8u);
  EXPECT_LT(spheres.front().centre.norm(), 0.002);
  double largest = 0;
  for (const ProbeSphere& sphere : spheres) largest = std::max(largest, sphere.radius);
  EXPECT_LT(largest, 0.0042) << "the stylus itself has a radius of 0.003";
  std::mt19937_64 random{3};
  std::uniform_real_distribution<double> share{0, 1};
  for (const auto& face : stylus.faces)
    for (int i = 0; i < 20; ++i) {
      const auto corner = [&](std::size_t c) {
        const auto& p = stylus.positions[face[c]];
        return Vec3d{p[0], p[1], p[2]};
      };
      const double a = share(random), b = share(random) * (1 - a);
      const Vec3d p = corner(0) + a * (corner(1) - corner(0)) + b * (corner(2) - corner(0));
      EXPECT_TRUE(std::any_of(spheres.begin(), spheres.end(),
                              [&](const ProbeSphere& sphere) { return (p - sphere.centre).norm() <= sphere.radius; }));
    }
  EXPECT_EQ(spheres_of(probe, 1).size(), 1u);
}

}  // namespace
}  // namespace tactus::spm
