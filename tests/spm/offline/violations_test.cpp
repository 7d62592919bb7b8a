#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <random>

#include "spm/checksum.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/mesh_zoo.hpp"
#include "tests/support/reference_mesh.hpp"

namespace tactus::spm::offline {
namespace {

using test_support::ReferenceMesh;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

BuiltModel valid_model() {
  BuildOptions options;
  options.simplify.base_faces = 40;
  options.partition.cell_faces = 60;
  return build_model(generate(Shape::kOrgan, 1500), options);
}

struct Damage {
  const char* name;
  std::function<void(BuiltModel&)> apply;
  const char* message;  ///< a part of the violation that violations() returns
};

class EveryDamage : public ::testing::TestWithParam<Damage> {};

TEST_P(EveryDamage, IsReported) {
  BuiltModel model = valid_model();
  ASSERT_THAT(violations(model.model()), IsEmpty());
  GetParam().apply(model);
  EXPECT_THAT(violations(model.model()), Contains(HasSubstr(GetParam().message)));
}

std::uint32_t record_with_deformed(const BuiltModel& m) {
  std::uint32_t r = m.summary.records - 1;
  while (m.parts[r].deformed_count == 0) --r;
  return r;
}

std::uint32_t record_with_radius(const BuiltModel& m) {
  std::uint32_t r = m.summary.records - 1;
  while (m.parts[r].radius == 0) --r;
  return r;
}

const std::vector<Damage> kDamages{
    {"NoFaces", [](BuiltModel& m) { m.summary.faces = 0; }, "faces: found 0"},
    {"FaceThatNoRecordBears", [](BuiltModel& m) { m.parts[m.summary.records - 1].born_count = 1; },
     "neither in the base mesh nor born"},
    {"TooManyFaces", [](BuiltModel& m) { m.summary.faces = kMaxFaces; },
     "faces: found 1073741824, expected 1 to 1073741823"},
    {"MoreFacesThanThePartsBear", [](BuiltModel& m) { m.summary.faces = kMaxFaces - 1; }, "parts have room"},
    {"VerticesMissing", [](BuiltModel& m) { m.positions.pop_back(); }, "positions: found"},
    {"PartsMissing", [](BuiltModel& m) { m.parts.pop_back(); }, "parts: found"},
    {"PositionNotFinite", [](BuiltModel& m) { m.positions[5][1] = std::nanf(""); }, "vertex 5: position not finite"},
    {"PositionOutOfBounds", [](BuiltModel& m) { m.positions[5][1] = 1e9f; }, "vertex 5: outside"},
    {"CellSizeZero", [](BuiltModel& m) { m.summary.grid.cell_size = 0; }, "cell size"},
    {"CellSizeNotFinite", [](BuiltModel& m) { m.summary.grid.cell_size = std::numeric_limits<double>::infinity(); },
     "cell size"},
    {"CellSizeLargerThanTheModel", [](BuiltModel& m) { m.summary.grid.cell_size = 1e305; }, "cell size: found 1e+305"},
    {"BoundsBeforeTheGrid", [](BuiltModel& m) { m.summary.grid.origin[1] += 2 * m.summary.grid.cell_size; },
     "grid origin: found"},
    {"BoundsAfterTheGrid",
     [](BuiltModel& m) { m.summary.grid.origin[1] -= kMaxCellsPerSide * m.summary.grid.cell_size; },
     "grid origin: found"},
    {"RecordsAndRegionsThatAreTooManyTogether",
     [](BuiltModel& m) { m.summary.records = kMaxVertices - m.summary.regions; }, "regions: found"},
    {"OriginNotFinite", [](BuiltModel& m) { m.summary.grid.origin[2] = std::nan(""); }, "grid origin"},
    {"ScaleNegative", [](BuiltModel& m) { m.summary.metres_per_unit = -1; }, "metres per unit"},
    {"BaseCornerNotABaseVertex", [](BuiltModel& m) { m.base_faces[0].corners[1] = VertexId{m.summary.base_vertices}; },
     "base face 0: corner"},
    {"BaseFaceTwice", [](BuiltModel& m) { m.base_faces[1].face = m.base_faces[0].face; }, "is used twice"},
    {"BaseFaceIdTooHigh", [](BuiltModel& m) { m.base_faces[0].face = FaceId{m.summary.faces}; },
     "base face 0: face id"},
    {"BaseFinestWrong", [](BuiltModel& m) { m.base_faces[0].finest ^= 1u; }, "finest version"},
    {"ParentIsTheVertexItself", [](BuiltModel& m) { m.parts[7].parent = VertexId{m.summary.base_vertices + 7}; },
     "record 7: parent"},
    {"TooManyBorn", [](BuiltModel& m) { m.parts[7].born_count = 3; }, "record 7: 3 born"},
    {"TooManyDeformed", [](BuiltModel& m) { m.parts[7].deformed_count = 10; }, "10 deformed"},
    {"BornFaceTooHigh", [](BuiltModel& m) { m.parts[7].born[0] = BornRef::make(FaceId{m.summary.faces}, 0, true); },
     "record 7: bears face"},
    {"BornTwice", [](BuiltModel& m) { m.parts[7].born[1] = m.parts[7].born[0]; }, "which exists already"},
    {"ThirdCornerOfALaterRecord", [](BuiltModel& m) { m.parts[7].born_x[0] = VertexId{m.summary.vertices - 1}; },
     "record 7: third corner"},
    {"DeformedFaceTooHigh",
     [](BuiltModel& m) {
       m.parts[record_with_deformed(m)].set_deformed(0, DeformedRef::make(FaceId{m.summary.faces}, 0, true));
     },
     "deforms corner"},
    {"DeformedCornerThree", [](BuiltModel& m) { m.parts[record_with_deformed(m)].deformed_corners[0] |= 3u; },
     "deforms corner 3"},
    {"DeformedCornerWithAnotherVertex",
     [](BuiltModel& m) {
       RecordPart& part = m.parts[record_with_deformed(m)];
       const DeformedRef d = part.deformed(0);
       part.set_deformed(0, DeformedRef::make(d.face(), (d.corner() + 1) % 3, d.is_finest()));
     },
     "expected its parent"},
    {"FinestFaceNotMarked",
     [](BuiltModel& m) {
       for (BornRef& born : m.parts[m.summary.records - 1].born) born.bits &= ~1u;
     },
     "not marked as finest"},
    {"RadiusTooSmall", [](BuiltModel& m) { --m.parts[record_with_radius(m)].radius; }, ": radius code"},
    {"RadiusTooLarge", [](BuiltModel& m) { ++m.parts[record_with_radius(m)].radius; }, ": radius code"},
    {"RadiusOfAnUnsplitVertex", [](BuiltModel& m) { m.parts[m.summary.records - 1].radius = 1; }, ": radius code 1"},
    {"RadiusNotFinite", [](BuiltModel& m) { m.parts[9].radius = kRadiusCodes; }, "record 9: radius code 4080"},
    {"BaseRadiusTooSmall", [](BuiltModel& m) { m.base_radii[0] = 0; }, "vertex 0: radius code 0"},
    {"BaseRadiiMissing", [](BuiltModel& m) { m.base_radii.pop_back(); }, "base radii: found"},
    {"DeviationBelowTheLargestRadius", [](BuiltModel& m) { m.summary.deviation *= 0.9; }, "deviation: found"},
    {"MaxLevelWrong", [](BuiltModel& m) { ++m.summary.max_level; }, "max level"},
    {"PartWithoutAFace",
     [](BuiltModel& m) {
       RecordPart& part = m.parts[9];
       part.born_count = 0;
       part.deformed_count = 0;
     },
     "record 9: one of its parts changes no face"},
    {"ChainIntoARecord", [](BuiltModel& m) { m.parts[9].next = PartIndex{10}; }, "record 9: continues in part 10"},
    {"ChainBeyondTheEnd", [](BuiltModel& m) { m.parts[9].next = PartIndex{m.summary.parts}; }, "record 9: continues"},
    {"CellTwice", [](BuiltModel& m) { m.regions[1].cell = m.regions[0].cell; }, "region 1: its cell is not after"},
    {"CellWithinAnother",
     [](BuiltModel& m) {
       m.regions[1].depth = static_cast<std::uint16_t>(m.regions[0].depth + 1);
       for (std::size_t k = 0; k < 3; ++k) {
         m.regions[1].cell[k] = static_cast<std::uint16_t>(2 * m.regions[0].cell[k]);
       }
     },
     "region 1: its cell is not after"},
    {"CellBeforeThePrevious", [](BuiltModel& m) { std::swap(m.regions[1], m.regions[2]); }, "its cell is not after"},
    {"CellTooFar",
     [](BuiltModel& m) {
       m.regions.back().depth = 1;
       m.regions.back().cell[2] = 2 * kMaxCellsPerSide;
     },
     "cell 8192 along an axis at depth 0, expected below 8192"},
    {"CellTooDeep", [](BuiltModel& m) { m.regions[1].depth = 60; }, "depth 60"},
    {"IntervalsBeyondTheEnd", [](BuiltModel& m) { m.regions[1].interval_count += 10000000; }, "region 1: intervals"},
    {"IntervalsNotAscending",
     [](BuiltModel& m) {
       const auto region =
           std::find_if(m.regions.begin(), m.regions.end(), [](const Region& r) { return r.interval_count > 1; });
       m.intervals[region->first_interval + 1].first = m.intervals[region->first_interval].first;
     },
     "expected ascending intervals"},
    {"IntervalBeyondTheRecords", [](BuiltModel& m) { m.intervals[1].count = kNone; }, "expected ascending intervals"},
    {"IntervalEmpty", [](BuiltModel& m) { m.intervals[0].count = 0; }, "expected ascending intervals"},
    {"RecordCountWrong", [](BuiltModel& m) { --m.regions[0].record_count; }, "region 0:"},
    {"PartCountWrong", [](BuiltModel& m) { ++m.regions[0].part_count; }, "region 0:"},
    {"ListNotClosed",
     [](BuiltModel& m) {
       ++m.intervals[0].first;
       --m.intervals[0].count;
       if (m.intervals[0].count == 0) m.intervals[0] = {0, 0};
     },
     "region 0"},
    {"RegionWithoutFaces", [](BuiltModel& m) { m.regions[0].face_count = 0; }, "region 0: 0 faces"},
};

INSTANTIATE_TEST_SUITE_P(Damages, EveryDamage, ::testing::ValuesIn(kDamages),
                         [](const auto& test) { return test.param.name; });

/// Returns the model without `record` in the list of `region`. Requires that the list contains the record and that the
/// record has one part.
BuiltModel without_record(const BuiltModel& valid, std::uint32_t region, std::uint32_t record) {
  BuiltModel damaged = valid;
  Region& damaged_region = damaged.regions[region];
  const std::uint32_t first = valid.regions[region].first_interval, end = first + valid.regions[region].interval_count;
  damaged.intervals.clear();
  for (std::uint32_t i = 0; i < valid.intervals.size(); ++i) {
    const spm::Interval interval = valid.intervals[i];
    const std::uint32_t interval_end = interval.first + interval.count;
    if (i < first || i >= end || record < interval.first || record >= interval_end) {
      damaged.intervals.push_back(interval);
      continue;
    }
    --damaged_region.interval_count;
    for (const spm::Interval part : {spm::Interval{interval.first, record - interval.first},
                                     spm::Interval{record + 1, interval_end - record - 1}}) {
      if (part.count == 0) continue;
      damaged.intervals.push_back(part);
      ++damaged_region.interval_count;
    }
  }
  --damaged_region.record_count;
  --damaged_region.part_count;
  for (std::uint32_t i = 1; i < damaged.regions.size(); ++i)
    damaged.regions[i].first_interval = damaged.regions[i - 1].first_interval + damaged.regions[i - 1].interval_count;
  return damaged;
}

TEST(Violations, ReportsAListWithoutARecordExactlyWhenAnotherRecordOfTheListNeedsIt) {
  const BuiltModel valid = valid_model();
  std::uint32_t checked = 0;
  for (std::uint32_t i = 0; i < valid.summary.regions; ++i) {
    const Region& region = valid.regions[i];
    if (region.interval_count == 0) continue;  // a region without records has none to leave out
    ++checked;
    std::mt19937 random{i};
    const spm::Interval& chosen = valid.intervals[region.first_interval + random() % region.interval_count];
    const std::uint32_t left_out = chosen.first + static_cast<std::uint32_t>(random() % chosen.count);
    ReferenceMesh mesh{valid.model()};
    bool closed = true;
    const auto intervals = valid.model().intervals_of(RegionId{i});
    for (const spm::Interval& interval : intervals) {
      for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r)
        closed &= r == left_out || mesh.apply(r);
    }
    EXPECT_EQ(violations(without_record(valid, i, left_out).model()).empty(), closed)
        << "region " << i << " without record " << left_out;
  }
  EXPECT_GT(checked, 0u);
}

TEST(Violations, AModelWithRandomDamageIsReportedOrEachOfItsRegionsCanBeApplied) {
  const BuiltModel valid = valid_model();
  std::mt19937 random{3};
  std::uint32_t passed = 0;
  for (int round = 0; round < 3000; ++round) {
    BuiltModel model = valid;
    const auto damage = [&random](auto& array) {
      auto* bytes = reinterpret_cast<unsigned char*>(array.data());
      bytes[random() % (array.size() * sizeof(array[0]))] ^= static_cast<unsigned char>(1u << random() % 8);
    };
    switch (random() % 4) {
      case 0:
        damage(model.parts);
        break;
      case 1:
        damage(model.base_faces);
        break;
      case 2:
        damage(model.regions);
        break;
      default:
        damage(model.intervals);
    }
    if (!violations(model.model()).empty()) continue;
    ++passed;
    for (std::uint32_t i = 0; i < model.summary.regions; ++i) {
      ReferenceMesh mesh{model.model()};
      ASSERT_TRUE(mesh.apply_region(i)) << "round " << round << ", region " << i;
    }
  }
  EXPECT_LT(passed, 3000u);
}

TEST(Violations, AcceptsTheMaxNumberOfFaces) {
  BuiltModel model = valid_model();
  model.summary.faces = kMaxFaces - 1;
  EXPECT_THAT(violations(model.model()), Not(Contains(HasSubstr("expected 1 to"))))
      << "the parts are too few, but the number of faces is valid";
}

TEST(Violations, ReportsAWrongChecksum) {
  BuiltModel damaged = valid_model();
  ++damaged.regions[1].checksum;
  EXPECT_THAT(violations(damaged.model()), Contains(HasSubstr("region 1: checksum")));
}

TEST(Violations, ReportsTheViolationsOfABaseMesh) {
  const BaseMesh valid = base_mesh_of(valid_model().model());
  ASSERT_THAT(violations(valid), IsEmpty());
  BaseMesh damaged = valid;
  damaged.faces[3].corners[0] = VertexId{damaged.summary.base_vertices};
  EXPECT_THAT(violations(damaged), Contains(HasSubstr("base face 3: corner")));
  damaged = valid;
  damaged.positions.pop_back();
  EXPECT_THAT(violations(damaged), Contains(HasSubstr("base positions")));
}

TEST(Violations, ReportsTheViolationsOfAPage) {
  const BuiltModel model = valid_model();
  const Page valid = page_with_id(model.model().regions, page_of(model.regions[0]));
  ASSERT_THAT(violations(model.summary, valid), IsEmpty());
  Page damaged = valid;
  damaged.regions[0].record_count = model.summary.records + 1;
  EXPECT_THAT(violations(model.summary, damaged), Contains(HasSubstr("region 0")));
  damaged = valid;
  damaged.first = model.summary.regions;
  EXPECT_THAT(violations(model.summary, damaged), Contains(HasSubstr("found regions")));
  damaged = valid;
  damaged.id = PageId{index(valid.id) + 1};
  EXPECT_THAT(violations(model.summary, damaged), Contains(HasSubstr("contains a cell of page")));
  damaged.id = PageId{kPageIds};
  EXPECT_THAT(violations(model.summary, damaged), Contains(HasSubstr("found number")));
}

// The lists of 30,000 regions with all records are 30,000 intervals: their bytes are few, but their check is not.
TEST(Violations, LimitTheTotalLengthOfAllLists) {
  BuiltModel model = build_model(generate(Shape::kOrgan, 6000));
  ASSERT_THAT(violations(model.model()), IsEmpty());
  constexpr std::uint32_t kRegions = 30'000;
  constexpr std::uint64_t kFirstCode = std::uint64_t{1} << 36;  // after the Morton codes of all other cells
  Region region{};
  region.occupied = {1, 0};
  region.interval_count = 1;
  region.record_count = model.summary.records;
  region.part_count = model.summary.parts;
  region.face_count = 1;
  for (const std::uint32_t checksum : record_checksums(model.model())) region.checksum += checksum;
  for (std::uint32_t i = 0; i < kRegions; ++i) {
    region.cell = {};
    for (std::uint32_t bit = 0; bit < 39; ++bit)
      region.cell[bit % 3] |= static_cast<std::uint16_t>(((kFirstCode + i) >> bit & 1u) << bit / 3);
    region.first_interval = static_cast<std::uint32_t>(model.intervals.size());
    model.intervals.push_back({0, model.summary.records});
    model.regions.push_back(region);
    if (i < 10) {
      model.summary.regions = static_cast<std::uint32_t>(model.regions.size());
      ASSERT_THAT(violations(model.model()), IsEmpty());
    }
  }
  model.summary.regions = static_cast<std::uint32_t>(model.regions.size());

  EXPECT_THAT(violations(model.model()), Contains(HasSubstr("parts in all lists together")));
  EXPECT_THAT(violations(model.summary, model.regions), Contains(HasSubstr("parts in all lists together")));
}

/// A face whose corner moves with each record to a new vertex, so that each vertex has all earlier ones as ancestors.
OwnedModel chain_of(std::uint32_t records) {
  OwnedModel model;
  model.positions.assign(std::size_t{3} + records, {0, 1, 0});
  model.positions[0] = {0, 0, 0};
  model.positions[1] = {1, 0, 0};
  model.base_radii.assign(3, 0);
  model.base_faces = {{FaceId{0}, 0, {VertexId{0}, VertexId{1}, VertexId{2}}}};
  for (std::uint32_t r = 0; r < records; ++r) {
    RecordPart part{};
    part.parent = VertexId{2 + r};
    part.next = kNone;
    part.add_deformed(DeformedRef::make(FaceId{0}, 2, r + 1 == records));
    model.parts.push_back(part);
  }
  Region region{};
  region.occupied = {1, 0};
  region.interval_count = 1;
  region.record_count = region.part_count = records;
  region.face_count = 1;
  model.regions = {region};
  model.intervals = {{0, records}};
  ModelSummary& s = model.summary;
  s.base_vertices = 3;
  s.records = s.parts = s.max_level = records;
  s.vertices = 3 + records;
  s.faces = s.base_faces = s.regions = 1;
  s.bounds_max = {1, 1, 0};
  s.grid = {{0, 0, 0}, 1};
  s.metres_per_unit = 1;
  model.regions[0].checksum = region_checksums(model.model())[0];
  return model;
}

TEST(Violations, LimitTheMeanNumberOfAncestorsOfAVertex) {
  EXPECT_THAT(violations(chain_of(8'000).model()), IsEmpty());
  EXPECT_THAT(violations(chain_of(9'000).model()), Contains(HasSubstr("ancestors of all together")));
}

}  // namespace
}  // namespace tactus::spm::offline
