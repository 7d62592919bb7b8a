#include "spm/codec/compressed_model.hpp"

#include <string>
#include <utility>

#include "spm/codec/interval_codec.hpp"
#include "spm/codec/page_codec.hpp"
#include "spm/codec/record_reader.hpp"

namespace tactus::spm::codec {
namespace {

/// Reads `count` sizes and returns the start of each item and the end of the last. The sizes are not trusted: a sum
/// may exceed 64 bits and wrap. This is harmless, because no reader reads past its end.
std::vector<std::uint64_t> read_starts(ByteReader& sizes, std::size_t count) {
  std::vector<std::uint64_t> starts{0};
  starts.reserve(count + 1);
  for (std::size_t i = 0; i < count; ++i) starts.push_back(starts.back() + sizes.varint());
  return starts;
}

}  // namespace

Result<CompressedModel> CompressedModel::open(const ModelSpans& spans) {
  Result<DecodedBase> base = decode_base(spans.base);
  if (!base) return base.error();
  const ModelSummary& s = base->mesh.summary;
  Result<std::vector<Region>> regions = decode_regions(spans.regions, s);
  if (!regions) return regions.error();
  const std::size_t blocks = (std::size_t{s.records} + kRecordsPerBlock - 1) / kRecordsPerBlock;
  if (blocks + s.regions > spans.sizes.size()) {
    return DecodeError{"model: found " + std::to_string(spans.sizes.size()) + " bytes of sizes, expected at least " +
                       std::to_string(blocks + s.regions)};
  }
  CompressedModel model;
  ByteReader sizes{spans.sizes};
  model.block_starts_ = read_starts(sizes, blocks);
  model.list_starts_ = read_starts(sizes, s.regions);
  if (!sizes.ok() || sizes.remaining() != 0) {
    return DecodeError{"model: the " + std::to_string(spans.sizes.size()) + " bytes of sizes are not exactly " +
                       std::to_string(blocks + s.regions) + " varints"};
  }
  model.base_ = std::move(*base);
  model.regions_ = std::move(*regions);
  model.spans_ = spans;
  return model;
}

std::string CompressedModel::list_damage(RegionId region) const {
  if (!list_checksums_) return {};
  return list_checksums_->damage(list_starts_[index(region)], list_starts_[index(region) + 1]);
}

std::vector<Interval> CompressedModel::intervals_of(RegionId region) const {
  std::vector<Interval> intervals;
  if (!list_damage(region).empty()) return intervals;
  BitReader in{spans_.lists, list_starts_[index(region)]};
  std::uint32_t total = 0;
  if (!get_intervals(in, tables(), summary().records, intervals, total).empty()) intervals.clear();
  return intervals;
}

std::string CompressedModel::damage(RegionId region, std::span<const Interval> records) const {
  std::string found = list_damage(region);
  if (!code_checksums_) return found;
  for (auto interval = records.begin(); interval != records.end() && found.empty(); ++interval) {
    const std::uint32_t first = interval->first / kRecordsPerBlock;
    const std::uint32_t last = (interval->first + interval->count - 1) / kRecordsPerBlock;
    found = code_checksums_->damage(block_starts_[first], block_starts_[last + 1]);
  }
  return found;
}

std::string CompressedModel::damage() const {
  std::string found;
  if (code_checksums_) found = code_checksums_->damage(0, 8 * std::uint64_t{spans_.codes.size()});
  if (found.empty() && list_checksums_) found = list_checksums_->damage(0, 8 * std::uint64_t{spans_.lists.size()});
  return found;
}

void CompressedModel::put_records(BitWriter& out, std::span<const Interval> records) const {
  RecordReader reader{summary(), tables()};
  std::vector<RecordPart> parts;
  PositionPredictor::Residuals residuals{};
  RecentFaces recent;    // faces of the previous records in the interval
  FaceId last_anchor{};  // anchor of the previous record in the message
  for (const Interval& interval : records) {
    BitReader in{spans_.codes};
    FaceId anchor{};
    const std::uint32_t end = interval.first + interval.count;
    for (std::uint32_t r = interval.first / kRecordsPerBlock * kRecordsPerBlock; r != end; ++r) {
      const bool begins_block = r % kRecordsPerBlock == 0;
      if (begins_block) in = BitReader{spans_.codes, block_starts_[r / kRecordsPerBlock]};
      anchor = begins_block ? reader.get_first_anchor(in, FaceId{}) : reader.get_anchor(in, anchor);
      const std::uint64_t first = in.position();
      parts.clear();
      if (!reader.get(in, RecordId{r}, anchor, parts, residuals)) return;
      if (r < interval.first) continue;
      const std::uint64_t difference = zigzag_difference(anchor, last_anchor);
      if (r == interval.first) {
        recent.clear();
        put_number(out, tables()[Field::kAnchorFirst], difference);
      } else if (const std::uint32_t position = recent.find(anchor); position < RecentFaces::kSize) {
        tables()[Field::kAnchor].put(out, position);
      } else {
        put_number(out, tables()[Field::kAnchor], difference, RecentFaces::kSize);
      }
      recent.add(anchor, parts.front());
      last_anchor = anchor;
      out.copy(spans_.codes, first, in.position() - first);
    }
  }
}

}  // namespace tactus::spm::codec
