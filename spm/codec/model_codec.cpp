#include "spm/codec/model_codec.hpp"

#include <string>
#include <utility>

#include "spm/assert.hpp"
#include "spm/codec/base_codec.hpp"
#include "spm/codec/interval_codec.hpp"
#include "spm/codec/page_codec.hpp"
#include "spm/codec/record_reader.hpp"
#include "spm/loaded_front.hpp"
#include "spm/record_decoder.hpp"

namespace tactus::spm::codec {
namespace {

/// Decodes the records of a model in ascending order.
class ModelDecoder {
 public:
  // The interface that RecordDecoder needs.
  using Vertex = VertexId;
  using Face = FaceId;
  using Part = PartIndex;

  explicit ModelDecoder(OwnedModel& model)
      : model_{model}, front_{base_front(model.summary, model.base_faces)}, u_{model.summary.base_vertices} {}

  /// Returns false if the record contradicts the previous ones.
  [[nodiscard]] bool add(std::uint32_t record, const std::vector<RecordPart>& parts,
                         const PositionPredictor::Residuals& residuals) {
    u_ = VertexId{model_.summary.base_vertices + record};
    RecordDecoder<ModelDecoder> decoder{*this, model_.summary, u_};
    for (std::size_t i = 0; i < parts.size(); ++i) {
      RecordPart part{};
      if (decoder.add(parts[i], PartIndex{record}, part) != RecordResult::kDecoded) return false;
      if (i == 0 && !decoder.restore_position(residuals, model_.positions[index(u_)])) return false;
      if (i + 1 < parts.size())
        part.next = PartIndex{static_cast<std::uint32_t>(model_.summary.records + continuations_.size() + (i > 0))};
      if (i == 0)
        model_.parts[record] = part;
      else
        continuations_.push_back(part);
    }
    decoder.finish();
    return true;
  }
  /// Appends the continuation parts to the first parts.
  void finish() { model_.parts.insert(model_.parts.end(), continuations_.begin(), continuations_.end()); }

  [[nodiscard]] ModelFront& front() noexcept { return front_; }
  [[nodiscard]] VertexId vertex(VertexId id) const noexcept { return id < u_ ? id : VertexId{kNone}; }
  [[nodiscard]] FaceId face(FaceId id) const noexcept {
    return index(id) < model_.summary.faces && front_.corners(id)[0] != kNone ? id : FaceId{kNone};
  }
  [[nodiscard]] FaceId add_born_face(FaceId id, PartIndex, std::uint32_t) const noexcept { return id; }
  [[nodiscard]] const std::array<float, 3>& position(VertexId id) const noexcept { return model_.positions[index(id)]; }

 private:
  OwnedModel& model_;
  ModelFront front_;
  VertexId u_;  // vertex of the current record; all vertices below it are decoded
  std::vector<RecordPart> continuations_;
};

DecodeError wrong(const std::string& what) { return {"model: " + what}; }

}  // namespace

EncodedModel::EncodedModel(const Model& model) {
  EncodedRecords records = encode_records(model);
  codes_ = std::move(records.codes);
  ByteWriter sizes;
  for (const std::uint64_t bits : records.block_bits) sizes.varint(bits);
  BitWriter lists;
  for (std::uint32_t r = 0; r < model.summary.regions; ++r) {
    const std::uint64_t before = lists.size();
    put_intervals(lists, records.tables, model.intervals_of(RegionId{r}));
    sizes.varint(lists.size() - before);
  }
  lists_ = lists.take();
  sizes_ = sizes.take();
  base_ = encode_base(model, records.tables);
  regions_ = encode_regions(model.regions);
  Result<CompressedModel> compressed = CompressedModel::open({base_, regions_, codes_, lists_, sizes_});
  TACTUS_CHECK(compressed);
  compressed_ = std::move(*compressed);
}

Result<OwnedModel> decode_model(const CompressedModel& compressed) {
  const ModelSpans& bytes = compressed.spans();
  OwnedModel model;
  const ModelSummary& s = model.summary = compressed.summary();
  const std::uint64_t bits = 8 * std::uint64_t{bytes.codes.size()};
  if (bits / RecordReader::kMinBits < s.parts) {
    return wrong(std::to_string(s.parts) + " parts do not fit into " + std::to_string(bits) + " bits of codes");
  }
  model.base_radii = compressed.base().radii;
  model.base_faces = compressed.base().faces;
  model.regions.assign(compressed.regions().begin(), compressed.regions().end());
  model.positions = compressed.base().positions;
  model.positions.resize(s.vertices);
  model.parts.resize(s.records);

  BitReader codes{bytes.codes}, lists{bytes.lists};
  RecordReader reader{s, compressed.tables()};
  ModelDecoder decoder{model};
  std::vector<RecordPart> parts;
  PositionPredictor::Residuals residuals{};
  FaceId anchor{};
  for (std::uint32_t r = 0; r < s.records; ++r) {
    const bool begins_block = r % kRecordsPerBlock == 0;
    if (begins_block && compressed.block_starts()[r / kRecordsPerBlock] != codes.position()) {
      return wrong("record " + std::to_string(r) + ": found a block that begins at bit " +
                   std::to_string(compressed.block_starts()[r / kRecordsPerBlock]) + ", expected bit " +
                   std::to_string(codes.position()));
    }
    anchor = begins_block ? reader.get_first_anchor(codes, FaceId{}) : reader.get_anchor(codes, anchor);
    parts.clear();
    if (!reader.get(codes, RecordId{r}, anchor, parts, residuals)) return wrong(reader.error());
    if (!decoder.add(r, parts, residuals)) {
      return wrong("record " + std::to_string(r) +
                   ": refers to a face or vertex that does not exist yet, or lies outside the bounds");
    }
  }
  decoder.finish();
  if (model.parts.size() != s.parts) {
    return wrong("found " + std::to_string(model.parts.size()) + " parts, expected " + std::to_string(s.parts));
  }
  for (std::uint32_t r = 0; r < s.regions; ++r) {
    if (compressed.list_starts()[r] != lists.position()) {
      return wrong("region " + std::to_string(r) + ": found a list that begins at bit " +
                   std::to_string(compressed.list_starts()[r]) + ", expected bit " + std::to_string(lists.position()));
    }
    std::vector<Interval> intervals;
    std::uint32_t records = 0;
    if (std::string error = get_intervals(lists, compressed.tables(), s.records, intervals, records); !error.empty()) {
      return wrong("lists: " + error);
    }
    model.regions[r].first_interval = static_cast<std::uint32_t>(model.intervals.size());
    model.regions[r].interval_count = static_cast<std::uint32_t>(intervals.size());
    model.intervals.insert(model.intervals.end(), intervals.begin(), intervals.end());
  }
  if (compressed.block_starts().back() != codes.position() || compressed.list_starts().back() != lists.position()) {
    return wrong("the size of the last block or list does not match its bits");
  }
  if (codes.remaining() >= 8 || lists.remaining() >= 8) return wrong("found bytes after the last record or list");
  return model;
}

}  // namespace tactus::spm::codec
