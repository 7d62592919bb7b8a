// Cache, forest and tree together, over random models, against plain recounts.

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

#include "tests/support/hrtc_model.hpp"
#include "tests/support/loaded_records.hpp"
#include "tests/support/random_model.hpp"

namespace tactus {
namespace {

using spm::AcceptResult;
using spm::Advance;
using spm::OwnedModel;
using spm::RegionId;
using test_support::HrtcModel;
using test_support::random_model;
using ::testing::IsEmpty;

constexpr std::uint32_t kRecords = 600;
constexpr std::uint32_t kCells = 3;
spm::PoolSettings roomy() { return spm::PoolSettings::for_slots(8192); }

std::vector<RegionId> all_regions(const spm::Model& model) {
  std::vector<RegionId> regions;
  for (std::uint32_t i = 0; i < model.summary.regions; ++i) regions.push_back(RegionId{i});
  return regions;
}

class RunTime : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  OwnedModel owned_ = random_model(GetParam(), kRecords, kCells);
  spm::Model model_ = owned_.model();

  [[nodiscard]] std::pair<spm::Vec3d, spm::Vec3d> bounds() const {
    const auto wide = [](const std::array<float, 3>& p) { return spm::Vec3d{p[0], p[1], p[2]}; };
    return {wide(model_.summary.bounds_min), wide(model_.summary.bounds_max)};
  }
};

TEST_P(RunTime, EveryRegionRefinedShowsTheFinestMesh) {
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);

  ASSERT_EQ(hrtc.refine(all_regions(model_)), Advance::kDone);

  const auto finest = spm::finest_faces(model_);
  std::uint32_t compared = 0;
  for (const spm::RowIndex number : hrtc.forest().tree().shown()) {
    const spm::FaceRow& row = hrtc.row(number);
    if (row.finest == 0) continue;
    ++compared;
    for (int corner = 0; corner < 3; ++corner)
      EXPECT_EQ(index(hrtc.vertex_id(row.vertices[corner])), finest[index(row.face)][corner]);
  }
  EXPECT_GT(compared, model_.summary.faces / 2);
  EXPECT_THAT(hrtc.forest().violations(), IsEmpty());
}

TEST_P(RunTime, ASphereThatIsNoNumberIsNeverExact) {
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  ASSERT_EQ(hrtc.refine(all_regions(model_)), Advance::kDone);
  const spm::Forest& forest = hrtc.forest();
  const spm::Vec3d middle = (bounds().first + bounds().second) / 2;
  const double radius = (bounds().second - bounds().first).norm() / 50;
  ASSERT_TRUE(forest.is_exact(middle, radius));
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  for (int axis = 0; axis < 3; ++axis) {
    spm::Vec3d centre = middle;
    centre[axis] = kNaN;
    EXPECT_FALSE(forest.is_exact(centre, radius)) << axis;
  }
  EXPECT_FALSE(forest.is_exact(middle, kNaN));
}

TEST_P(RunTime, EveryShownVertexHasTheRadiusOfItsRecord) {
  HrtcModel hrtc{model_, roomy()};
  const auto expect_radii = [&] {
    for (const spm::RowIndex number : hrtc.forest().tree().shown())
      for (const spm::Slot slot : hrtc.row(number).vertices) {
        const std::uint32_t v = index(hrtc.vertex_id(slot));
        const std::uint32_t base = model_.summary.base_vertices;
        const std::uint16_t code = v < base ? model_.base_radii[v] : model_.first_part(spm::RecordId{v - base}).radius;
        ASSERT_EQ(hrtc.radius(slot), spm::radius_of(code)) << "vertex " << v;
      }
  };
  expect_radii();
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  ASSERT_EQ(hrtc.refine(all_regions(model_)), Advance::kDone);
  expect_radii();
}

TEST_P(RunTime, EveryRecordArrivesToTheBitInWhateverOrderRegionsCome) {
  std::mt19937_64 random{GetParam()};
  std::vector<RegionId> order = all_regions(model_);
  std::shuffle(order.begin(), order.end(), random);
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : order) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  EXPECT_EQ(test_support::loaded_difference(model_, hrtc.pool()), "");
}

TEST_P(RunTime, APlaceOutsideTheBoundsIsMalformedAndLeavesNothing) {
  HrtcModel hrtc{model_, roomy()};
  const RegionId region = all_regions(model_).back();
  const std::uint32_t free_before = hrtc.cache().slots_free();
  int malformed = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (const std::uint32_t octaves16 : {1u << 27, -(1u << 27)}) {  // away from 0 or towards it
      spm::RegionData data = hrtc.message(region);
      data.residuals.back()[i] += octaves16;
      spm::RegionList list;
      const AcceptResult result = hrtc.cache().accept(hrtc.object(), data, list);
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
  EXPECT_GE(malformed, 3) << "in each coordinate one of the two is out of the bounds";
  EXPECT_EQ(hrtc.load(region), AcceptResult::kAccepted);
}

TEST(Radius, ACodeIsTheSmallestWhoseRadiusIsNotBelowTheDistance) {
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
    if (distance > 1.2e-38) {
      ASSERT_LE(spm::radius_of(code), distance * 1.0625);
    }
  }
  EXPECT_EQ(spm::radius_code(0), 0);
  EXPECT_EQ(spm::radius_code(1e39), spm::kRadiusCodes);
  for (std::uint16_t code = 0; code < spm::kRadiusCodes; ++code)
    ASSERT_EQ(spm::radius_code(spm::radius_of(code)), code);
}

TEST_P(RunTime, StaysSoundUnderAnySequenceOfLoadRefineCoarsenAndRelease) {
  std::mt19937_64 random{GetParam()};
  HrtcModel hrtc{model_, roomy()};
  const std::uint64_t base_hash = hrtc.forest().mesh_hash();
  std::vector<RegionId> wanted;
  const auto any_region = [&] { return RegionId{static_cast<std::uint32_t>(random() % model_.summary.regions)}; };
  for (int step = 0; step < 400; ++step) {
    SCOPED_TRACE("seed " + std::to_string(GetParam()) + " step " + std::to_string(step));
    const RegionId region = any_region();
    switch (random() % 4) {
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
        for (std::uint64_t i = random() % 6; i > 0; --i) wanted.push_back(any_region());
    }
    (void)hrtc.refine(wanted, static_cast<std::uint32_t>(random() % 3000), nullptr, 0,
                      random() % 2 == 0 ? spm::Unrequested::kCoarsen : spm::Unrequested::kRetain);
    hrtc.release_retired();
    ASSERT_THAT(hrtc.forest().violations(), IsEmpty());
    ASSERT_THAT(hrtc.cache().violations(), IsEmpty());
  }
  ASSERT_EQ(hrtc.refine({}), Advance::kDone);
  hrtc.release_retired();
  EXPECT_EQ(hrtc.forest().mesh_hash(), base_hash);
  EXPECT_EQ(hrtc.forest().tree().shown().size(), model_.summary.base_faces);
}

TEST_P(RunTime, TheMeshHashIsAFunctionOfTheRegionSetAlone) {
  std::mt19937_64 random{GetParam()};
  HrtcModel direct{model_, roomy()};
  HrtcModel wandering{model_, roomy()};
  for (const RegionId region : all_regions(model_)) {
    ASSERT_EQ(direct.load(region), AcceptResult::kAccepted);
    ASSERT_EQ(wandering.load(region), AcceptResult::kAccepted);
  }
  std::vector<RegionId> goal;
  for (const RegionId region : all_regions(model_))
    if (random() % 3 == 0) goal.push_back(region);
  for (int i = 0; i < 50; ++i) {
    std::vector<RegionId> detour = all_regions(model_);
    std::shuffle(detour.begin(), detour.end(), random);
    detour.resize(random() % detour.size());
    (void)wandering.refine(detour, static_cast<std::uint32_t>(random() % 2000));
  }

  ASSERT_EQ(direct.refine(goal), Advance::kDone);
  ASSERT_EQ(wandering.refine(goal), Advance::kDone);

  EXPECT_EQ(direct.forest().mesh_hash(), wandering.forest().mesh_hash());
}

TEST_P(RunTime, AFullPoolRefusesARegionAndLeavesAllAsItWas) {
  const std::uint32_t base = std::max(model_.summary.base_vertices, (model_.summary.base_faces + 1) / 2);
  HrtcModel hrtc{model_, spm::PoolSettings::for_slots(base + model_.summary.parts / 3)};
  std::uint32_t refused = 0;
  for (const RegionId region : all_regions(model_)) {
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

TEST(CacheCounts, ARecordThatMoreRegionsListThanCanBeCountedIsRefusedUntilOneIsReleased) {
  const OwnedModel owned = random_model(1, kRecords, kCells);
  const spm::Model model = owned.model();
  const auto shorter = [](const spm::Region& a, const spm::Region& b) {
    return (a.record_count == 0 ? ~0u : a.record_count) < (b.record_count == 0 ? ~0u : b.record_count);
  };
  const auto min = std::min_element(model.regions.begin(), model.regions.end(), shorter);
  const RegionId region{static_cast<std::uint32_t>(min - model.regions.begin())};
  spm::RegionData data = HrtcModel{model, roomy()}.message(region);
  spm::BaseMesh base = spm::base_mesh_of(model);
  constexpr std::uint32_t kMax = 32767;
  base.regions.assign(kMax + 1, *min);  // all with the same list
  spm::PoolSettings settings = roomy();
  settings.list_blocks = (kMax + 1) * spm::ListBlock::blocks_for(min->record_count);
  spm::Pool pool{settings};
  spm::Cache cache{pool};
  const spm::Cache::Admitted admitted = cache.admit(base);
  spm::RegionList list;
  const auto accept = [&](std::uint32_t number) {
    data.region = RegionId{number};
    return cache.accept(admitted.object, data, list);
  };
  for (std::uint32_t i = 0; i < kMax; ++i) ASSERT_EQ(accept(i), AcceptResult::kAccepted) << i;
  const std::uint32_t blocks_free = cache.blocks_free();

  EXPECT_EQ(accept(kMax), AcceptResult::kPoolFull);
  EXPECT_EQ(cache.blocks_free(), blocks_free);
  EXPECT_THAT(cache.violations(), IsEmpty());

  cache.release(admitted.object, RegionId{0});
  EXPECT_EQ(accept(kMax), AcceptResult::kAccepted);
}

TEST_P(RunTime, AMessageWithoutARecordItNeedsIsIncompleteAndLeavesNothing) {
  HrtcModel hrtc{model_, roomy()};
  spm::RegionData data;
  for (const RegionId region : all_regions(model_)) {
    data = hrtc.message(region);
    if (data.residuals.size() > 4) break;
  }
  // The first record sent is taken out, with its parts.
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
  EXPECT_EQ(hrtc.cache().accept(hrtc.object(), data, list), AcceptResult::kIncomplete);

  EXPECT_EQ(hrtc.cache().slots_free(), free_before);
  EXPECT_THAT(hrtc.cache().violations(), IsEmpty());
}

TEST_P(RunTime, AListWithAnotherRecordInPlaceOfOneThatItNeedsIsRefusedAndLeavesNothing) {
  std::mt19937_64 random{GetParam()};
  HrtcModel hrtc{model_, roomy()};
  const std::uint32_t free_before = hrtc.cache().slots_free();
  std::uint32_t malformed = 0;
  for (int round = 0; round < 200; ++round) {
    const RegionId region{static_cast<std::uint32_t>(random() % model_.summary.regions)};
    std::set<std::uint32_t> list;
    for (const spm::Interval& run : model_.intervals_of(region))
      for (std::uint32_t r = run.first; r < run.first + run.count; ++r) list.insert(r);
    const auto other = static_cast<std::uint32_t>(random() % model_.summary.records);
    if (list.empty() || list.count(other) > 0) continue;
    list.erase(std::next(list.begin(), static_cast<std::ptrdiff_t>(random() % list.size())));
    list.insert(other);
    std::vector<spm::Interval> intervals;
    for (const std::uint32_t r : list) {
      if (!intervals.empty() && intervals.back().first + intervals.back().count == r)
        ++intervals.back().count;
      else
        intervals.push_back({r, 1});
    }
    spm::RegionData data = hrtc.false_message(region, intervals);
    spm::RegionList out;
    const AcceptResult result = hrtc.cache().accept(hrtc.object(), data, out);
    ASSERT_NE(result, AcceptResult::kAccepted) << "round " << round;
    if (result == AcceptResult::kMalformed) ++malformed;
    ASSERT_EQ(hrtc.cache().slots_free(), free_before);
  }
  EXPECT_GT(malformed, 0u);
  EXPECT_THAT(hrtc.cache().violations(), IsEmpty());
}

TEST_P(RunTime, TooFewTreeNodesLeaveRegionsCoarseAndTheMeshSound) {
  spm::PoolSettings settings = roomy();
  settings.tree_nodes = model_.summary.base_faces * 5 + 40;
  HrtcModel hrtc{model_, settings};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);

  EXPECT_EQ(hrtc.refine(all_regions(model_)), Advance::kNodesFull);

  EXPECT_THAT(hrtc.forest().violations(), IsEmpty());
  EXPECT_EQ(hrtc.refine({}), Advance::kDone);
  EXPECT_EQ(hrtc.forest().mesh_hash(), 0u);
}

TEST_P(RunTime, QueriesFindWhatAllPairsFind) {
  std::mt19937_64 random{GetParam()};
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  const spm::Vec3d low = bounds().first, high = bounds().second;
  std::uniform_real_distribution<double> unit{0, 1};
  const auto point = [&]() -> spm::Vec3d {
    return low + (high - low).cwiseProduct(spm::Vec3d{unit(random), unit(random), unit(random)});
  };
  std::vector<spm::Contact> contacts(4096);
  spm::CandidateCaches caches;
  std::uint64_t touched = 0, swept = 0, shared = 0;
  for (int round = 0; round < 60; ++round) {
    std::vector<RegionId> wanted = all_regions(model_);
    std::shuffle(wanted.begin(), wanted.end(), random);
    wanted.resize(random() % wanted.size());
    (void)hrtc.refine(wanted, static_cast<std::uint32_t>(random() % 20000));
    const spm::AbTree& tree = hrtc.forest().tree();
    const double radius = unit(random) * 0.2 * (high - low).norm();
    const spm::Vec3d centre = point(), goal = point();

    std::vector<std::uint32_t> expected;
    double nearest = 1e300, first = 2;
    for (const spm::RowIndex number : tree.shown()) {
      const spm::FaceRow& row = hrtc.row(number);
      const std::array<float, 9> corners = tree.corners(number);
      const auto corner = [&](int i) { return spm::Vec3d{corners[3 * i], corners[3 * i + 1], corners[3 * i + 2]}; };
      const double squared = spm::closest_point(centre, corner(0), corner(1), corner(2)).squared_distance;
      nearest = std::min(nearest, squared);
      if (squared <= radius * radius) expected.push_back(index(row.face));
    }
    // In every other round the ball rests on the mesh, as a proxy does.
    const double sphere = round % 2 == 0 ? radius / 4 : std::sqrt(nearest) * (1 - 1e-6);
    for (const spm::RowIndex number : tree.shown()) {
      const std::array<float, 9> c = tree.corners(number);
      spm::SweepHit hit;
      if (spm::swept_sphere(centre, goal, sphere, {c[0], c[1], c[2]}, {c[3], c[4], c[5]}, {c[6], c[7], c[8]}, hit))
        first = std::min(first, hit.time);
    }

    const std::uint32_t found = tree.find_contacts(centre, radius, contacts.data(), 4096);
    std::vector<std::uint32_t> faces;
    for (std::uint32_t i = 0; i < found; ++i) faces.push_back(spm::index(contacts[i].face));
    ASSERT_EQ(faces, expected) << "in tree order, which is by id";
    touched += found;
    spm::NearestFace near;
    ASSERT_TRUE(tree.nearest(centre, 1e9, near));
    ASSERT_NEAR(near.squared_distance, nearest, 1e-14 * (high - low).squaredNorm()) << "by eight, up to rounding";
    const double more = unit(random) * 0.02 * (high - low).norm();
    const double limit = std::sqrt(nearest) + more;
    std::vector<spm::RowIndex> about;
    for (const spm::RowIndex number : tree.shown()) {
      const std::array<float, 9> c = tree.corners(number);
      const double squared =
          spm::closest_point(centre, {c[0], c[1], c[2]}, {c[3], c[4], c[5]}, {c[6], c[7], c[8]}).squared_distance;
      if (squared <= limit * limit) about.push_back(number);
    }
    std::vector<spm::RowIndex> rows(spm::AbTree::kMaxNearest);
    rows.resize(tree.nearest(centre, 1e9, more, near, rows.data(), spm::AbTree::kMaxNearest));
    if (about.size() <= rows.size()) {
      ASSERT_EQ(rows, about) << "in tree order";
      shared += rows.size() > 1 ? 1 : 0;
    }
    spm::SweepContact contact;
    const bool hit = tree.sweep(centre, goal, sphere, contact, spm::Version::kCurrent, &caches);
    ASSERT_EQ(hit, first <= 1);
    if (hit) {
      ASSERT_EQ(contact.time, first);
      ++swept;
    }
  }
  EXPECT_GT(touched, 100u);
  EXPECT_GT(swept, 5u);
  EXPECT_GT(shared, 5u);
}

TEST_P(RunTime, ASphereInWhichAnythingChangedOrAroundWhichAllDidIsReported) {
  std::mt19937_64 random{GetParam()};
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  const spm::Vec3d low = bounds().first, high = bounds().second;
  std::uniform_real_distribution<double> unit{0, 1};
  const auto faces = [&] {
    std::map<std::uint32_t, std::array<float, 9>> shown;
    for (const spm::RowIndex number : hrtc.forest().tree().shown())
      shown[index(hrtc.row(number).face)] = hrtc.forest().tree().corners(number);
    return shown;
  };
  const auto differing = [](const auto& these, const auto& those) {
    std::vector<std::array<float, 9>> found;
    for (const auto& [face, corners] : these)
      if (const auto other = those.find(face); other == those.end() || other->second != corners)
        found.push_back(corners);
    return found;
  };
  int changed_near = 0, changed_around = 0, unchanged = 0;
  for (int round = 0; round < 200; ++round) {
    std::vector<RegionId> wanted = all_regions(model_);
    std::shuffle(wanted.begin(), wanted.end(), random);
    wanted.resize(random() % 4);
    std::array<spm::ChangeDetector, 8> watches;
    for (spm::ChangeDetector& watch : watches) {
      watch.centre = low + (high - low).cwiseProduct(spm::Vec3d{unit(random), unit(random), unit(random)});
      watch.radius = unit(random) * 0.05 * (high - low).norm();
    }
    const auto before = faces();
    (void)hrtc.refine(wanted, static_cast<std::uint32_t>(random() % 300), watches.data(), watches.size());
    const auto after = faces();

    std::vector<std::array<float, 9>> changed = differing(before, after);
    for (const auto& corners : differing(after, before)) changed.push_back(corners);
    Eigen::AlignedBox3d all;
    for (const auto& c : changed)
      for (int i = 0; i < 9; i += 3) all.extend(spm::Vec3d{c[i], c[i + 1], c[i + 2]});
    for (const spm::ChangeDetector& watch : watches) {
      bool near = false;
      for (const auto& c : changed)
        near = near || spm::closest_point(watch.centre, {c[0], c[1], c[2]}, {c[3], c[4], c[5]}, {c[6], c[7], c[8]})
                               .squared_distance <= watch.radius * watch.radius;
      const spm::Vec3d reach = spm::Vec3d::Constant(watch.radius);
      const bool around = all.contains(watch.centre - reach) && all.contains(watch.centre + reach);
      if (near || around) {
        ASSERT_TRUE(watch.is_changed) << "round " << round;
      }
      changed_near += near ? 1 : 0;
      changed_around += around && !near ? 1 : 0;
      unchanged += watch.is_changed ? 0 : 1;
    }
  }
  EXPECT_GT(changed_near, 20);
  EXPECT_GT(changed_around, 20);
  EXPECT_GT(unchanged, 200) << "a sphere is affected by changes near it only";
}

TEST_P(RunTime, ASweepOnThePreviousMeshMeetsTheMeshAsItWas) {
  std::mt19937_64 random{GetParam()};
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  const spm::Vec3d low = bounds().first, high = bounds().second;
  std::uniform_real_distribution<double> unit{0, 1};
  const auto point = [&] {
    return spm::Vec3d{low + (high - low).cwiseProduct(spm::Vec3d{unit(random), unit(random), unit(random)})};
  };
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
    std::vector<Sweep> segments(20);
    for (Sweep& sweep : segments) {
      sweep.from = point();
      sweep.to = point();
      sweep.radius = unit(random) * 0.05 * (high - low).norm();
      sweep.hit = tree.sweep(sweep.from, sweep.to, sweep.radius, sweep.contact, spm::Version::kCurrent, &caches);
    }
    std::vector<RegionId> wanted = all_regions(model_);
    std::shuffle(wanted.begin(), wanted.end(), random);
    wanted.resize(random() % 4);
    hrtc.forest().store_previous(true);
    for (int part = 0; part < 2; ++part) {  // several refits may follow
      const spm::Advance result = hrtc.refine(wanted, static_cast<std::uint32_t>(random() % 2000));
      ASSERT_NE(result, spm::Advance::kPreviousFull);
    }
    for (const Sweep& sweep : segments) {
      spm::SweepContact contact, now;
      ASSERT_EQ(tree.sweep(sweep.from, sweep.to, sweep.radius, contact, spm::Version::kPrevious, &caches), sweep.hit);
      const bool hits_now = tree.sweep(sweep.from, sweep.to, sweep.radius, now, spm::Version::kCurrent, &caches);
      if (!sweep.hit) continue;
      ASSERT_EQ(contact.face, sweep.contact.face) << "round " << round;
      ASSERT_EQ(contact.time, sweep.contact.time);
      ASSERT_EQ(contact.point, sweep.contact.point);
      differed += hits_now && now.time == contact.time ? 0 : 1;
    }
    hrtc.forest().store_previous(false);
  }
  EXPECT_GT(differed, 20) << "else nothing was kept that mattered";
}

TEST_P(RunTime, SpheresThatMoveMeetWhatBruteForceSaysOnEitherMesh) {
  std::mt19937_64 random{GetParam()};
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  ASSERT_EQ(hrtc.refine({}), spm::Advance::kDone);
  const spm::Vec3d low = bounds().first, high = bounds().second;
  std::uniform_real_distribution<double> unit{0, 1};
  const auto point = [&] {
    return spm::Vec3d{low + (high - low).cwiseProduct(spm::Vec3d{unit(random), unit(random), unit(random)})};
  };
  const spm::AbTree& tree = hrtc.forest().tree();
  spm::CandidateCaches caches;
  using Triangles = std::vector<std::array<spm::Vec3d, 3>>;
  const auto triangles = [&] {
    Triangles all;
    for (const spm::RowIndex number : tree.shown()) {
      const std::array<float, 9> c = tree.corners(number);
      all.push_back({spm::Vec3d{c[0], c[1], c[2]}, spm::Vec3d{c[3], c[4], c[5]}, spm::Vec3d{c[6], c[7], c[8]}});
    }
    return all;
  };
  const auto distance = [](const Triangles& all, const spm::Vec3d& p) {
    double squared = 1e300;
    for (const auto& [a, b, c] : all) squared = std::min(squared, spm::closest_point(p, a, b, c).squared_distance);
    return std::sqrt(squared);
  };
  spm::Vec3d at = point();
  int met = 0, passed = 0, met_far = 0;
  for (int round = 0; round < 60; ++round) {
    const Triangles before = triangles();
    std::vector<RegionId> wanted = all_regions(model_);
    std::shuffle(wanted.begin(), wanted.end(), random);
    wanted.resize(random() % 6);
    hrtc.forest().store_previous(true);
    ASSERT_NE(hrtc.refine(wanted, static_cast<std::uint32_t>(random() % 4000)), spm::Advance::kPreviousFull);
    const Triangles after = triangles();
    for (const spm::Version version : {spm::Version::kCurrent, spm::Version::kPrevious, spm::Version::kCurrent}) {
      const Triangles& all = version == spm::Version::kCurrent ? after : before;
      if (random() % 2 == 0) at = point();  // else where the last one ended, whatever has changed around it
      const double radius = std::max(distance(all, at) * (1 - 1e-4), 1e-3 * (high - low).norm());
      for (int step = 0; step < 8; ++step) {
        // From a thousandth of the radius to four times it, as it is when a proxy is stopped, slides, or comes free.
        const double length = radius * std::pow(10.0, -3 + 3.6 * unit(random));
        const spm::Vec3d to = at + length * (point() - point()).normalized();
        double first = 2;
        for (const auto& [a, b, c] : all) {
          spm::SweepHit hit;
          if (spm::swept_sphere(at, to, radius, a, b, c, hit)) first = std::min(first, hit.time);
        }
        spm::SweepContact contact;
        ASSERT_EQ(tree.sweep(at, to, radius, contact, version, &caches), first <= 1)
            << "round " << round << ", step " << step;
        if (first <= 1) {
          ASSERT_EQ(contact.time, first) << "round " << round << ", step " << step;
        }
        ++(first > 1 ? passed : first * length > 0.1 * radius ? met_far : met);
        at += std::min(1.0, first) * (1 - 1e-6) * (to - at);
        spm::NearestFace near;
        const double nearest = distance(after, at);
        if (tree.nearest(at, 1.003 * radius, 0, near, nullptr, 0, &caches) > 0) {
          ASSERT_NEAR(std::sqrt(near.squared_distance), nearest, 1e-7 * (high - low).norm());
        } else {
          ASSERT_GT(nearest, 1.002 * radius);
        }
      }
    }
    hrtc.forest().store_previous(false);
  }
  EXPECT_GT(met, 100);
  EXPECT_GT(passed, 100);
  EXPECT_GT(met_far, 20);
}

TEST_P(RunTime, QueriesOfOneTreeInTwoThreadsFindWhatTheyFindAlone) {
  std::mt19937_64 random{GetParam()};
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  ASSERT_EQ(hrtc.refine(all_regions(model_)), spm::Advance::kDone);
  const spm::Vec3d low = bounds().first, high = bounds().second;
  std::uniform_real_distribution<double> unit{0, 1};
  const auto point = [&] {
    return spm::Vec3d{low + (high - low).cwiseProduct(spm::Vec3d{unit(random), unit(random), unit(random)})};
  };
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
  // A ball that slides, now and then elsewhere: most queries find what is around them in a cache, some fill one.
  std::vector<Query> queries(3000);
  spm::Vec3d at = point();
  const double size = (high - low).norm();
  for (std::size_t i = 0; i < queries.size(); ++i) {
    if (i % 5 == 0) at = point();
    queries[i] = {at, at + 0.01 * size * (point() - point()).normalized(), 0.05 * size};
  }
  std::atomic<int> started{0};
  const auto ask = [&](std::size_t first, int threads) {
    for (++started; started < threads;) std::this_thread::yield();
    spm::CandidateCaches caches;
    std::vector<Answer> answers(queries.size());
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const std::size_t number = (first + i) % queries.size();
      const Query& query = queries[number];
      Answer& answer = answers[number];
      answer.hit = tree.sweep(query.from, query.to, query.radius, answer.contact, spm::Version::kCurrent, &caches);
      (void)tree.nearest(query.from, size, 0, answer.nearest, nullptr, 0, &caches);
    }
    return answers;
  };
  const std::vector<Answer> alone = ask(0, 1);
  std::vector<Answer> other;
  std::thread thread{[&] { other = ask(queries.size() / 2, 3); }};
  const std::vector<Answer> one = ask(0, 3);
  thread.join();
  for (const std::vector<Answer>* answers : {&one, static_cast<const std::vector<Answer>*>(&other)})
    for (std::size_t i = 0; i < queries.size(); ++i) {
      ASSERT_EQ((*answers)[i].hit, alone[i].hit) << "query " << i;
      ASSERT_EQ((*answers)[i].contact.face, alone[i].contact.face) << "query " << i;
      ASSERT_EQ((*answers)[i].nearest.face, alone[i].nearest.face) << "query " << i;
    }
}

TEST_P(RunTime, TwoForestsOfOnePoolKeepTheirMeshesApart) {
  const spm::PoolSettings settings = spm::PoolSettings::for_slots(4 * model_.summary.base_faces + 8192);
  spm::Pool pool{settings};
  spm::NodePool nodes{settings.tree_nodes};
  spm::Cache cache{pool};
  const spm::BaseMesh base = spm::base_mesh_of(model_);
  const auto forest = [&] {
    spm::Cache::Admitted admitted = cache.admit(base);
    EXPECT_TRUE(admitted.fits);
    return std::make_unique<spm::Forest>(pool, nodes, admitted.object, base.summary,
                                         spm::RegionGrid{base.summary.grid, std::span<const spm::Region>{base.regions}},
                                         std::move(admitted.base));
  };
  const std::unique_ptr<spm::Forest> one = forest(), other = forest();
  const spm::Vec3d low = bounds().first, high = bounds().second;
  const auto meets = [&](const spm::Forest& of, spm::Version version) {
    spm::SweepContact contact;
    return of.tree().sweep(low, high, (high - low).norm() / 4, contact, version);
  };
  one->store_previous(true);  // from when it shows nothing
  spm::Budget budget{1u << 20};
  ASSERT_EQ(one->advance(budget), Advance::kDone);
  one->refit();
  ASSERT_TRUE(meets(*one, spm::Version::kCurrent));
  ASSERT_FALSE(meets(*one, spm::Version::kPrevious));
  for (const bool keeping : {true, false}) {
    other->store_previous(keeping);
    EXPECT_FALSE(meets(*one, spm::Version::kPrevious)) << "what the other forest keeps changes nothing";
    EXPECT_FALSE(meets(*other, spm::Version::kCurrent));
  }
  one->store_previous(false);
  EXPECT_TRUE(meets(*one, spm::Version::kPrevious)) << "nothing is kept: there is the mesh of now";
}

TEST_P(RunTime, RefinementStopsWhenWhatItChangesCanNoLongerBeKept) {
  const OwnedModel large = random_model(GetParam(), 16 * kRecords, kCells);
  HrtcModel hrtc{large.model(), spm::PoolSettings::for_slots(4 * 8192)};
  const std::vector<RegionId> all = all_regions(large.model());
  for (const RegionId region : all) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  ASSERT_EQ(hrtc.refine(all), spm::Advance::kDone);
  int rounds = 0;
  spm::Advance result = spm::Advance::kPreviousFull;
  for (; result == spm::Advance::kPreviousFull && rounds < 1000; ++rounds) {
    hrtc.forest().store_previous(true);
    result = hrtc.refine({});
    ASSERT_THAT(hrtc.forest().violations(), IsEmpty()) << "round " << rounds;
  }
  EXPECT_EQ(result, spm::Advance::kDone);
  EXPECT_GT(rounds, 1);
}

TEST_P(RunTime, LeavesCopiedInPartsAreAllThatIsShown) {
  std::mt19937_64 random{GetParam()};
  HrtcModel hrtc{model_, roomy()};
  for (const RegionId region : all_regions(model_)) ASSERT_EQ(hrtc.load(region), AcceptResult::kAccepted);
  std::vector<RegionId> wanted = all_regions(model_);
  wanted.resize(wanted.size() / 2);
  (void)hrtc.refine(wanted);
  const spm::AbTree& tree = hrtc.forest().tree();

  std::vector<std::array<float, 9>> copied;
  std::vector<spm::TreeNode> part(40);
  std::uint32_t from = 0;
  for (std::uint32_t room = 1, count = 1; count == room; from = part[count - 1].id + 1) {
    room = 1 + static_cast<std::uint32_t>(random() % part.size());
    count = tree.copy_leaves(from, part.data(), room);
    for (std::uint32_t i = 0; i < count; ++i)
      for (std::uint32_t lane = 0; lane < spm::TreeNode::kWidth; ++lane) {
        if ((part[i].mask >> lane & 1u) == 0) continue;
        std::array<float, 9>& corners = copied.emplace_back();
        for (std::uint32_t row = 0; row < 9; ++row) corners[row] = part[i].lanes[row][lane];
      }
    if (count == 0) break;
  }

  std::vector<std::array<float, 9>> expected;
  for (const spm::RowIndex number : tree.shown()) expected.push_back(tree.corners(number));
  EXPECT_EQ(copied, expected);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RunTime, ::testing::Range<std::uint64_t>(1, 9));

TEST(FlatIndex, AgreesWithAMapUnderRandomInsertsAndErases) {
  std::mt19937_64 random{7};
  spm::FlatIndex table{100};
  std::map<std::uint64_t, std::uint32_t> expected;
  for (int step = 0; step < 20000; ++step) {
    const std::uint64_t key = random() % 150;
    const auto at = expected.find(key);
    ASSERT_EQ(table.find(key), at == expected.end() ? spm::kNone : at->second);
    if (at != expected.end()) {
      table.erase(key);
      expected.erase(at);
    } else if (expected.size() < 100) {
      table.insert(key, static_cast<std::uint32_t>(step));
      expected[key] = static_cast<std::uint32_t>(step);
    }
  }
  EXPECT_EQ(table.size(), expected.size());
}

}  // namespace
}  // namespace tactus
