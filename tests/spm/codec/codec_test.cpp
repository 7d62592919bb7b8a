#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>
#include <random>

#include "spm/codec/base_codec.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/codec/page_codec.hpp"
#include "spm/codec/record_reader.hpp"
#include "spm/codec/region_codec.hpp"
#include "tests/support/hrtc_model.hpp"
#include "tests/support/loaded_records.hpp"
#include "tests/support/random_model.hpp"

namespace tactus::spm::codec {
namespace {

using test_support::random_model;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::uint64_t kCodecSeed = 20260101;
#ifdef __SANITIZE_THREAD__
constexpr int kMutations = 2'000;  // these tests have one thread, and are 100 times slower under ThreadSanitizer
#else
constexpr int kMutations = 100'000;
#endif

std::vector<spm::Interval> whole_list(const Model& model, RegionId region) {
  const std::span<const spm::Interval> intervals = model.intervals_of(region);
  return {intervals.begin(), intervals.end()};
}

/// Returns a random subset of a list, as separate intervals.
std::vector<spm::Interval> random_subset(std::span<const spm::Interval> list, std::mt19937_64& random) {
  std::vector<spm::Interval> subset;
  for (const spm::Interval& interval : list) {
    for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) {
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

bool same_intervals(std::span<const spm::Interval> a, std::span<const spm::Interval> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const spm::Interval& x, const spm::Interval& y) {
    return x.first == y.first && x.count == y.count;
  });
}

// The expect_valid() functions check the guarantees of decode_region() for its result.
void expect_valid(const std::vector<spm::Interval>& intervals, const ModelSummary& summary) {
  for (std::size_t i = 0; i < intervals.size(); ++i) {
    const spm::Interval interval = intervals[i];
    ASSERT_GT(interval.count, 0u);
    ASSERT_LE(std::uint64_t{interval.first} + interval.count, summary.records);
    if (i > 0) {
      ASSERT_GT(interval.first, intervals[i - 1].first + intervals[i - 1].count);
    }
  }
}

/// `vertex`: the vertex that the record of this part adds.
void expect_valid(const RecordPart& part, std::uint32_t vertex, const ModelSummary& summary) {
  if (part.parent != kNone) {
    ASSERT_LT(index(part.parent), vertex);
  }
  ASSERT_LT(part.radius, kRadiusCodes);
  ASSERT_LE(radius_of(part.radius), summary.deviation);
  ASSERT_LE(part.born_count, kBornPerPart);
  ASSERT_LE(part.deformed_count, kDeformedPerPart);
  for (int i = 0; i < part.born_count; ++i) {
    ASSERT_LT(index(part.born[i].face()), summary.faces);
    if (!in_ring(part.born_x[i])) {
      ASSERT_LT(index(part.born_x[i]), vertex);
    }
  }
  for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
    if (part.deformed(i).face() != kSwing) {
      ASSERT_LT(index(part.deformed(i).face()), summary.faces);
    }
  }
}

void expect_valid(const RegionData& data, const ModelSummary& summary) {
  ASSERT_LT(index(data.region), summary.regions);
  ASSERT_NO_FATAL_FAILURE(expect_valid(data.list, summary));
  ASSERT_NO_FATAL_FAILURE(expect_valid(data.sent, summary));
  std::size_t parts = 0;
  std::size_t records = 0;
  for (const spm::Interval& interval : data.sent) {
    for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r, ++records) {
      for (bool has_next = true; has_next; ++parts) {
        const RecordPart& part = data.parts.at(parts);
        has_next = part.next != kNone;
        if (has_next) {
          ASSERT_EQ(index(part.next), parts + 1);
        }
        ASSERT_NO_FATAL_FAILURE(expect_valid(part, summary.base_vertices + r, summary));
      }
    }
  }
  ASSERT_EQ(parts, data.parts.size());
  ASSERT_EQ(records, data.residuals.size());
}

Bytes mutated(Bytes bytes, std::mt19937_64& random) {
  const std::uint64_t kind = random() % 8;
  if (kind == 0 && !bytes.empty()) bytes.resize(random() % bytes.size());
  if (kind == 1) bytes.push_back(static_cast<std::uint8_t>(random()));
  const std::uint64_t changes = kind < 2 ? random() % 2 : 1 + random() % 4;
  for (std::uint64_t i = 0; i < changes && !bytes.empty(); ++i) {
    std::uint8_t& byte = bytes[random() % bytes.size()];
    byte = static_cast<std::uint8_t>(random() % 2 == 0 ? random() : byte ^ 1u << random() % 8);
  }
  return bytes;
}

TEST(RandomModel, HasNoViolations) {
  const OwnedModel owned = random_model(kCodecSeed, 2000, 3);
  EXPECT_THAT(violations(owned.model()), IsEmpty());
  EXPECT_GT(owned.summary.parts, owned.summary.records) << "no record has several parts";
  EXPECT_GT(owned.summary.regions, 5u);
}

TEST(BaseCodec, RestoresTheBaseMeshToTheBit) {
  const OwnedModel owned = random_model(kCodecSeed, 500, 3);
  const EncodedModel encoded{owned.model()};

  const Result<DecodedBase> decoded = decode_base(encoded.compressed().spans().base);

  ASSERT_TRUE(decoded) << decoded.error().text;
  const BaseMesh expected = base_mesh_of(owned.model());
  EXPECT_EQ(decoded->mesh.summary.digest, expected.summary.digest);
  EXPECT_EQ(decoded->mesh.summary.parts, expected.summary.parts);
  EXPECT_EQ(decoded->mesh.summary.grid.cell_size, expected.summary.grid.cell_size);
  EXPECT_EQ(decoded->mesh.summary.metres_per_unit, expected.summary.metres_per_unit);
  EXPECT_EQ(decoded->mesh.summary.deviation, expected.summary.deviation);
  EXPECT_EQ(decoded->mesh.positions, expected.positions);
  EXPECT_EQ(decoded->mesh.radii, expected.radii);
  ASSERT_EQ(decoded->mesh.faces.size(), expected.faces.size());
  EXPECT_EQ(std::memcmp(decoded->mesh.faces.data(), expected.faces.data(), expected.faces.size() * sizeof(BaseFace)),
            0);
}

Bytes base_bytes(std::uint32_t records) {
  const OwnedModel owned = random_model(kCodecSeed, records, 2);
  const EncodedModel encoded{owned.model()};
  const std::span<const std::uint8_t> base = encoded.compressed().spans().base;
  return {base.begin(), base.end()};
}

TEST(BaseCodec, RefusesAnotherVersionAndNamesBothVersions) {
  Bytes bytes = base_bytes(10);
  bytes[0] = 9;

  const Result<DecodedBase> decoded = decode_base(bytes);

  ASSERT_FALSE(decoded);
  EXPECT_THAT(decoded.error().text, AllOf(HasSubstr("version 9"), HasSubstr("expected 8")));
}

TEST(BaseCodec, RefusesEveryTruncation) {
  const Bytes bytes = base_bytes(50);
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(decode_base(std::span<const std::uint8_t>{bytes.data(), size})) << size << " bytes";
  }
}

TEST(BaseCodec, RefusesTooManyFacesAndNamesTheLimit) {
  OwnedModel owned = random_model(kCodecSeed, 10, 2);
  const EncodedModel encoded{owned.model()};
  owned.summary.faces = kMaxFaces;
  const Bytes base = encode_base(owned.model(), encoded.compressed().tables());
  constexpr const char* kMessage = "faces: found 1073741824, expected 1 to 1073741823";

  const Result<DecodedBase> decoded = decode_base(base);
  ASSERT_FALSE(decoded);
  EXPECT_THAT(decoded.error().text, HasSubstr(kMessage));

  ModelSpans spans = encoded.compressed().spans();  // of an .spm file
  spans.base = base;
  const Result<CompressedModel> opened = CompressedModel::open(spans);
  ASSERT_FALSE(opened);
  EXPECT_THAT(opened.error().text, HasSubstr(kMessage));
}

TEST(BaseCodec, ReturnsNoInvalidMeshForMutatedBytes) {
  const Bytes bytes = base_bytes(50);
  std::mt19937_64 random{kCodecSeed};
  for (int round = 0; round < kMutations; ++round) {
    const Result<DecodedBase> decoded = decode_base(mutated(bytes, random));
    if (decoded) {
      ASSERT_THAT(violations(decoded->mesh), IsEmpty()) << "round " << round << ", seed " << kCodecSeed;
    }
  }
}

/// The same in bytes, except that a page has no intervals.
bool same_regions(std::span<const Region> regions, std::span<const Region> with_intervals) {
  return std::equal(regions.begin(), regions.end(), with_intervals.begin(), with_intervals.end(),
                    [](const Region& region, Region other) {
                      other.first_interval = other.interval_count = 0;
                      return std::memcmp(&region, &other, sizeof region) == 0;
                    });
}

TEST(PageCodec, RestoresEveryPage) {
  const OwnedModel owned = random_model(kCodecSeed, 2000, 12);
  const Model model = owned.model();
  const Result<std::vector<Page>> pages = decode_pages(encode_pages(model.regions), model.summary);
  ASSERT_TRUE(pages) << pages.error().text;
  ASSERT_GT(pages->size(), 1u);
  std::uint32_t first = 0;
  for (const Page& page : *pages) {
    EXPECT_EQ(page.first, first);
    ASSERT_TRUE(same_regions(page.regions, model.regions.subspan(first, page.regions.size())));
    const Result<Page> again = decode_page(encode_page(page_with_id(model.regions, page.id)), model.summary);
    ASSERT_TRUE(again) << again.error().text;
    EXPECT_EQ(again->id, page.id);
    EXPECT_TRUE(same_regions(again->regions, page.regions));
    first += static_cast<std::uint32_t>(page.regions.size());
  }
  EXPECT_EQ(first, model.summary.regions);
}

TEST(PageCodec, APageWithoutRegionsIsAPage) {
  const OwnedModel owned = random_model(kCodecSeed, 100, 2);
  const Result<Page> page = decode_page(encode_page(page_with_id(owned.regions, PageId{kPageIds - 1})), owned.summary);
  ASSERT_TRUE(page) << page.error().text;
  EXPECT_EQ(page->id, PageId{kPageIds - 1});
  EXPECT_EQ(page->first, owned.summary.regions);
  EXPECT_THAT(page->regions, IsEmpty());
}

TEST(PageCodec, RefusesEveryTruncationAndReturnsNoInvalidPageForMutatedBytes) {
  const OwnedModel owned = random_model(kCodecSeed, 200, 3);
  const Bytes bytes = encode_page(page_with_id(owned.regions, page_of(owned.regions[0])));
  for (std::size_t size = 0; size < bytes.size(); ++size)
    EXPECT_FALSE(decode_page(std::span<const std::uint8_t>{bytes.data(), size}, owned.summary)) << size << " bytes";
  std::mt19937_64 random{kCodecSeed};
  for (int round = 0; round < kMutations; ++round) {
    const Result<Page> page = decode_page(mutated(bytes, random), owned.summary);
    if (page) {
      ASSERT_THAT(violations(owned.summary, *page), IsEmpty()) << "round " << round;
    }
  }
}

class RegionCodec : public ::testing::Test {
 protected:
  explicit RegionCodec(std::uint32_t records = 600) : owned_{random_model(kCodecSeed, records, 3)} {}

  [[nodiscard]] Bytes encode(std::uint32_t region, const std::vector<spm::Interval>& sent) const {
    return *encode_region(encoded_.compressed(), RegionId{region}, sent);
  }
  [[nodiscard]] Result<RegionData> decode(std::span<const std::uint8_t> bytes) const {
    return decode_region(bytes, model_.summary, encoded_.compressed().tables());
  }

  OwnedModel owned_;
  Model model_{owned_.model()};
  EncodedModel encoded_{model_};
};

TEST_F(RegionCodec, RestoresTheListAndTheSentRecords) {
  std::mt19937_64 random{kCodecSeed};
  for (std::uint32_t region = 0; region < model_.summary.regions; ++region) {
    const std::vector<spm::Interval> list = whole_list(model_, RegionId{region});
    for (const std::vector<spm::Interval>& sent : {list, std::vector<spm::Interval>{}, random_subset(list, random)}) {
      const Result<RegionData> decoded = decode(encode(region, sent));
      ASSERT_TRUE(decoded) << decoded.error().text;
      EXPECT_EQ(index(decoded->region), region);
      EXPECT_TRUE(same_intervals(decoded->list, list));
      EXPECT_TRUE(same_intervals(decoded->sent, sent));
      ASSERT_NO_FATAL_FAILURE(expect_valid(*decoded, model_.summary));
    }
  }
}

TEST_F(RegionCodec, ARecordHasTheSameResidualsWhicheverOtherRecordsAreSent) {
  std::mt19937_64 random{kCodecSeed};
  const std::vector<spm::Interval> list = whole_list(model_, RegionId{1});
  const Result<RegionData> whole = decode(encode(1, list));
  ASSERT_TRUE(whole);
  std::map<std::uint32_t, std::array<std::uint32_t, 3>> expected;
  std::size_t position = 0;
  for (const spm::Interval& interval : list)
    for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r)
      expected[r] = whole->residuals[position++];
  for (int round = 0; round < 20; ++round) {
    const Result<RegionData> subset = decode(encode(1, random_subset(list, random)));
    ASSERT_TRUE(subset);
    position = 0;
    for (const spm::Interval& interval : subset->sent)
      for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r)
        EXPECT_EQ(subset->residuals[position++], expected[r]);
  }
}

TEST_F(RegionCodec, RefusesEveryTruncation) {
  const Bytes bytes = encode(0, whole_list(model_, RegionId{0}));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(decode({bytes.data(), size})) << size << " bytes";
  }
}

TEST_F(RegionCodec, MutatedBytesDecodeToValidDataAndLeaveTheCacheWithoutViolations) {
  test_support::HrtcModel hrtc{model_, PoolSettings::for_slots(2048)};
  const Bytes bytes = encode(0, whole_list(model_, RegionId{0}));
  std::mt19937_64 random{kCodecSeed};
  int decoded_count = 0, accepted = 0;
  for (int round = 0; round < kMutations; ++round) {
    const Result<RegionData> decoded = decode(mutated(bytes, random));
    if (!decoded) continue;
    ++decoded_count;
    ASSERT_NO_FATAL_FAILURE(expect_valid(*decoded, model_.summary)) << "round " << round << ", seed " << kCodecSeed;
    RegionList list;
    if (hrtc.accept(*decoded, list) == AcceptResult::kAccepted) {
      ++accepted;
      hrtc.cache().release(hrtc.object(), decoded->region);
    }
    if (round % 64 == 0) {
      ASSERT_THAT(hrtc.cache().violations(), IsEmpty()) << "round " << round << ", seed " << kCodecSeed;
    }
  }
  EXPECT_GT(decoded_count, kMutations / 200) << "the decoder refuses nearly all mutations";
  EXPECT_GT(accepted, 5);
  EXPECT_THAT(hrtc.cache().violations(), IsEmpty());
  hrtc.wipe_records();
  for (std::uint32_t region = 0; region < model_.summary.regions; ++region)
    ASSERT_EQ(hrtc.load(RegionId{region}), AcceptResult::kAccepted);
  EXPECT_EQ(test_support::loaded_difference(model_, hrtc.pool()), "");
}

TEST_F(RegionCodec, RefusesMoreSentRecordsThanTheMessageHasBytesFor) {
  ModelSummary vast = owned_.summary;
  vast.records = 0x7ffffff0u - vast.base_vertices;
  BitWriter out;
  out.put(0, 32);
  for (int i = 0; i < 2; ++i) {
    put_length_prefixed(out, 1);
    put_number(out, encoded_.compressed().tables()[Field::kIntervalDistance], 0);
    put_number(out, encoded_.compressed().tables()[Field::kIntervalLength], vast.records - 1);
  }

  const Result<RegionData> decoded = decode_region(out.take(), vast, encoded_.compressed().tables());

  ASSERT_FALSE(decoded);
  EXPECT_THAT(decoded.error().text, HasSubstr("number of sent records"));
}

TEST_F(RegionCodec, RefusesToEncodeRecordsThatAreNotInTheList) {
  std::uint32_t region = 0;
  while (whole_list(model_, RegionId{region}).size() < 2) ++region;
  const std::vector<spm::Interval> list = whole_list(model_, RegionId{region});
  const std::uint32_t after_first = list[0].first + list[0].count, end = list.back().first + list.back().count;
  for (const spm::Interval& no_subset :
       {spm::Interval{after_first, 1}, spm::Interval{list[0].first, list[0].count + 1}, spm::Interval{end - 1, 2},
        spm::Interval{end, 1}, spm::Interval{model_.summary.records + 1000, 1}, spm::Interval{kNone - 1, 1}}) {
    const std::vector<spm::Interval> sent{no_subset};
    const Result<Bytes> message = encode_region(encoded_.compressed(), RegionId{region}, sent);
    ASSERT_FALSE(message) << no_subset.first << " + " << no_subset.count;
    EXPECT_THAT(message.error().text, HasSubstr("its list lacks a record"));
  }
}

class RecordErrors : public RegionCodec {
 protected:
  /// Returns the error of reading record 0 from `codes`, which begin with its anchor.
  [[nodiscard]] static std::string error_of(std::span<const std::uint8_t> codes, const ModelSummary& summary,
                                            const RecordTables& tables) {
    BitReader in{codes};
    RecordReader reader{summary, tables};
    std::vector<RecordPart> parts;
    PositionPredictor::Residuals residuals{};
    const FaceId anchor = reader.get_first_anchor(in, FaceId{});
    return reader.get(in, RecordId{0}, anchor, parts, residuals) ? "" : reader.error();
  }
  [[nodiscard]] std::string error_of(std::span<const std::uint8_t> codes, const ModelSummary& summary) const {
    return error_of(codes, summary, encoded_.compressed().tables());
  }
  [[nodiscard]] std::span<const std::uint8_t> codes() const { return encoded_.compressed().spans().codes; }
};

TEST_F(RecordErrors, NameTruncationAsTheCause) {
  ASSERT_EQ(error_of(codes(), model_.summary), "");
  EXPECT_EQ(error_of(codes().first(2), model_.summary), "record 0: its bits are truncated");
}

TEST_F(RecordErrors, NameBitsThatAreNoCodeAsTheCause) {
  const RecordTables without_codes;
  EXPECT_EQ(error_of(codes(), model_.summary, without_codes), "record 0: found bits that are no word of a prefix code");
}

TEST_F(RecordErrors, StateHowFarARadiusIsBelowTheMaximum) {
  ModelSummary smooth = model_.summary;
  smooth.deviation = radius_of(1);
  EXPECT_THAT(error_of(codes(), smooth), testing::MatchesRegex("record 0: radius code is [0-9]+ below the model's "
                                                               "maximum, expected below 1"));
}

TEST(ModelCodec, RestoresAWholeModelToTheBit) {
  const OwnedModel owned = random_model(kCodecSeed, 2000, 3);
  const EncodedModel encoded{owned.model()};

  const Result<OwnedModel> decoded = decode_model(encoded.compressed());

  ASSERT_TRUE(decoded) << decoded.error().text;
  const auto same = [](const auto& a, const auto& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0;
  };
  EXPECT_EQ(std::memcmp(&decoded->summary, &owned.summary, sizeof owned.summary), 0);
  EXPECT_TRUE(same(decoded->positions, owned.positions));
  EXPECT_TRUE(same(decoded->base_radii, owned.base_radii));
  EXPECT_TRUE(same(decoded->base_faces, owned.base_faces));
  EXPECT_TRUE(same(decoded->parts, owned.parts));
  EXPECT_TRUE(same(decoded->regions, owned.regions));
  EXPECT_TRUE(same(decoded->intervals, owned.intervals));
}

TEST(ModelCodec, AListIsFoundWithoutTheListsBeforeIt) {
  const OwnedModel owned = random_model(kCodecSeed, 2000, 3);
  const EncodedModel encoded{owned.model()};
  for (std::uint32_t region = owned.summary.regions; region-- > 0;) {
    EXPECT_TRUE(same_intervals(encoded.compressed().intervals_of(RegionId{region}),
                               owned.model().intervals_of(RegionId{region})));
  }
}

TEST(ModelCodec, MutatedBytesAreRefusedOrDecodeToAModelThatViolationsCanCheck) {
  const OwnedModel owned = random_model(kCodecSeed, 200, 2);
  const EncodedModel encoded{owned.model()};
  const ModelSpans& whole = encoded.compressed().spans();
  std::mt19937_64 random{kCodecSeed};
  int valid = 0, invalid = 0;
  for (int round = 0; round < kMutations * 2 / 5; ++round) {
    Bytes base{whole.base.begin(), whole.base.end()}, regions{whole.regions.begin(), whole.regions.end()},
        codes{whole.codes.begin(), whole.codes.end()}, lists{whole.lists.begin(), whole.lists.end()},
        sizes{whole.sizes.begin(), whole.sizes.end()};
    const std::uint64_t kind = random() % 16;
    Bytes& damaged = kind < 2 ? sizes : kind < 4 ? base : kind < 6 ? lists : kind < 8 ? regions : codes;
    damaged = mutated(damaged, random);
    const Result<CompressedModel> compressed = CompressedModel::open({base, regions, codes, lists, sizes});
    if (!compressed) continue;
    // encode_region() must return also for a model that decode_model() refuses.
    for (std::uint32_t region = 0; round % 16 == 0 && region < compressed->summary().regions; ++region) {
      static_cast<void>(encode_region(*compressed, RegionId{region}, compressed->intervals_of(RegionId{region})));
    }
    const Result<OwnedModel> decoded = decode_model(*compressed);
    if (decoded) ++(violations(decoded->model()).empty() ? valid : invalid);
  }
  EXPECT_GT(valid + invalid, kMutations / 1000) << "the decoder refuses nearly all mutations";
}

TEST(Shapes, EverySymbolStandsForOneShape) {
  for (std::uint32_t symbol = 0; symbol < Shape::kUnusual; ++symbol) {
    const Shape shape = Shape::from_symbol(symbol);
    ASSERT_EQ(shape.symbol(), symbol);
    ASSERT_LE(shape.deformed, Shape::kMaxFan);
    ASSERT_LT(shape.finest, 1u << (shape.deformed + shape.born()));
  }
}

TEST(PrefixCodes, RestoreAMessageThatTakesAtMost3PercentMoreThanItsEntropy) {
  std::mt19937_64 random{kCodecSeed};
  for (const std::uint32_t symbols : {1u, 2u, 3u, 66u, 256u, 1009u}) {
    std::vector<std::uint64_t> counts(symbols, 0);
    std::vector<std::uint32_t> message;
    std::geometric_distribution<std::uint32_t> skewed{4.0 / (symbols + 8)};
    for (int i = 0; i < 20'000; ++i) {
      message.push_back(std::min(symbols - 1, skewed(random)));
      ++counts[message.back()];
    }
    const PrefixCode code{counts};
    BitWriter out;
    code.write(out);
    const std::uint64_t start = out.size();
    for (const std::uint32_t symbol : message) code.put(out, symbol);
    double entropy = 0;
    for (const std::uint64_t count : counts)
      if (count > 0) entropy -= double(count) * std::log2(double(count) / double(message.size()));
    // A prefix code uses at least one bit for each symbol. With few symbols it may therefore exceed the entropy by one
    // bit for each symbol.
    EXPECT_LE(double(out.size() - start), std::max(1.03 * entropy, entropy + 20'000 * (symbols <= 3 ? 1 : 0)));

    const Bytes bytes = out.take();
    BitReader in{bytes};
    PrefixCode read;
    ASSERT_TRUE(read.read(in, symbols));
    bool ok = true;
    for (const std::uint32_t symbol : message) ASSERT_EQ(read.get(in, ok), symbol);
    EXPECT_TRUE(ok && in.ok());
  }
}

TEST(PrefixCodes, RefuseLengthsThatFormNoPrefixCode) {
  for (const unsigned length : {1u, 12u, 15u}) {
    BitWriter out;
    for (int i = 0; i < 3; ++i) out.put(length, 4);  // at most two words have 1 bit, and 12 and 15 bits are too many
    const Bytes bytes = out.take();
    BitReader in{bytes};
    PrefixCode code;
    EXPECT_FALSE(code.read(in, 3)) << length;
  }
}

}  // namespace
}  // namespace tactus::spm::codec
