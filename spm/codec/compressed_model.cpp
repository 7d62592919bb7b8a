#include "spm/codec/compressed_model.hpp"

#include <string>
#include <utility>

#include "spm/codec/interval_codec.hpp"
#include "spm/codec/record_reader.hpp"

namespace tactus::spm::codec {
namespace {

/// The start of each, and the end of the last one. Sums of sizes that are not trusted may wrap.
std::vector<std::uint64_t> places(ByteReader& sizes, std::size_t count) {
  std::vector<std::uint64_t> places{0};
  places.reserve(count + 1);
  for (std::size_t i = 0; i < count; ++i) places.push_back(places.back() + sizes.varint());
  return places;
}

}  // namespace

Result<CompressedModel> CompressedModel::open(const ModelSpans& spans) {
  Result<DecodedBase> base = decode_base(spans.base);
  if (!base) return base.error();
  const ModelSummary& s = base->mesh.summary;
  const std::size_t blocks = (std::size_t{s.records} + kRecordsPerBlock - 1) / kRecordsPerBlock;
  if (blocks + s.regions > spans.sizes.size()) {
    return DecodeError{"model: found " + std::to_string(spans.sizes.size()) + " bytes of sizes, expected at least " +
                       std::to_string(blocks + s.regions)};
  }
  CompressedModel model;
  ByteReader sizes{spans.sizes};
  model.code_places_ = places(sizes, blocks);
  model.list_places_ = places(sizes, s.regions);
  if (!sizes.ok() || sizes.left() != 0) {
    return DecodeError{"model: its " + std::to_string(spans.sizes.size()) + " bytes of sizes are not " +
                       std::to_string(blocks + s.regions) + " sizes"};
  }
  model.base_ = std::move(*base);
  model.spans_ = spans;
  return model;
}

std::vector<Interval> CompressedModel::intervals_of(RegionId region) const {
  BitReader in{spans_.lists, list_places_[index(region)]};
  std::vector<Interval> intervals;
  std::uint32_t total = 0;
  if (!get_intervals(in, tables(), summary().records, intervals, total).empty()) intervals.clear();
  return intervals;
}

void CompressedModel::put_records(BitWriter& out, std::span<const Interval> records) const {
  RecordReader reader{summary(), tables()};
  std::vector<RecordPart> parts;
  PositionPredictor::Residuals residuals{};
  NamedFaces named;  // in the message
  FaceId sent{};     // anchor
  for (const Interval& interval : records) {
    BitReader in{spans_.codes};
    FaceId anchor{};
    const std::uint32_t end = interval.first + interval.count;
    for (std::uint32_t r = interval.first / kRecordsPerBlock * kRecordsPerBlock; r != end; ++r) {
      const bool leads = r % kRecordsPerBlock == 0;
      if (leads) in = BitReader{spans_.codes, code_places_[r / kRecordsPerBlock]};
      anchor = leads ? reader.get_first_anchor(in, FaceId{}) : reader.get_anchor(in, anchor);
      const std::uint64_t first = in.at();
      parts.clear();
      if (!reader.get(in, RecordId{r}, anchor, parts, residuals)) return;
      if (r < interval.first) continue;
      const std::uint64_t difference = zigzag_difference(anchor, sent);
      if (r == interval.first) {
        named.clear();
        put_number(out, tables()[Field::kAnchorFirst], difference);
      } else if (const std::uint32_t place = named.find(anchor); place < NamedFaces::kSize) {
        tables()[Field::kAnchor].put(out, place);
      } else {
        put_number(out, tables()[Field::kAnchor], difference, NamedFaces::kSize);
      }
      named.add(anchor, parts.front());
      sent = anchor;
      out.copy(spans_.codes, first, in.at() - first);
    }
  }
}

}  // namespace tactus::spm::codec
