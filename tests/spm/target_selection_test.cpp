// Tests which regions are refined for a probe. These are the most urgent regions, in whatever order they are added. For
// a stylus they include the regions along its whole length. Otherwise the contacts of its shaft would be wrong.

#include "spm/target_selection.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <random>
#include <set>

#include "spm/codec/compressed_source.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/finest_tree.hpp"
#include "spm/local_refinement.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/region_table.hpp"
#include "spm/rotation.hpp"

namespace tactus::spm {
namespace {

struct Entry {
  RegionId region{};
  double key = 0;
  [[nodiscard]] bool precedes(const Entry& other) const noexcept {
    return key != other.key ? key < other.key : region < other.region;
  }
  void merge(const Entry& other) noexcept { key = std::min(key, other.key); }
};

class RandomRegions : public testing::TestWithParam<std::uint32_t> {};

TEST_P(RandomRegions, ATableHasTheMostUrgentRegionsOfAnyOrderOfAdditionsAlsoAfterAClear) {
  const std::uint32_t capacity = GetParam();
  std::mt19937_64 random{7};
  RegionTable<Entry> table{capacity};
  for (const std::size_t added : {0u, 5u, 300u, 20000u}) {
    std::map<std::uint32_t, double> min_keys;
    table.clear();
    for (std::size_t i = 0; i < added; ++i) {
      const auto region = static_cast<std::uint32_t>(random() % 1500);
      const auto key = static_cast<double>(random() % 10000);
      table.add({RegionId{region}, key});
      double& min_key = min_keys.try_emplace(region, key).first->second;
      min_key = std::min(min_key, key);
    }
    table.sort();
    std::vector<std::pair<double, std::uint32_t>> expected, found;
    for (const auto& [region, key] : min_keys) expected.emplace_back(key, region);
    std::sort(expected.begin(), expected.end());
    EXPECT_EQ(table.complete(), expected.size() <= capacity) << added;
    expected.resize(std::min<std::size_t>(expected.size(), capacity));
    for (const Entry& entry : table.entries()) found.emplace_back(entry.key, index(entry.region));
    EXPECT_EQ(found, expected) << added;
  }
}

INSTANTIATE_TEST_SUITE_P(Capacities, RandomRegions, testing::Values(1u, 2u, 64u, 1024u));

constexpr double kRadius = 0.003;  // m, of the stylus's tip and shaft
constexpr std::uint32_t kContacts = 1u << 14;

/// An organ of 10 cm, and poses in which the shaft of the stylus touches it and the tip does not.
class StylusShaft : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World;
    const offline::TriangleMesh stylus = offline::stylus();
    world_->stylus = std::make_unique<MeshProbe>(stylus.positions, stylus.faces);
    world_->model = offline::build_model(offline::generate(offline::Shape::kOrgan, 200000));
    world_->encoded = std::make_unique<codec::EncodedModel>(world_->model.model());
    world_->finest = std::make_unique<FinestTree>(world_->model.positions, finest_faces(world_->model.model()));
    find_poses();
  }
  static void TearDownTestSuite() { delete world_; }

  using Contacts = std::set<std::array<double, 3>>;  // face, triangle, depth
  static Contacts to_set(const MeshContact* contacts, std::uint32_t count) {
    Contacts set;
    for (std::uint32_t i = 0; i < count; ++i)
      set.insert({double(index(contacts[i].face)), double(contacts[i].triangle), contacts[i].depth});
    return set;
  }
  static Contacts contacts_on(const AbTree& tree, const Eigen::Isometry3d& pose) {
    PlacedProbe placed{*world_->stylus};
    std::vector<MeshContact> contacts(kContacts);
    placed.set_pose(pose);
    return to_set(contacts.data(), placed.find_contacts(tree, contacts.data(), kContacts).contacts);
  }

  struct Outcome {
    int exact = 0;  ///< number of poses whose contacts are reported as exact
    int wrong = 0;  ///< number of these poses whose contacts differ from those of the finest mesh
  };
  /// Counts the outcomes of all poses, with the mesh refined for `shape`.
  static Outcome touch_all_poses(const ProbeShape& shape, std::uint32_t targets = 1024) {
    Outcome outcome;
    codec::CompressedSource source{world_->encoded->compressed()};
    LocalRefinementSettings settings;
    settings.memory = 24u << 20;
    settings.targets = targets;
    PlacedProbe placed{*world_->stylus};
    std::vector<MeshContact> contacts(kContacts);
    for (const Eigen::Isometry3d& pose : world_->poses) {
      LocalRefinement refinement{source, shape, settings};  // begins with the base mesh
      refinement.approach(pose, 0);
      EXPECT_EQ(refinement.refine(Budget{1u << 30}), Advance::kDone);
      placed.set_pose(pose);
      const MeshQueryResult touch = refinement.find_contacts(placed, contacts.data(), kContacts);
      if (!refinement.is_exact()) continue;
      ++outcome.exact;
      outcome.wrong += to_set(contacts.data(), touch.contacts) != contacts_on(world_->finest->tree(), pose) ? 1 : 0;
    }
    return outcome;
  }

  struct World {
    std::unique_ptr<MeshProbe> stylus;
    offline::BuiltModel model;
    std::unique_ptr<codec::EncodedModel> encoded;
    std::unique_ptr<FinestTree> finest;
    std::vector<Eigen::Isometry3d> poses;
  };
  static inline World* world_ = nullptr;

 private:
  static void find_poses() {
    constexpr double kFromTip = 0.02, kDepth = 0.0003;  // m, of the contact
    std::array<Contact, 16> at_tip;
    for (std::size_t v = 0; v < world_->model.positions.size() && world_->poses.size() < 40; v += 97) {
      const std::array<float, 3>& p = world_->model.positions[v];
      const Vec3d vertex{p[0], p[1], p[2]};
      const Vec3d outward = vertex.normalized(), axis = outward.unitOrthogonal();
      Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
      pose.linear() = spm::rotation_between(Vec3d::UnitZ(), axis).toRotationMatrix();
      pose.translation() = vertex + (kRadius - kDepth) * outward - kFromTip * axis;
      if (world_->finest->tree().find_contacts(pose.translation(), 1.5 * kRadius, at_tip.data(), 16) > 0) continue;
      if (!contacts_on(world_->finest->tree(), pose).empty()) world_->poses.push_back(pose);
    }
    ASSERT_GE(world_->poses.size(), 20u);
  }
};

TEST_F(StylusShaft, HasTheContactsOfTheFinestMesh) {
  const Outcome outcome = touch_all_poses(ProbeShape{*world_->stylus});
  EXPECT_EQ(outcome.exact, int(world_->poses.size()));
  EXPECT_EQ(outcome.wrong, 0);
}

TEST_F(StylusShaft, HasWrongContactsWhenOnlyTheTipIsRefined) {
  const Outcome outcome = touch_all_poses(ProbeShape{kRadius});
  EXPECT_GT(outcome.wrong, outcome.exact / 2) << "the shaft hardly touches faces that need refinement";
}

TEST_F(StylusShaft, WithTooFewTargetsIsNotReportedAsExact) {
  const Outcome outcome = touch_all_poses(ProbeShape{*world_->stylus}, 2);
  EXPECT_LT(outcome.exact, int(world_->poses.size()) / 2);
  EXPECT_EQ(outcome.wrong, 0);
}

TEST_F(StylusShaft, ASmallSelectionHasTheFirstTargetsOfALargeOne) {
  codec::CompressedSource source{world_->encoded->compressed()};
  const ProbeShape shape{*world_->stylus};
  LocalRefinementSettings settings;
  settings.margins.refine = 0.02;  // selects more regions than the shaft intersects
  LocalRefinement refinement{source, shape, settings};
  const Eigen::Isometry3d& pose = world_->poses.front();
  refinement.approach(pose, 0);
  std::vector<PlacedSphere> spheres;
  for (const ProbeSphere& sphere : shape.spheres()) spheres.push_back({pose * sphere.centre, sphere.radius, {0, 0, 0}});
  const auto select = [&](std::uint32_t capacity, bool reversed) {
    TargetSelection selection{capacity};
    selection.begin(refinement.forest(), settings.margins);
    if (reversed) std::reverse(spheres.begin(), spheres.end());
    for (const PlacedSphere& sphere : spheres) selection.add_sphere(sphere);
    const std::span<const RegionId> targets = selection.finish();
    EXPECT_EQ(selection.complete(), targets.size() < capacity) << capacity;
    return std::vector<RegionId>{targets.begin(), targets.end()};
  };
  const std::vector<RegionId> all = select(4096, false);
  ASSERT_GT(all.size(), 4u);
  for (const bool reversed : {false, true})
    EXPECT_THAT(select(4, reversed), ::testing::ElementsAreArray(all.data(), 4)) << reversed;
}

TEST_F(StylusShaft, RegionsNearASphereAreOrderedByTheirDistance) {
  codec::CompressedSource source{world_->encoded->compressed()};
  const ProbeShape shape{*world_->stylus};
  LocalRefinementSettings settings;
  settings.margins = {0.02, 0};
  LocalRefinement refinement{source, shape, settings};
  const Eigen::Isometry3d& pose = world_->poses.front();
  refinement.approach(pose, 0);
  const PlacedSphere tip{pose.translation(), kRadius, Vec3d::Zero()};
  TargetSelection selection{4096};
  selection.begin(refinement.forest(), settings.margins);
  selection.add_sphere(tip);
  std::vector<double> distances;
  for (const RegionId region : selection.finish())
    distances.push_back(refinement.forest().grid().squared_distance(region, tip.centre));
  ASSERT_GT(distances.size(), 10u);
  EXPECT_GT(distances.back(), kRadius * kRadius) << "all regions are in the first group";
  EXPECT_TRUE(std::is_sorted(distances.begin(), distances.end()));
}

}  // namespace
}  // namespace tactus::spm
