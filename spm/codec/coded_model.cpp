#include "spm/codec/coded_model.hpp"

#include <string>
#include <utility>

#include "spm/codec/record_reader.hpp"
#include "spm/codec/run_codec.hpp"

namespace tactus::spm::codec {

Result<CodedModel> CodedModel::open(const ModelSpans& spans) {
  Result<DecodedBase> base = decode_base(spans.base);
  if (!base) return base.error();
  const ModelSummary& s = base->mesh.summary;
  const std::size_t lots = (std::size_t{s.records} + kLot - 1) / kLot;
  if (spans.code_places.size() != lots) {
    return DecodeError{"model: found " + std::to_string(spans.code_places.size()) + " places of codes, expected " +
                       std::to_string(lots)};
  }
  if (spans.list_places.size() != s.regions) {
    return DecodeError{"model: found " + std::to_string(spans.list_places.size()) + " places of lists, expected " +
                       std::to_string(s.regions)};
  }
  CodedModel model;
  model.base_ = std::move(*base);
  model.spans_ = spans;
  return model;
}

std::vector<Run> CodedModel::runs_of(RegionId region) const {
  BitReader in{spans_.lists, spans_.list_places[index(region)]};
  std::vector<Run> runs;
  std::uint32_t total = 0;
  if (!get_runs(in, tables(), summary().records, runs, total).empty()) runs.clear();
  return runs;
}

void CodedModel::put_records(BitWriter& out, Span<const Run> records) const {
  RecordReader reader{summary(), tables()};
  std::vector<RecordPart> parts;
  std::array<std::uint32_t, 3> offset{};
  std::uint32_t sent = 0;  // anchor
  for (const Run& run : records) {
    BitReader in{spans_.codes};
    std::uint32_t anchor = 0;
    const std::uint32_t end = run.first + run.count;
    for (std::uint32_t r = run.first / kLot * kLot; r != end; ++r) {
      const bool leads = r % kLot == 0;
      if (leads) in = BitReader{spans_.codes, spans_.code_places[r / kLot]};
      anchor = reader.get_anchor(in, leads ? Field::kAnchorFirst : Field::kAnchor, leads ? 0 : anchor);
      const std::uint64_t first = in.at();
      parts.clear();
      if (!reader.get(in, r, anchor, parts, offset)) return;
      if (r < run.first) continue;
      const Field field = r == run.first ? Field::kAnchorFirst : Field::kAnchor;
      put_number(out, tables()[field], zigzag(std::int64_t{anchor} - sent));
      sent = anchor;
      out.copy(spans_.codes, first, in.at() - first);
    }
  }
}

}  // namespace tactus::spm::codec
