#include "spm/codec/model_codec.hpp"

#include <string>
#include <utility>

#include "spm/assert.hpp"
#include "spm/codec/base_codec.hpp"
#include "spm/codec/interval_codec.hpp"
#include "spm/codec/record_reader.hpp"
#include "spm/loaded_front.hpp"
#include "spm/position_predictor.hpp"
#include "spm/region_data.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm::codec {
namespace {

/// Completes records in ascending order, as Cache does, but by id.
class Resolver {
 public:
  explicit Resolver(OwnedModel& model) : model_{model}, front_{base_front(model.summary, model.base_faces)} {}

  /// What the record names is not there, or not what it has to be: false.
  [[nodiscard]] bool add(std::uint32_t record, std::vector<RecordPart>& parts,
                         const std::array<std::uint32_t, 3>& offset) {
    const std::uint32_t u = model_.summary.base_vertices + record;
    VertexRing ring;
    LoadedFront::Split faces;
    last_ = {kNone, 0};
    std::uint32_t parent = parts.front().parent;
    if (parent != kNone) ring.add(parent);
    for (std::size_t i = 0; i < parts.size(); ++i) {
      RecordPart& part = parts[i];
      if (!enter_deformed(part, u, parent, ring, faces) || parent >= u || !enter_born(part, u, parent, ring, faces)) {
        return false;
      }
      part.parent = parent;
      if (i == 0 && !place(u, ring, offset)) return false;
      if (i > 0) {
        previous_->next = static_cast<std::uint32_t>(model_.summary.records + rest_.size());
        rest_.push_back(part);
        previous_ = &rest_.back();
      } else {
        model_.parts[record] = part;
        previous_ = &model_.parts[record];
      }
      previous_->next = kNone;
    }
    front_.join(faces);
    return true;
  }
  /// The continuation parts go behind all first ones.
  void finish() { model_.parts.insert(model_.parts.end(), rest_.begin(), rest_.end()); }

 private:
  bool enter_deformed(RecordPart& part, std::uint32_t u, std::uint32_t& parent, VertexRing& ring,
                      LoadedFront::Split& faces) {
    for (int i = 0; i < part.deformed_count; ++i) {
      const DeformedRef ref = part.deformed[i];
      std::uint32_t face = ref.face();
      if (face == kNextAround) {
        if (last_.face == kNone || !front_.swing(last_)) return false;
        face = last_.face;
      }
      std::array<std::uint32_t, 3>& corners = front_.corners(face);
      if (corners[0] == kNone) return false;
      std::uint32_t corner = ref.corner();
      if (parent == kNone) {
        if (corner == kCornerOfParent) return false;
        parent = corners[corner];
        ring.add(parent);
      } else {
        corner = 0;
        while (corner < 3 && corners[corner] != parent) ++corner;
      }
      if (corner > 2) return false;
      ring.add(corners[(corner + 1) % 3]);
      ring.add(corners[(corner + 2) % 3]);
      corners[corner] = u;
      last_ = {face, corner};
      faces.deform(last_);
      part.deformed[i] = DeformedRef::make(face, corner, ref.last());
    }
    return true;
  }

  bool enter_born(RecordPart& part, std::uint32_t u, std::uint32_t parent, VertexRing& ring,
                  LoadedFront::Split& faces) {
    for (int i = 0; i < part.born_count; ++i) {
      std::uint32_t x = part.born_x[i];
      if ((x & kInRing) != 0) {
        x = x == (kInRing | kLastInRing) ? ring.size() - 1 : x & ~kInRing;
        if (x >= ring.size()) return false;
        x = ring[x];
      } else {
        ring.add(x);
      }
      std::array<std::uint32_t, 3>& corners = front_.corners(part.born[i].face());
      if (x >= u || corners[0] != kNone) return false;
      faces.bear(part.born[i].face(), part.born[i].order());
      const BornCorners at = born_corners(part.born[i].order());
      corners[static_cast<std::size_t>(at.u)] = u;
      corners[static_cast<std::size_t>(at.t)] = parent;
      corners[static_cast<std::size_t>(at.x)] = x;
      part.born_x[i] = x;
    }
    return true;
  }

  bool place(std::uint32_t u, const VertexRing& ring, const std::array<std::uint32_t, 3>& offset) {
    for (std::uint32_t i = 0; i < ring.size(); ++i) {
      if (ring[i] >= u) return false;
    }
    const auto position_of = [this](std::uint32_t v) -> const std::array<float, 3>& { return model_.positions[v]; };
    return PositionPredictor{model_.summary, ring, position_of}.place(offset, model_.positions[u]);
  }

  OwnedModel& model_;
  LoadedFront front_;
  LoadedFront::At last_{kNone, 0};  // deformed by the record
  std::vector<RecordPart> rest_;
  RecordPart* previous_ = nullptr;
};

DecodeError wrong(const std::string& what) { return {"model: " + what}; }

}  // namespace

EncodedModel::EncodedModel(const Model& model) {
  EncodedRecords records = encode_records(model);
  codes_ = std::move(records.codes);
  ByteWriter sizes;
  for (const std::uint64_t bits : records.lot_bits) sizes.varint(bits);
  BitWriter lists;
  for (std::uint32_t r = 0; r < model.summary.regions; ++r) {
    const std::uint64_t before = lists.size();
    put_intervals(lists, records.tables, model.intervals_of(RegionId{r}));
    sizes.varint(lists.size() - before);
  }
  lists_ = lists.take();
  sizes_ = sizes.take();
  base_ = encode_base(model, records.tables);
  Result<CompressedModel> coded = CompressedModel::open({base_, codes_, lists_, sizes_});
  TACTUS_CHECK(coded);
  coded_ = std::move(*coded);
}

Result<OwnedModel> decode_model(const CompressedModel& coded) {
  const ModelSpans& bytes = coded.spans();
  OwnedModel model;
  const ModelSummary& s = model.summary = coded.summary();
  const std::uint64_t bits = 8 * std::uint64_t{bytes.codes.size()};
  if (bits / RecordReader::kMinBits < s.parts) {
    return wrong(std::to_string(s.parts) + " parts do not fit " + std::to_string(bits) + " bits of codes");
  }
  model.base_radii = coded.base().radii;
  model.base_faces = coded.base().faces;
  model.regions = coded.base().regions;
  model.positions = coded.base().positions;
  model.positions.resize(s.vertices);
  model.parts.resize(s.records);

  BitReader codes{bytes.codes}, lists{bytes.lists};
  RecordReader reader{s, coded.tables()};
  Resolver resolver{model};
  std::vector<RecordPart> parts;
  std::array<std::uint32_t, 3> offset{};
  std::uint32_t anchor = 0;
  for (std::uint32_t r = 0; r < s.records; ++r) {
    const bool leads = r % kLot == 0;
    if (leads && coded.code_places()[r / kLot] != codes.at()) {
      return wrong("record " + std::to_string(r) + ": its place is stated as bit " +
                   std::to_string(coded.code_places()[r / kLot]) + ", expected " + std::to_string(codes.at()));
    }
    anchor = leads ? reader.get_first_anchor(codes, 0) : reader.get_anchor(codes, anchor);
    parts.clear();
    if (!reader.get(codes, r, anchor, parts, offset)) return wrong(reader.error());
    if (!resolver.add(r, parts, offset)) {
      return wrong("record " + std::to_string(r) + ": names what is not there, or lies outside of the bounds");
    }
  }
  resolver.finish();
  if (model.parts.size() != s.parts) {
    return wrong("found " + std::to_string(model.parts.size()) + " parts, expected " + std::to_string(s.parts));
  }
  for (std::uint32_t r = 0; r < s.regions; ++r) {
    if (coded.list_places()[r] != lists.at()) {
      return wrong("region " + std::to_string(r) + ": the place of its list is stated as bit " +
                   std::to_string(coded.list_places()[r]) + ", expected " + std::to_string(lists.at()));
    }
    std::vector<Interval> intervals;
    std::uint32_t records = 0;
    if (std::string error = get_intervals(lists, coded.tables(), s.records, intervals, records); !error.empty()) {
      return wrong("lists: " + error);
    }
    model.regions[r].first_interval = static_cast<std::uint32_t>(model.intervals.size());
    model.regions[r].interval_count = static_cast<std::uint32_t>(intervals.size());
    model.intervals.insert(model.intervals.end(), intervals.begin(), intervals.end());
  }
  if (coded.code_places().back() != codes.at() || coded.list_places().back() != lists.at()) {
    return wrong("its last sizes do not fit");
  }
  if (codes.left() >= 8 || lists.left() >= 8) return wrong("bytes too many");
  return model;
}

}  // namespace tactus::spm::codec
