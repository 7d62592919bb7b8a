#include "spm/codec/compressed_model.hpp"

#include <string>
#include <utility>

#include "spm/codec/interval_codec.hpp"
#include "spm/codec/record_reader.hpp"

namespace tactus::spm::codec {
namespace {

/// Where each begins, and where the last one ends. Sums of foreign sizes may wrap.
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
  const std::size_t lots = (std::size_t{s.records} + kLot - 1) / kLot;
  if (lots + s.regions > spans.sizes.size()) {
    return DecodeError{"model: found " + std::to_string(spans.sizes.size()) + " bytes of sizes, expected at least " +
                       std::to_string(lots + s.regions)};
  }
  CompressedModel model;
  ByteReader sizes{spans.sizes};
  model.code_places_ = places(sizes, lots);
  model.list_places_ = places(sizes, s.regions);
  if (!sizes.ok() || sizes.left() != 0) {
    return DecodeError{"model: its " + std::to_string(spans.sizes.size()) + " bytes of sizes are not " +
                       std::to_string(lots + s.regions) + " sizes"};
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

void CompressedModel::put_records(BitWriter& out, Span<const Interval> records) const {
  RecordReader reader{summary(), tables()};
  std::vector<RecordPart> parts;
  std::array<std::uint32_t, 3> offset{};
  NamedFaces named;        // in what is sent
  std::uint32_t sent = 0;  // anchor
  for (const Interval& interval : records) {
    BitReader in{spans_.codes};
    std::uint32_t anchor = 0;
    const std::uint32_t end = interval.first + interval.count;
    for (std::uint32_t r = interval.first / kLot * kLot; r != end; ++r) {
      const bool leads = r % kLot == 0;
      if (leads) in = BitReader{spans_.codes, code_places_[r / kLot]};
      anchor = leads ? reader.get_first_anchor(in, 0) : reader.get_anchor(in, anchor);
      const std::uint64_t first = in.at();
      parts.clear();
      if (!reader.get(in, r, anchor, parts, offset)) return;
      if (r < interval.first) continue;
      const std::uint64_t difference = zigzag(std::int64_t{anchor} - sent);
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
