// Tests cache, forest and tree together on random models, and compares their answers with brute force.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <thread>

#include "spm/checksum.hpp"
#include "spm/flat_index.hpp"
#include "spm/triangle_pair.hpp"
#include "tests/support/hrtc_model.hpp"
#include "tests/support/loaded_records.hpp"
#include "tests/support/random_model.hpp"

namespace tactus {
namespace {

using spm::AcceptResult;
using spm::Advance;
using spm::OwnedModel;
using spm::RegionId;
using spm::Triangle3d;
using test_support::HrtcModel;
using test_support::random_model;
using ::testing::IsEmpty;

constexpr std::uint32_t kRecords = 600;
constexpr std::uint32_t kCells = 3;
spm::PoolSettings large_pool() { return spm::PoolSettings::for_slots(8192); }

std::vector<RegionId> all_regions(const spm::Model& model) {
  std::vector<RegionId> regions;
  for (std::uint32_t i = 0; i < model.summary.regions; ++i) regions.push_back(RegionId{i});
  return regions;
}

class RunTime : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  static spm::Vec3d to_vector(const std::array<float, 3>& p) { return {p[0], p[1], p[2]}; }

  static void load_all(HrtcModel& hrtc) {
    for (const RegionId region : all_regions(hrtc.model())) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  }
  double unit() { return std::uniform_real_distribution<double>{0, 1}(random_); }
  spm::Vec3d random_point() { return low_ + (high_ - low_).cwiseProduct(spm::Vec3d{unit(), unit(), unit()}); }
  /// Returns fewer than `limit` different regions in random order.
  std::vector<RegionId> random_regions(std::size_t limit) {
    std::vector<RegionId> regions = regions_;
    std::shuffle(regions.begin(), regions.end(), random_);
    regions.resize(random_() % limit);
    return regions;
  }

  OwnedModel owned_ = random_model(GetParam(), kRecords, kCells);
  spm::Model model_ = owned_.model();
  std::vector<RegionId> regions_ = all_regions(model_);
  spm::Vec3d low_ = to_vector(model_.summary.bounds_min), high_ = to_vector(model_.summary.bounds_max);
  double size_ = (high_ - low_).norm();
  std::mt19937_64 random_{GetParam()};
};

Triangle3d triangle_of(const std::array<float, 9>& corners) {
  Triangle3d triangle;
  for (int i = 0; i < 3; ++i) triangle[i] = {corners[3 * i], corners[3 * i + 1], corners[3 * i + 2]};
  return triangle;
}

std::vector<Triangle3d> shown_triangles(const spm::AbTree& tree) {
  std::vector<Triangle3d> triangles;
  for (const spm::LeafLane at : tree.shown()) triangles.push_back(triangle_of(tree.corners(at)));
  return triangles;
}

double squared_distance(const spm::Vec3d& point, const Triangle3d& t) {
  return spm::closest_point(point, t[0], t[1], t[2]).squared_distance;
}

/// Returns the time from 0 to 1 at which a moving sphere first touches a triangle, or 2 if it touches none.
double time_of_impact(const spm::Vec3d& from, const spm::Vec3d& to, double radius,
                      const std::vector<Triangle3d>& triangles) {
  double first = 2;
  for (const auto& [a, b, c] : triangles) {
    spm::SweepHit hit;
    if (spm::swept_sphere(from, to, radius, a, b, c, hit)) first = std::min(first, hit.time);
  }
  return first;
}

TEST_P(RunTime, RefiningAllRegionsShowsTheFinestMesh) {
  HrtcModel hrtc{model_, large_pool()};
  load_all(hrtc);

  ASSERT_EQ(hrtc.refine(regions_), Advance::kDone);

  const auto finest = spm::finest_faces(model_);
  std::uint32_t compared = 0;
  const spm::AbTree& tree = hrtc.forest().tree();
  for (const auto& [row, face] : hrtc.forest().shown_faces()) {
    const spm::LeafLane at = hrtc.forest().shown_at(row);
    if (!tree.is_finest(at)) continue;
    ++compared;
    for (std::size_t corner = 0; corner < 3; ++corner)
      EXPECT_EQ(index(hrtc.vertex_id(face.corners[corner])), finest[index(tree.face(at))][corner]);
  }
  EXPECT_GT(compared, model_.summary.faces / 2);
  EXPECT_THAT(hrtc.forest().violations(), IsEmpty());
}

TEST_P(RunTime, ASphereWithANaNIsNeverExact) {
  HrtcModel hrtc{model_, large_pool()};
  load_all(hrtc);
  ASSERT_EQ(hrtc.refine(regions_), Advance::kDone);
  const spm::Forest& forest = hrtc.forest();
  const spm::Vec3d middle = (low_ + high_) / 2;
  const double radius = size_ / 50;
  ASSERT_TRUE(forest.is_exact(middle, radius));
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  for (int axis = 0; axis < 3; ++axis) {
    spm::Vec3d centre = middle;
    centre[axis] = kNaN;
    EXPECT_FALSE(forest.is_exact(centre, radius)) << axis;
  }
  EXPECT_FALSE(forest.is_exact(middle, kNaN));
}

TEST_P(RunTime, EachBaseFaceHasTheGreatestRadiusOfItsCorners) {
  HrtcModel hrtc{model_, large_pool()};
  for (const spm::BaseSlots::Face& face : hrtc.forest().base().faces) {
    std::uint16_t greatest = 0;
    for (const spm::Slot slot : face.corners)
      greatest = std::max(greatest, model_.base_radii[index(hrtc.vertex_id(slot))]);
    EXPECT_EQ(face.radius, greatest) << "row " << index(face.row);
  }
}

TEST_P(RunTime, LoadsEveryRecordToTheBitInAnyOrderOfRegions) {
  std::vector<RegionId> order = regions_;
  std::shuffle(order.begin(), order.end(), random_);
  HrtcModel hrtc{model_, large_pool()};
  for (const RegionId region : order) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  EXPECT_EQ(test_support::loaded_difference(model_, hrtc.pool()), "");
}

TEST_P(RunTime, APositionOutsideTheBoundsIsMalformedAndChangesNothing) {
  HrtcModel hrtc{model_, large_pool()};
  const RegionId region = regions_.back();
  const std::uint32_t free_before = hrtc.cache().slots_free();
  int malformed = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const std::uint32_t octaves16 : {1u << 27, -(1u << 27)}) {  // multiplies the coordinate by 2^16 or 2^-16
      spm::RegionData data = hrtc.message(region);
      data.residuals.back()[axis] += octaves16;
      spm::RegionList list;
      const AcceptResult result = hrtc.accept(data, list);
      if (result == AcceptResult::kAccepted) {
        hrtc.cache().release(hrtc.object(), region);
        continue;
      }
      ++malformed;
      EXPECT_EQ(result, AcceptResult::kMalformed);
      EXPECT_EQ(hrtc.cache().slots_free(), free_before);
      EXPECT_THAT(hrtc.cache().violations(), IsEmpty());
    }
  }
  EXPECT_GE(malformed, 3) << "at least one of the two changes leaves the bounds on each axis";
  EXPECT_EQ(hrtc.load(region), AcceptResult::kAccepted);
}

TEST(RadiusCode, IsTheSmallestCodeWithARadiusOfAtLeastTheDistance) {
  std::mt19937_64 random{7};
  for (int round = 0; round < 100'000; ++round) {
    const double distance = std::exp2(std::uniform_real_distribution{-160.0, 127.9}(random));
    const std::uint16_t code = spm::radius_code(distance);
    if (code == spm::kRadiusCodes) {
      ASSERT_GT(distance, spm::radius_of(spm::kRadiusCodes - 1));
      continue;
    }
    ASSERT_GE(spm::radius_of(code), distance);
    ASSERT_LT(spm::radius_of(static_cast<std::uint16_t>(code - 1)), distance);
    if (distance > 1.2e-38) {  // the radius is a normal float
      ASSERT_LE(spm::radius_of(code), distance * 1.0625);
    }
  }
  EXPECT_EQ(spm::radius_code(0), 0);
  EXPECT_EQ(spm::radius_code(1e39), spm::kRadiusCodes);
  for (std::uint16_t code = 0; code < spm::kRadiusCodes; ++code)
    ASSERT_EQ(spm::radius_code(spm::radius_of(code)), code);
}

TEST_P(RunTime, HasNoViolationsAfterAnySequenceOfLoadRefineCoarsenAndRelease) {
  HrtcModel hrtc{model_, large_pool()};
  const std::uint64_t base_hash = hrtc.forest().mesh_hash();
  std::vector<RegionId> wanted;
  const auto any_region = [&] { return RegionId{static_cast<std::uint32_t>(random_() % model_.summary.regions)}; };
  for (int step = 0; step < 400; ++step) {
    SCOPED_TRACE("seed " + std::to_string(GetParam()) + " step " + std::to_string(step));
    const RegionId region = any_region();
    switch (random_() % 4) {
      case 0:
        if (!hrtc.cache().is_loaded(hrtc.object(), region)) {
          ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
        } else {
          ASSERT_EQ(hrtc.load(region), AcceptResult::kLoaded);
        }
        break;
      case 1:
        if (hrtc.forest().is_loaded(region) && !hrtc.forest().is_retiring(region)) hrtc.forest().retire(region);
        break;
      default:
        wanted.clear();
        for (std::uint64_t i = random_() % 6; i > 0; --i) wanted.push_back(any_region());
    }
    (void)hrtc.refine(wanted, static_cast<std::uint32_t>(random_() % 3000), nullptr, 0,
                      random_() % 2 == 0 ? spm::Unrequested::kCoarsen : spm::Unrequested::kRetain);
    hrtc.release_retired();
    ASSERT_THAT(hrtc.forest().violations(), IsEmpty());
    ASSERT_THAT(hrtc.cache().violations(), IsEmpty());
  }
  ASSERT_EQ(hrtc.refine({}), Advance::kDone);
  hrtc.release_retired();
  EXPECT_EQ(hrtc.forest().mesh_hash(), base_hash);
  EXPECT_EQ(hrtc.forest().tree().shown().size(), model_.summary.base_faces);
}

TEST_P(RunTime, TheMeshHashDependsOnlyOnTheRefinedRegions) {
  HrtcModel direct{model_, large_pool()};
  HrtcModel with_detours{model_, large_pool()};
  load_all(direct);
  load_all(with_detours);
  std::vector<RegionId> targets;
  for (const RegionId region : regions_)
    if (random_() % 3 == 0) targets.push_back(region);
  for (int i = 0; i < 50; ++i) {
    const std::vector<RegionId> detour = random_regions(regions_.size());
    (void)with_detours.refine(detour, static_cast<std::uint32_t>(random_() % 2000));
  }

  ASSERT_EQ(direct.refine(targets), Advance::kDone);
  ASSERT_EQ(with_detours.refine(targets), Advance::kDone);

  EXPECT_EQ(direct.forest().mesh_hash(), with_detours.forest().mesh_hash());
}

TEST_P(RunTime, AFullPoolRefusesARegionAndChangesNothing) {
  const std::uint32_t base = std::max(model_.summary.base_vertices, (model_.summary.base_faces + 1) / 2);
  HrtcModel hrtc{model_, spm::PoolSettings::for_slots(base + model_.summary.parts / 3)};
  std::uint32_t refused = 0;
  for (const RegionId region : regions_) {
    const std::uint32_t free_before = hrtc.cache().slots_free();
    const AcceptResult result = hrtc.load(region);
    ASSERT_THAT(result, ::testing::AnyOf(AcceptResult::kAccepted, AcceptResult::kPoolFull));
    if (result != AcceptResult::kPoolFull) continue;
    ++refused;
    ASSERT_EQ(hrtc.cache().slots_free(), free_before);
    ASSERT_THAT(hrtc.cache().violations(), IsEmpty());
  }
  EXPECT_GT(refused, 0u);
}

/// Changes the ids of all faces in a message.
template <class Renumbered>
void renumber(spm::RegionData& data, const Renumbered& renumbered) {
  for (spm::RecordPart& part : data.parts) {
    for (int i = 0; i < part.born_count; ++i) {
      const spm::BornRef ref = part.born[i];
      part.born[i] = spm::BornRef::make(renumbered(ref.face()), ref.order(), ref.is_finest());
    }
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
      const spm::DeformedRef ref = part.deformed(i);
      if (ref.face() == spm::kSwing) continue;
      part.set_deformed(i, spm::DeformedRef::make(renumbered(ref.face()), ref.corner(), ref.is_finest()));
    }
  }
}

TEST_P(RunTime, FacesWithIdsInTheWholeRangeAreLoadedRefinedAndTouchedLikeOthers) {
  // The ids begin at 0, a quarter, half and three quarters of the range, and end at its end.
  const std::uint32_t faces = model_.summary.faces, quarter = spm::kMaxFaces / 4;
  const std::array<std::uint32_t, 5> offsets{0, quarter, 2 * quarter, 3 * quarter, spm::kMaxFaces - 1 - faces};
  const auto renumbered = [&](spm::FaceId face) {
    return spm::FaceId{index(face) + offsets[index(face) * offsets.size() / faces]};
  };
  HrtcModel usual{model_, large_pool()};
  spm::BaseMesh base = spm::base_mesh_of(model_);
  base.summary.faces = spm::kMaxFaces - 1;
  for (spm::BaseFace& face : base.faces) face.face = renumbered(face.face);
  spm::Pool pool{large_pool()};
  spm::NodePool nodes{large_pool().tree_nodes};
  spm::Cache cache{pool};
  // Two objects with the same model, as the keys of tree nodes contain the object too.
  std::vector<std::pair<spm::ObjectIndex, std::unique_ptr<spm::Forest>>> objects;
  for (int i = 0; i < 2; ++i) {
    spm::Cache::Admitted admitted = cache.admit(base);
    ASSERT_TRUE(admitted.fits);
    spm::RegionGrid grid{model_.summary.grid, model_.regions};
    objects.emplace_back(admitted.object, std::make_unique<spm::Forest>(pool, nodes, admitted.object, base.summary,
                                                                        std::move(grid), std::move(admitted.base)));
    ASSERT_EQ(objects.back().second->tree().height(), 10u);
  }
  const std::uint32_t free_before = cache.slots_free();
  for (const RegionId region : regions_) {
    spm::RegionData data = usual.message(region);
    renumber(data, renumbered);
    for (const auto& [object, forest] : objects) {
      spm::RegionList list;
      ASSERT_EQ(cache.accept(object, data, list_summary(model_.regions[index(region)]), list), AcceptResult::kAccepted);
      forest->add(region, list);
    }
    ASSERT_EQ(usual.load(region), AcceptResult::kAccepted);
  }
  const auto refine = [](spm::Forest& forest, const std::vector<RegionId>& targets) {
    forest.set_targets(targets.data(), static_cast<std::uint32_t>(targets.size()), spm::Unrequested::kCoarsen);
    spm::Budget budget{1u << 30};
    ASSERT_EQ(forest.advance(budget), Advance::kDone);
    forest.refit(nullptr, 0);
    EXPECT_THAT(forest.violations(), IsEmpty());
  };
  const std::vector<RegionId> half{regions_.begin(),
                                   regions_.begin() + static_cast<std::ptrdiff_t>(regions_.size() / 2)};
  for (const std::vector<RegionId>& targets : {regions_, half}) {
    ASSERT_EQ(usual.refine(targets), Advance::kDone);
    const spm::AbTree& usual_tree = usual.forest().tree();
    const std::vector<spm::LeafLane> usually_shown = usual_tree.shown();
    for (const auto& [object, forest] : objects) {
      refine(*forest, targets);
      EXPECT_EQ(forest->mesh_hash(), usual.forest().mesh_hash());
      const spm::AbTree& tree = forest->tree();
      const std::vector<spm::LeafLane> shown = tree.shown();
      ASSERT_EQ(shown.size(), usually_shown.size());
      for (std::size_t i = 0; i < shown.size(); ++i) {
        ASSERT_EQ(tree.face(shown[i]), renumbered(usual_tree.face(usually_shown[i])));
        ASSERT_EQ(tree.corners(shown[i]), usual_tree.corners(usually_shown[i]));
        ASSERT_EQ(tree.is_finest(shown[i]), usual_tree.is_finest(usually_shown[i]));
      }
      std::vector<spm::Contact> contacts(4096);
      std::set<std::uint32_t> touched, usually_touched;
      const auto touch = [&](const spm::AbTree& by) {
        return by.find_contacts((low_ + high_) / 2, size_ / 8, contacts.data(), 4096);
      };
      for (std::uint32_t i = touch(tree); i-- > 0;) touched.insert(index(contacts[i].face));
      for (std::uint32_t i = touch(usual_tree); i-- > 0;) usually_touched.insert(index(renumbered(contacts[i].face)));
      EXPECT_FALSE(touched.empty());
      EXPECT_EQ(touched, usually_touched);
    }
    EXPECT_THAT(cache.violations(), IsEmpty());
  }
  for (const auto& [object, forest] : objects) {
    for (const RegionId region : regions_) forest->retire(region);
    refine(*forest, {});
    for (RegionId region; (region = forest->take_retired()) != spm::kNone;) cache.release(object, region);
  }
  EXPECT_EQ(cache.slots_free(), free_before);
  EXPECT_THAT(cache.violations(), IsEmpty());
}

TEST(CacheCounts, AnObjectIsRefusedWhileThereAre64Others) {
  const OwnedModel owned = random_model(1, 50, kCells);
  const spm::BaseMesh base = spm::base_mesh_of(owned.model());
  constexpr std::uint32_t kMax = 64;
  spm::Pool pool{spm::PoolSettings::for_slots((kMax + 1) * spm::Cache::slots_for_base(base.summary))};
  spm::Cache cache{pool};
  for (std::uint32_t i = 0; i < kMax; ++i) ASSERT_TRUE(cache.admit(base).fits) << i;
  const std::uint32_t free_before = cache.slots_free();
  ASSERT_GE(free_before, spm::Cache::slots_for_base(base.summary));

  EXPECT_FALSE(cache.admit(base).fits);
  EXPECT_EQ(cache.slots_free(), free_before);
  EXPECT_THAT(cache.violations(), IsEmpty());

  cache.remove(spm::ObjectIndex{5});
  EXPECT_TRUE(cache.admit(base).fits);
}

TEST(CacheCounts, ARegionIsRefusedWhileTheRegionCounterOfItsRecordsIsFull) {
  const OwnedModel owned = random_model(1, kRecords, kCells);
  const spm::Model model = owned.model();
  const auto has_shorter_list = [](const spm::Region& a, const spm::Region& b) {
    return (a.record_count == 0 ? ~0u : a.record_count) < (b.record_count == 0 ? ~0u : b.record_count);
  };
  const auto shortest = std::min_element(model.regions.begin(), model.regions.end(), has_shorter_list);
  const RegionId region{static_cast<std::uint32_t>(shortest - model.regions.begin())};
  spm::RegionData data = HrtcModel{model, large_pool()}.message(region);
  spm::BaseMesh base = spm::base_mesh_of(model);
  constexpr std::uint32_t kMax = 32767;
  base.summary.regions = kMax + 1;  // all with the same closed list
  spm::PoolSettings settings = large_pool();
  settings.list_blocks = (kMax + 1) * spm::ListBlock::blocks_for(shortest->record_count);
  spm::Pool pool{settings};
  spm::Cache cache{pool};
  const spm::Cache::Admitted admitted = cache.admit(base);
  spm::RegionList list;
  const auto accept = [&](std::uint32_t number) {
    data.region = RegionId{number};
    return cache.accept(admitted.object, data, list_summary(*shortest), list);
  };
  for (std::uint32_t i = 0; i < kMax; ++i) ASSERT_EQ(accept(i), AcceptResult::kAccepted) << i;
  const std::uint32_t blocks_free = cache.blocks_free();

  EXPECT_EQ(accept(kMax), AcceptResult::kPoolFull);
  EXPECT_EQ(cache.blocks_free(), blocks_free);
  EXPECT_THAT(cache.violations(), IsEmpty());

  cache.release(admitted.object, RegionId{0});
  EXPECT_EQ(accept(kMax), AcceptResult::kAccepted);
}

TEST(CacheCounts, AListIsStillCheckedAfter255OtherLists) {
  const OwnedModel owned = random_model(1, kRecords, kCells);
  const spm::Model model = owned.model();
  const std::vector<std::uint32_t> checksums = spm::record_checksums(model);
  const spm::BaseMesh base = spm::base_mesh_of(model);
  // The false list has only the last record of a region's list, whose parent is added by another record.
  RegionId region{0};
  spm::RecordId last{};
  for (const RegionId candidate : all_regions(model)) {
    const std::span<const spm::Interval> list = model.intervals_of(candidate);
    if (list.empty()) continue;
    const spm::RecordId end{list.back().first + list.back().count - 1};
    if (index(model.first_part(end).parent) < model.summary.base_vertices) continue;
    region = candidate;
    last = end;
  }
  ASSERT_NE(index(last), 0u);
  spm::Region false_region = model.regions[index(region)];
  false_region.record_count = false_region.part_count = 1;
  false_region.checksum = checksums[index(last)];
  spm::RegionData data = HrtcModel{model, large_pool()}.message(region);
  data.region = RegionId{0};
  spm::Pool pool{large_pool()};
  spm::Cache cache{pool};
  const spm::Cache::Admitted admitted = cache.admit(base);
  spm::RegionList list;
  ASSERT_EQ(cache.accept(admitted.object, data, list_summary(model.regions[index(region)]), list),
            AcceptResult::kAccepted);

  spm::RegionData false_data;
  false_data.region = RegionId{1};
  false_data.list = {{index(last), 1}};
  for (int i = 0; i < 600; ++i)
    ASSERT_EQ(cache.accept(admitted.object, false_data, list_summary(false_region), list), AcceptResult::kMalformed)
        << i;
}

TEST_P(RunTime, AMessageThatLacksARecordIsIncompleteAndChangesNothing) {
  HrtcModel hrtc{model_, large_pool()};
  spm::RegionData data;
  for (const RegionId region : regions_) {
    data = hrtc.message(region);
    if (data.residuals.size() > 4) break;
  }
  // Remove the first sent record and its parts.
  std::uint32_t parts = 1;
  while (data.parts[parts - 1].next != spm::kNone) ++parts;
  data.parts.erase(data.parts.begin(), data.parts.begin() + parts);
  for (spm::RecordPart& part : data.parts)
    if (part.next != spm::kNone) part.next = spm::PartIndex{index(part.next) - parts};
  data.residuals.erase(data.residuals.begin());
  ++data.sent.front().first;
  if (--data.sent.front().count == 0) data.sent.erase(data.sent.begin());
  const std::uint32_t free_before = hrtc.cache().slots_free();

  spm::RegionList list;
  EXPECT_EQ(hrtc.accept(data, list), AcceptResult::kIncomplete);

  EXPECT_EQ(hrtc.cache().slots_free(), free_before);
  EXPECT_THAT(hrtc.cache().violations(), IsEmpty());
}

TEST_P(RunTime, AListWithAReplacedRecordIsRefusedAndChangesNothing) {
  HrtcModel hrtc{model_, large_pool()};
  const std::uint32_t free_before = hrtc.cache().slots_free();
  std::uint32_t malformed = 0;
  for (int round = 0; round < 200; ++round) {
    const RegionId region{static_cast<std::uint32_t>(random_() % model_.summary.regions)};
    std::set<std::uint32_t> list;
    for (const spm::Interval& interval : model_.intervals_of(region))
      for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) list.insert(r);
    const auto unlisted = static_cast<std::uint32_t>(random_() % model_.summary.records);
    if (list.empty() || list.count(unlisted) > 0) continue;
    list.erase(std::next(list.begin(), static_cast<std::ptrdiff_t>(random_() % list.size())));
    list.insert(unlisted);
    std::vector<spm::Interval> intervals;
    for (const std::uint32_t record : list) {
      if (!intervals.empty() && intervals.back().first + intervals.back().count == record)
        ++intervals.back().count;
      else
        intervals.push_back({record, 1});
    }
    spm::RegionData data = hrtc.false_message(region, intervals);
    spm::RegionList out;
    const AcceptResult result = hrtc.accept(data, out);
    ASSERT_NE(result, AcceptResult::kAccepted) << "round " << round;
    if (result == AcceptResult::kMalformed) ++malformed;
    ASSERT_EQ(hrtc.cache().slots_free(), free_before);
  }
  EXPECT_GT(malformed, 0u);
  EXPECT_THAT(hrtc.cache().violations(), IsEmpty());
}

TEST_P(RunTime, TooFewTreeNodesLeaveRegionsCoarseWithoutViolations) {
  spm::PoolSettings settings = large_pool();
  settings.tree_nodes = model_.summary.base_faces * 5 + 40;
  HrtcModel hrtc{model_, settings};
  load_all(hrtc);

  EXPECT_EQ(hrtc.refine(regions_), Advance::kNodesFull);

  EXPECT_THAT(hrtc.forest().violations(), IsEmpty());
  EXPECT_EQ(hrtc.refine({}), Advance::kDone);
  EXPECT_EQ(hrtc.forest().mesh_hash(), 0u);
}

TEST_P(RunTime, QueriesAgreeWithBruteForce) {
  HrtcModel hrtc{model_, large_pool()};
  load_all(hrtc);
  std::vector<spm::Contact> contacts(4096);
  spm::CandidateCaches caches;
  std::uint64_t touched = 0, swept = 0, with_neighbours = 0;
  for (int round = 0; round < 60; ++round) {
    const std::vector<RegionId> wanted = random_regions(regions_.size());
    (void)hrtc.refine(wanted, static_cast<std::uint32_t>(random_() % 20000));
    const spm::AbTree& tree = hrtc.forest().tree();
    const double radius = unit() * 0.2 * size_;
    const spm::Vec3d centre = random_point(), target = random_point();

    std::vector<std::uint32_t> expected;
    double nearest_squared = 1e300;
    for (const spm::LeafLane at : tree.shown()) {
      const double squared = squared_distance(centre, triangle_of(tree.corners(at)));
      nearest_squared = std::min(nearest_squared, squared);
      if (squared <= radius * radius) expected.push_back(index(tree.face(at)));
    }
    const std::uint32_t found = tree.find_contacts(centre, radius, contacts.data(), 4096);
    std::vector<std::uint32_t> faces;
    for (std::uint32_t i = 0; i < found; ++i) faces.push_back(spm::index(contacts[i].face));
    ASSERT_EQ(faces, expected) << "both are in tree order, which is the order of face ids";
    touched += found;

    spm::NearestFace nearest;
    ASSERT_TRUE(tree.nearest(centre, 1e9, nearest));
    ASSERT_NEAR(nearest.squared_distance, nearest_squared, 1e-14 * size_ * size_) << "beyond the rounding of the lanes";
    const double margin = unit() * 0.02 * size_;
    const double limit = std::sqrt(nearest_squared) + margin;
    std::vector<spm::LeafLane> expected_places;
    for (const spm::LeafLane at : tree.shown())
      if (squared_distance(centre, triangle_of(tree.corners(at))) <= limit * limit) expected_places.push_back(at);
    std::vector<spm::LeafLane> places(spm::AbTree::kMaxNearest);
    places.resize(tree.nearest(centre, 1e9, margin, nearest, places.data(), spm::AbTree::kMaxNearest));
    if (expected_places.size() <= places.size()) {
      ASSERT_EQ(places, expected_places) << "both are in tree order";
      with_neighbours += places.size() > 1 ? 1 : 0;
    }

    // In every second round the sphere touches the mesh at the start, like the sphere of a proxy.
    const double swept_radius = round % 2 == 0 ? radius / 4 : std::sqrt(nearest_squared) * (1 - 1e-6);
    const double first = time_of_impact(centre, target, swept_radius, shown_triangles(tree));
    spm::SweepContact contact;
    const bool hit = tree.sweep(centre, target, swept_radius, contact, spm::Version::kCurrent, &caches);
    ASSERT_EQ(hit, first <= 1);
    if (hit) {
      ASSERT_EQ(contact.time, first);
      ++swept;
    }
  }
  EXPECT_GT(touched, 100u);
  EXPECT_GT(swept, 5u);
  EXPECT_GT(with_neighbours, 5u);
}

TEST_P(RunTime, AChangeDetectorReportsChangesInItsSphereAndChangesWhoseBoxContainsIt) {
  HrtcModel hrtc{model_, large_pool()};
  load_all(hrtc);
  using Faces = std::map<std::uint32_t, std::array<float, 9>>;  // corners by face id
  const auto shown_faces = [&] {
    Faces shown;
    const spm::AbTree& tree = hrtc.forest().tree();
    for (const spm::LeafLane at : tree.shown()) shown[index(tree.face(at))] = tree.corners(at);
    return shown;
  };
  const auto append_differing = [](const Faces& faces, const Faces& others, std::vector<Triangle3d>& differing) {
    for (const auto& [face, corners] : faces)
      if (const auto other = others.find(face); other == others.end() || other->second != corners)
        differing.push_back(triangle_of(corners));
  };
  int changed_near = 0, changed_around = 0, unchanged = 0;
  for (int round = 0; round < 200; ++round) {
    const std::vector<RegionId> wanted = random_regions(4);
    std::array<spm::ChangeDetector, 8> detectors;
    for (spm::ChangeDetector& detector : detectors) {
      detector.centre = random_point();
      detector.radius = unit() * 0.05 * size_;
    }
    const Faces before = shown_faces();
    (void)hrtc.refine(wanted, static_cast<std::uint32_t>(random_() % 300), detectors.data(), detectors.size());
    const Faces after = shown_faces();

    std::vector<Triangle3d> changed;
    append_differing(before, after, changed);
    append_differing(after, before, changed);
    Eigen::AlignedBox3d changed_box;
    for (const Triangle3d& triangle : changed)
      for (const spm::Vec3d& corner : triangle) changed_box.extend(corner);
    for (const spm::ChangeDetector& detector : detectors) {
      const bool near = std::any_of(changed.begin(), changed.end(), [&](const Triangle3d& triangle) {
        return squared_distance(detector.centre, triangle) <= detector.radius * detector.radius;
      });
      const spm::Vec3d half_size = spm::Vec3d::Constant(detector.radius);
      const bool around =
          changed_box.contains(detector.centre - half_size) && changed_box.contains(detector.centre + half_size);
      if (near || around) {
        ASSERT_TRUE(detector.is_changed) << "round " << round;
      }
      changed_near += near ? 1 : 0;
      changed_around += around && !near ? 1 : 0;
      unchanged += detector.is_changed ? 0 : 1;
    }
  }
  EXPECT_GT(changed_near, 20);
  EXPECT_GT(changed_around, 20);
  EXPECT_GT(unchanged, 200) << "the detectors report too much";
}

TEST_P(RunTime, ASweepOnThePreviousMeshHitsTheSameFacesAsBeforeTheRefinement) {
  HrtcModel hrtc{model_, large_pool()};
  load_all(hrtc);
  const spm::AbTree& tree = hrtc.forest().tree();
  spm::CandidateCaches caches;
  struct Sweep {
    spm::Vec3d from, to;
    double radius;
    bool hit;
    spm::SweepContact contact;
  };
  int differed = 0;
  for (int round = 0; round < 100; ++round) {
    std::vector<Sweep> queries(20);
    for (Sweep& sweep : queries) {
      sweep.from = random_point();
      sweep.to = random_point();
      sweep.radius = unit() * 0.05 * size_;
      sweep.hit = tree.sweep(sweep.from, sweep.to, sweep.radius, sweep.contact, spm::Version::kCurrent, &caches);
    }
    const std::vector<RegionId> wanted = random_regions(4);
    hrtc.forest().store_previous(true);
    for (int step = 0; step < 2; ++step) {  // one stored version can serve several refits
      const spm::Advance result = hrtc.refine(wanted, static_cast<std::uint32_t>(random_() % 2000));
      ASSERT_NE(result, Advance::kPreviousFull);
    }
    for (const Sweep& sweep : queries) {
      spm::SweepContact contact, current;
      ASSERT_EQ(tree.sweep(sweep.from, sweep.to, sweep.radius, contact, spm::Version::kPrevious, &caches), sweep.hit);
      const bool hits_current =
          tree.sweep(sweep.from, sweep.to, sweep.radius, current, spm::Version::kCurrent, &caches);
      if (!sweep.hit) continue;
      ASSERT_EQ(contact.face, sweep.contact.face) << "round " << round;
      ASSERT_EQ(contact.time, sweep.contact.time);
      ASSERT_EQ(contact.point, sweep.contact.point);
      differed += hits_current && current.time == contact.time ? 0 : 1;
    }
    hrtc.forest().store_previous(false);
  }
  EXPECT_GT(differed, 20) << "the refinements hardly changed the contacts";
}

TEST_P(RunTime, AMovingSphereHitsTheSameFacesAsBruteForceOnBothMeshes) {
  HrtcModel hrtc{model_, large_pool()};
  load_all(hrtc);
  ASSERT_EQ(hrtc.refine({}), Advance::kDone);
  const spm::AbTree& tree = hrtc.forest().tree();
  spm::CandidateCaches caches;
  const auto distance = [](const std::vector<Triangle3d>& triangles, const spm::Vec3d& point) {
    double squared = 1e300;
    for (const Triangle3d& triangle : triangles) squared = std::min(squared, squared_distance(point, triangle));
    return std::sqrt(squared);
  };
  spm::Vec3d centre = random_point();
  int early_hits = 0, misses = 0, late_hits = 0;
  for (int round = 0; round < 60; ++round) {
    const std::vector<Triangle3d> before = shown_triangles(tree);
    const std::vector<RegionId> wanted = random_regions(6);
    hrtc.forest().store_previous(true);
    ASSERT_NE(hrtc.refine(wanted, static_cast<std::uint32_t>(random_() % 4000)), Advance::kPreviousFull);
    const std::vector<Triangle3d> after = shown_triangles(tree);
    for (const spm::Version version : {spm::Version::kCurrent, spm::Version::kPrevious, spm::Version::kCurrent}) {
      const std::vector<Triangle3d>& triangles = version == spm::Version::kCurrent ? after : before;
      if (random_() % 2 == 0) centre = random_point();  // otherwise the sphere stays at the end of the previous path
      const double radius = std::max(distance(triangles, centre) * (1 - 1e-4), 1e-3 * size_);
      for (int step = 0; step < 8; ++step) {
        // The lengths of a proxy's motions: 0.001 radii when the surface stops it, 4 radii when it leaves the surface.
        const double length = radius * std::pow(10.0, -3 + 3.6 * unit());
        const spm::Vec3d target = centre + length * (random_point() - random_point()).normalized();
        const double first = time_of_impact(centre, target, radius, triangles);
        spm::SweepContact contact;
        ASSERT_EQ(tree.sweep(centre, target, radius, contact, version, &caches), first <= 1)
            << "round " << round << ", step " << step;
        if (first <= 1) {
          ASSERT_EQ(contact.time, first) << "round " << round << ", step " << step;
        }
        ++(first > 1 ? misses : first * length > 0.1 * radius ? late_hits : early_hits);
        centre += std::min(1.0, first) * (1 - 1e-6) * (target - centre);
        spm::NearestFace nearest;
        const double expected = distance(after, centre);
        if (tree.nearest(centre, 1.003 * radius, 0, nearest, nullptr, 0, &caches) > 0) {
          ASSERT_NEAR(std::sqrt(nearest.squared_distance), expected, 1e-7 * size_);
        } else {
          ASSERT_GT(expected, 1.002 * radius);
        }
      }
    }
    hrtc.forest().store_previous(false);
  }
  EXPECT_GT(early_hits, 100);
  EXPECT_GT(misses, 100);
  EXPECT_GT(late_hits, 20);
}

TEST_P(RunTime, QueriesInTwoThreadsGiveTheSameResultsAsInOneThread) {
  HrtcModel hrtc{model_, large_pool()};
  load_all(hrtc);
  ASSERT_EQ(hrtc.refine(regions_), Advance::kDone);
  const spm::AbTree& tree = hrtc.forest().tree();
  struct Query {
    spm::Vec3d from, to;
    double radius;
  };
  struct Answer {
    bool hit = false;
    spm::SweepContact contact;
    spm::NearestFace nearest;
  };
  // Five queries share a position, so that most queries use a filled candidate cache and every fifth one fills it.
  std::vector<Query> queries(3000);
  spm::Vec3d centre = random_point();
  for (std::size_t i = 0; i < queries.size(); ++i) {
    if (i % 5 == 0) centre = random_point();
    queries[i] = {centre, centre + 0.01 * size_ * (random_point() - random_point()).normalized(), 0.05 * size_};
  }
  std::atomic<int> started{0};
  const auto run_queries = [&](std::size_t first, int threads) {
    for (++started; started < threads;) std::this_thread::yield();
    spm::CandidateCaches caches;
    std::vector<Answer> answers(queries.size());
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const std::size_t number = (first + i) % queries.size();
      const Query& query = queries[number];
      Answer& answer = answers[number];
      answer.hit = tree.sweep(query.from, query.to, query.radius, answer.contact, spm::Version::kCurrent, &caches);
      (void)tree.nearest(query.from, size_, 0, answer.nearest, nullptr, 0, &caches);
    }
    return answers;
  };
  const std::vector<Answer> expected = run_queries(0, 1);
  std::array<std::vector<Answer>, 2> concurrent;
  std::thread thread{[&] { concurrent[1] = run_queries(queries.size() / 2, 3); }};
  concurrent[0] = run_queries(0, 3);
  thread.join();
  for (const std::vector<Answer>& answers : concurrent)
    for (std::size_t i = 0; i < queries.size(); ++i) {
      ASSERT_EQ(answers[i].hit, expected[i].hit) << "query " << i;
      ASSERT_EQ(answers[i].contact.face, expected[i].contact.face) << "query " << i;
      ASSERT_EQ(answers[i].nearest.face, expected[i].nearest.face) << "query " << i;
    }
}

TEST_P(RunTime, TwoForestsInOnePoolHaveSeparateMeshes) {
  const spm::PoolSettings settings = spm::PoolSettings::for_slots(4 * model_.summary.base_faces + 8192);
  spm::Pool pool{settings};
  spm::NodePool nodes{settings.tree_nodes};
  spm::Cache cache{pool};
  const spm::BaseMesh base = spm::base_mesh_of(model_);
  const auto make_forest = [&] {
    spm::Cache::Admitted admitted = cache.admit(base);
    EXPECT_TRUE(admitted.fits);
    return std::make_unique<spm::Forest>(pool, nodes, admitted.object, base.summary,
                                         spm::RegionGrid{model_.summary.grid, model_.regions},
                                         std::move(admitted.base));
  };
  const std::unique_ptr<spm::Forest> first = make_forest(), second = make_forest();
  const auto sweep_hits = [&](const spm::Forest& forest, spm::Version version) {
    spm::SweepContact contact;
    return forest.tree().sweep(low_, high_, size_ / 4, contact, version);
  };
  first->store_previous(true);  // no face is shown yet
  spm::Budget budget{1u << 20};
  ASSERT_EQ(first->advance(budget), Advance::kDone);
  first->refit();
  ASSERT_TRUE(sweep_hits(*first, spm::Version::kCurrent));
  ASSERT_FALSE(sweep_hits(*first, spm::Version::kPrevious));
  for (const bool store : {true, false}) {
    second->store_previous(store);
    EXPECT_FALSE(sweep_hits(*first, spm::Version::kPrevious)) << "the second forest changed the first one's version";
    EXPECT_FALSE(sweep_hits(*second, spm::Version::kCurrent));
  }
  first->store_previous(false);
  EXPECT_TRUE(sweep_hits(*first, spm::Version::kPrevious)) << "without a stored version, the current one counts";
}

TEST_P(RunTime, RefinementStopsWhenTheMemoryForThePreviousVersionIsFull) {
  const OwnedModel large = random_model(GetParam(), 16 * kRecords, kCells);
  HrtcModel hrtc{large.model(), spm::PoolSettings::for_slots(4 * 8192)};
  load_all(hrtc);
  ASSERT_EQ(hrtc.refine(all_regions(large.model())), Advance::kDone);
  int rounds = 0;
  spm::Advance result = Advance::kPreviousFull;
  for (; result == Advance::kPreviousFull && rounds < 1000; ++rounds) {
    hrtc.forest().store_previous(true);
    result = hrtc.refine({});
    ASSERT_THAT(hrtc.forest().violations(), IsEmpty()) << "round " << rounds;
  }
  EXPECT_EQ(result, Advance::kDone);
  EXPECT_GT(rounds, 1);
}

TEST_P(RunTime, CopyingTheLeavesInPartsCopiesAllShownFaces) {
  HrtcModel hrtc{model_, large_pool()};
  load_all(hrtc);
  std::vector<RegionId> wanted = regions_;
  wanted.resize(wanted.size() / 2);
  (void)hrtc.refine(wanted);
  const spm::AbTree& tree = hrtc.forest().tree();

  std::vector<std::array<float, 9>> copied;
  std::vector<spm::TreeNode> part(40);
  std::uint32_t from = 0;
  for (std::uint32_t capacity = 1, count = 1; count == capacity; from = part[count - 1].id + 1) {
    capacity = 1 + static_cast<std::uint32_t>(random_() % part.size());
    count = tree.copy_leaves(from, part.data(), capacity);
    for (std::uint32_t i = 0; i < count; ++i)
      for (std::uint32_t lane = 0; lane < spm::TreeNode::kWidth; ++lane) {
        if ((part[i].mask >> lane & 1u) == 0) continue;
        std::array<float, 9>& corners = copied.emplace_back();
        for (std::uint32_t row = 0; row < 9; ++row) corners[row] = part[i].lanes[row][lane];
      }
    if (count == 0) break;
  }

  std::vector<std::array<float, 9>> expected;
  for (const spm::LeafLane at : tree.shown()) expected.push_back(tree.corners(at));
  EXPECT_EQ(copied, expected);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RunTime, ::testing::Range<std::uint64_t>(1, 9));

TEST(FlatIndex, AgreesWithAMapUnderRandomInsertsAndErases) {
  std::mt19937_64 random{7};
  spm::FlatIndex table{100};
  std::map<std::uint64_t, std::uint32_t> expected;
  for (int step = 0; step < 20000; ++step) {
    const std::uint64_t key = random() % 150;
    const auto entry = expected.find(key);
    ASSERT_EQ(table.find(key), entry == expected.end() ? spm::kNone : entry->second);
    if (entry != expected.end()) {
      table.erase(key);
      expected.erase(entry);
    } else if (expected.size() < 100) {
      table.insert(key, static_cast<std::uint32_t>(step));
      expected[key] = static_cast<std::uint32_t>(step);
    }
  }
  EXPECT_EQ(table.size(), expected.size());
}

TEST(CompactIndex, AgreesWithAMapUnderRandomInsertsAndErases) {
  for (const std::uint32_t limit : {200u, 1u << 30}) {  // 24 bits of the hash in a bucket, or 1
    std::mt19937_64 random{7};
    spm::CompactIndex table{100, limit};
    std::map<std::uint32_t, std::uint64_t> key_of;  // by number
    std::map<std::uint64_t, std::uint32_t> expected;
    for (int step = 0; step < 20000; ++step) {
      const std::uint64_t key = random() % 150;
      const auto entry = expected.find(key);
      ASSERT_EQ(table.find(key, [&](std::uint32_t number) { return key_of.at(number); }),
                entry == expected.end() ? spm::kNone : entry->second);
      if (entry != expected.end()) {
        table.erase(key, entry->second, [&](std::uint32_t number) { return key_of.at(number); });
        key_of.erase(entry->second);
        expected.erase(entry);
      } else if (expected.size() < 100) {
        auto number = static_cast<std::uint32_t>(random() % limit);
        while (key_of.count(number) != 0) number = (number + 1) % limit;
        table.insert(key, number);
        key_of[number] = key;
        expected[key] = number;
      }
    }
    EXPECT_EQ(table.size(), expected.size());
  }
}

}  // namespace
}  // namespace tactus
