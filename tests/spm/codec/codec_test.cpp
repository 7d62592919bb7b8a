#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "spm/codec/base_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "tests/support/random_model.hpp"

namespace tactus::spm::codec {
namespace {

using test_support::OwnedModel;
using test_support::random_model;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::uint64_t kSeed = 20260101;

std::vector<spm::Run> whole_list(const Model& model, RegionId region) {
  const Span<const spm::Run> runs = model.runs_of(region);
  return {runs.begin(), runs.end()};
}

/// A random subset of a list, as runs that do not touch.
std::vector<spm::Run> random_subset(Span<const spm::Run> list, std::mt19937_64& random) {
  std::vector<spm::Run> subset;
  for (const spm::Run& run : list) {
    for (std::uint32_t r = run.first; r != run.first + run.count; ++r) {
      if (random() % 3 == 0) continue;
      if (!subset.empty() && subset.back().first + subset.back().count == r) {
        ++subset.back().count;
      } else {
        subset.push_back({r, 1});
      }
    }
  }
  return subset;
}

bool same_runs(Span<const spm::Run> a, Span<const spm::Run> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const spm::Run& x, const spm::Run& y) { return x.first == y.first && x.count == y.count; });
}

/// Where `data` differs from the model's own arrays; empty when it is the same to the bit.
std::string difference(const Model& model, const RegionData& data) {
  std::size_t record_at = 0;
  std::size_t part_at = 0;
  for (const spm::Run& run : data.sent) {
    for (std::uint32_t r = run.first; r != run.first + run.count; ++r, ++record_at) {
      const auto& position = model.positions[model.summary.base_vertices + r];
      if (std::memcmp(&position, &data.positions[record_at], sizeof position) != 0)
        return "position of " + std::to_string(r);
      for (std::uint32_t at = r; at != kNone; at = model.parts[at].next, ++part_at) {
        if (part_at >= data.parts.size()) return "parts end early";
        const RecordPart& a = model.parts[at];
        const RecordPart& b = data.parts[part_at];
        const std::uint32_t next = a.next == kNone ? kNone : static_cast<std::uint32_t>(part_at + 1);
        const bool same = a.parent == b.parent && a.radius == b.radius && b.next == next &&
                          a.born_count == b.born_count && a.deformed_count == b.deformed_count &&
                          std::memcmp(a.born, b.born, a.born_count * sizeof a.born[0]) == 0 &&
                          std::memcmp(a.born_x, b.born_x, a.born_count * sizeof a.born_x[0]) == 0 &&
                          std::memcmp(a.deformed, b.deformed, a.deformed_count * sizeof a.deformed[0]) == 0;
        if (!same) return "part of record " + std::to_string(r);
      }
    }
  }
  return part_at == data.parts.size() && record_at == data.positions.size() ? "" : "too much";
}

/// What decode_region promises of all it returns.
void expect_sane(const RegionData& data, const ModelSummary& s) {
  ASSERT_LT(index(data.region), s.regions);
  for (const std::vector<spm::Run>* runs : {&data.list, &data.sent}) {
    for (std::size_t i = 0; i < runs->size(); ++i) {
      const spm::Run run = (*runs)[i];
      ASSERT_GT(run.count, 0u);
      ASSERT_LE(std::uint64_t{run.first} + run.count, s.records);
      if (i > 0) {
        ASSERT_GT(run.first, (*runs)[i - 1].first + (*runs)[i - 1].count);
      }
    }
  }
  std::size_t part_at = 0;
  std::size_t record_at = 0;
  for (const spm::Run& run : data.sent) {
    for (std::uint32_t r = run.first; r != run.first + run.count; ++r, ++record_at) {
      const std::uint32_t u = s.base_vertices + r;
      for (const float c : data.positions.at(record_at)) ASSERT_TRUE(std::isfinite(c));
      for (bool more = true; more; ++part_at) {
        const RecordPart& part = data.parts.at(part_at);
        more = part.next != kNone;
        if (more) {
          ASSERT_EQ(part.next, part_at + 1);
        }
        ASSERT_LT(part.parent, u);
        ASSERT_LT(part.radius, kRadiusCodes);
        ASSERT_LE(radius_of(part.radius), s.deviation);
        ASSERT_LE(part.born_count, kBornPerPart);
        ASSERT_LE(part.deformed_count, kDeformedPerPart);
        for (int i = 0; i < part.born_count; ++i) {
          ASSERT_LT(part.born[i].face(), s.faces);
          ASSERT_LT(part.born[i].order(), 6u);
          ASSERT_LT(part.born_x[i], u);
        }
        for (int i = 0; i < part.deformed_count; ++i) {
          ASSERT_LT(part.deformed[i].face(), s.faces);
          ASSERT_LT(part.deformed[i].corner(), 3u);
        }
      }
    }
  }
  ASSERT_EQ(part_at, data.parts.size());
  ASSERT_EQ(record_at, data.positions.size());
}

Bytes mutated(Bytes bytes, std::mt19937_64& random) {
  const std::uint64_t kind = random() % 8;
  if (kind == 0 && !bytes.empty()) bytes.resize(random() % bytes.size());
  if (kind == 1) bytes.push_back(static_cast<std::uint8_t>(random()));
  const std::uint64_t changes = kind < 2 ? random() % 2 : 1 + random() % 4;
  for (std::uint64_t i = 0; i < changes && !bytes.empty(); ++i) {
    std::uint8_t& byte = bytes[random() % bytes.size()];
    byte =
        random() % 2 == 0 ? static_cast<std::uint8_t>(random()) : byte ^ static_cast<std::uint8_t>(1u << random() % 8);
  }
  return bytes;
}

TEST(RandomModel, HasNoViolations) {
  const OwnedModel owned = random_model(kSeed, 2000, 3);
  EXPECT_THAT(violations(owned.view()), IsEmpty());
  EXPECT_GT(owned.summary.parts, owned.summary.records) << "no chain among them";
  EXPECT_GT(owned.summary.regions, 5u);
}

TEST(BaseCodec, GivesBackTheBaseMeshToTheBit) {
  const OwnedModel owned = random_model(kSeed, 500, 3);

  const Result<BaseMesh> decoded = decode_base(encode_base(owned.view()));

  ASSERT_TRUE(decoded) << decoded.error().text;
  const BaseMesh expected = base_mesh_of(owned.view());
  EXPECT_EQ(decoded->summary.digest, expected.summary.digest);
  EXPECT_EQ(decoded->summary.parts, expected.summary.parts);
  EXPECT_EQ(decoded->summary.grid.cell_size, expected.summary.grid.cell_size);
  EXPECT_EQ(decoded->summary.metres_per_unit, expected.summary.metres_per_unit);
  EXPECT_EQ(decoded->summary.deviation, expected.summary.deviation);
  EXPECT_EQ(decoded->positions, expected.positions);
  EXPECT_EQ(decoded->radii, expected.radii);
  ASSERT_EQ(decoded->faces.size(), expected.faces.size());
  EXPECT_EQ(std::memcmp(decoded->faces.data(), expected.faces.data(), expected.faces.size() * sizeof(BaseFace)), 0);
  ASSERT_EQ(decoded->regions.size(), expected.regions.size());
  EXPECT_EQ(std::memcmp(decoded->regions.data(), expected.regions.data(), expected.regions.size() * sizeof(Region)), 0);
}

TEST(BaseCodec, RefusesAnotherVersionNamingBoth) {
  Bytes bytes = encode_base(random_model(kSeed, 10, 2).view());
  bytes[0] = 9;

  const Result<BaseMesh> decoded = decode_base(bytes);

  ASSERT_FALSE(decoded);
  EXPECT_THAT(decoded.error().text, AllOf(HasSubstr("version 9"), HasSubstr("expected 2")));
}

TEST(BaseCodec, RefusesEveryTruncation) {
  const Bytes bytes = encode_base(random_model(kSeed, 50, 2).view());
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(decode_base(Span<const std::uint8_t>{bytes.data(), size})) << size << " bytes";
  }
}

TEST(BaseCodec, ReturnsNothingBrokenFromMutatedBytes) {
  const Bytes bytes = encode_base(random_model(kSeed, 50, 2).view());
  std::mt19937_64 random{kSeed};
  for (int round = 0; round < 100'000; ++round) {
    const Result<BaseMesh> decoded = decode_base(mutated(bytes, random));
    if (decoded) {
      ASSERT_THAT(violations(*decoded), IsEmpty()) << "round " << round << ", seed " << kSeed;
    }
  }
}

TEST(RegionCodec, GivesBackEveryRecordToTheBit) {
  const OwnedModel owned = random_model(kSeed, 3000, 3);
  const Model model = owned.view();
  std::mt19937_64 random{kSeed};
  for (std::uint32_t region = 0; region < model.summary.regions; ++region) {
    const std::vector<spm::Run> list = whole_list(model, RegionId{region});
    for (const std::vector<spm::Run>& sent : {list, std::vector<spm::Run>{}, random_subset(list, random)}) {
      const Result<RegionData> decoded = decode_region(encode_region(model, RegionId{region}, sent), model.summary);
      ASSERT_TRUE(decoded) << decoded.error().text;
      EXPECT_EQ(index(decoded->region), region);
      EXPECT_TRUE(same_runs(decoded->list, list));
      EXPECT_TRUE(same_runs(decoded->sent, sent));
      EXPECT_EQ(difference(model, *decoded), "");
    }
  }
}

TEST(RegionCodec, ARecordHasTheSameBytesInEveryCompany) {
  const OwnedModel owned = random_model(kSeed, 1000, 2);
  const Model model = owned.view();
  const spm::Run run = *std::max_element(model.runs.begin(), model.runs.end(),
                                         [](const spm::Run& a, const spm::Run& b) { return a.count < b.count; });
  ASSERT_GE(run.count, 3u);
  const auto region = [&] {
    for (std::uint32_t r = 0;; ++r) {
      for (const spm::Run& of_region : model.runs_of(RegionId{r})) {
        if (of_region.first == run.first && of_region.count == run.count) return RegionId{r};
      }
    }
  }();
  const auto bytes_of = [&](std::uint32_t first, std::uint32_t count) {
    const std::vector<spm::Run> sent{{first, count}};
    return encode_region(model, region, sent);
  };

  const Bytes alone = bytes_of(run.first + 1, 1);
  const Bytes together = bytes_of(run.first, 3);

  const std::size_t header = encode_region(model, region, {}).size() + 2;  // one run more than none
  const Bytes record(alone.begin() + static_cast<std::ptrdiff_t>(header), alone.end());
  EXPECT_GE(record.size(), 15u);
  EXPECT_NE(std::search(together.begin(), together.end(), record.begin(), record.end()), together.end());
}

TEST(RegionCodec, RefusesEveryTruncation) {
  const OwnedModel owned = random_model(kSeed, 60, 2);
  const Bytes bytes = encode_region(owned.view(), RegionId{0}, whole_list(owned.view(), RegionId{0}));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(decode_region({bytes.data(), size}, owned.summary)) << size << " bytes";
  }
}

TEST(RegionCodec, ReturnsNothingInsaneFromMutatedBytes) {
  const OwnedModel owned = random_model(kSeed, 60, 2);
  const Bytes bytes = encode_region(owned.view(), RegionId{0}, whole_list(owned.view(), RegionId{0}));
  std::mt19937_64 random{kSeed};
  int accepted = 0;
  for (int round = 0; round < 100'000; ++round) {
    const Result<RegionData> decoded = decode_region(mutated(bytes, random), owned.summary);
    if (!decoded) continue;
    ++accepted;
    ASSERT_NO_FATAL_FAILURE(expect_sane(*decoded, owned.summary)) << "round " << round << ", seed " << kSeed;
  }
  EXPECT_GT(accepted, 1000) << "the mutations never reach past the checks";
}

TEST(RegionCodec, RefusesRecordsThatAreNotInTheList) {
  const OwnedModel owned = random_model(kSeed, 200, 3);
  const Model model = owned.view();
  for (std::uint32_t region = 0; region < model.summary.regions; ++region) {
    const spm::Run last = model.runs_of(RegionId{region})[model.runs_of(RegionId{region}).size() - 1];
    if (last.first + last.count == model.summary.records) continue;
    const std::vector<spm::Run> beyond{{last.first + last.count, 1}};

    const Result<RegionData> decoded = decode_region(encode_region(model, RegionId{region}, beyond), model.summary);

    ASSERT_FALSE(decoded);
    EXPECT_THAT(decoded.error().text, HasSubstr("not within one run of its list"));
    return;
  }
  FAIL() << "every region lists the last record";
}

TEST(RegionCodec, RefusesACoordinateThatIsNotFinite) {
  OwnedModel owned = random_model(kSeed, 60, 2);
  const std::vector<spm::Run> list = whole_list(owned.view(), RegionId{0});
  owned.positions[owned.summary.base_vertices + list[0].first][1] = std::nanf("");

  const Result<RegionData> decoded = decode_region(encode_region(owned.view(), RegionId{0}, list), owned.summary);

  ASSERT_FALSE(decoded);
  EXPECT_THAT(decoded.error().text, HasSubstr("outside the bounds"));
}

TEST(RegionCodec, DoesNotAllocateForRecordsThatCannotBeThere) {
  OwnedModel owned = random_model(kSeed, 60, 2);
  owned.summary.records = 0xfffffff0u - owned.summary.base_vertices;
  ByteWriter out;
  out.varint(0);
  for (int i = 0; i < 2; ++i) {
    out.varint(1);
    out.varint(0);
    out.varint(owned.summary.records);
  }

  const Result<RegionData> decoded = decode_region(out.take(), owned.summary);

  ASSERT_FALSE(decoded);
  EXPECT_THAT(decoded.error().text, HasSubstr("in bytes 0"));
}

}  // namespace
}  // namespace tactus::spm::codec
