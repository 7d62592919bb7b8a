#include "spm/codec/record_codes.hpp"

#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

#include "spm/loaded_front.hpp"
#include "spm/position_predictor.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm::codec {
namespace {

constexpr std::uint32_t kRadiusSymbols = kRareRadius + 1;

std::array<std::uint32_t, kFields> symbols_of_fields() {
  std::array<std::uint32_t, kFields> symbols;
  symbols.fill(kNumberSymbols);
  symbols[static_cast<std::size_t>(Field::kRadius)] = kRadiusSymbols;
  symbols[static_cast<std::size_t>(Field::kAnchor)] = RecentFaces::kSize + kNumberSymbols;
  symbols[static_cast<std::size_t>(Field::kShape)] = Shape::kSymbols;
  symbols[static_cast<std::size_t>(Field::kShapeOfInner)] = Shape::kSymbols;
  symbols[static_cast<std::size_t>(Field::kCorner)] = 3;
  return symbols;
}

/// A sink for RecordEncoder that counts the symbols, for the prefix codes.
class Counter {
 public:
  void symbol(Field field, std::uint32_t s) { ++counts_[static_cast<std::size_t>(field)][s]; }
  void number(Field field, std::uint64_t value, std::uint32_t base = 0) {
    symbol(field, base + number_parts(value).symbol);
  }
  void raw(std::uint64_t, unsigned) {}
  void rare(std::uint64_t) {}
  void begin_block() {}

  RecordTables::Counts counts_ = RecordTables::zero_counts();
};

/// A sink for RecordEncoder that writes the bits.
class Writer {
 public:
  explicit Writer(const RecordTables& tables) : tables_{tables} {}
  void symbol(Field field, std::uint32_t s) {
    tables_[field].put(out_, s);
    count(static_cast<std::size_t>(field));
  }
  void number(Field field, std::uint64_t value, std::uint32_t base = 0) {
    put_number(out_, tables_[field], value, base);
    count(static_cast<std::size_t>(field));
  }
  void raw(std::uint64_t value, unsigned bits) {
    out_.put(value, bits);
    count(kFields);
  }
  void rare(std::uint64_t value) {
    put_length_prefixed(out_, value);
    count(kFields);
  }
  void begin_block() { block_starts_.push_back(out_.size()); }

  BitWriter out_;
  std::vector<std::uint64_t> block_starts_;
  std::array<std::uint64_t, kFields + 1> bits_{};  // number of bits by field; last: without prefix code

 private:
  void count(std::size_t field) {
    bits_[field] += out_.size() - counted_;
    counted_ = out_.size();
  }
  std::uint64_t counted_ = 0;  // bits
  const RecordTables& tables_;
};

/// Applies the records in order. Encodes each record with the mesh to which it is applied.
template <class Sink>
class RecordEncoder {
 public:
  RecordEncoder(const Model& model, Sink& sink)
      : model_{model},
        sink_{sink},
        max_radius_{radius_code(model.summary.deviation)},
        front_{base_front(model.summary, model.base_faces)} {}

  void encode_all() {
    FaceId last_anchor{};
    for (const RecordId r : ids<RecordId>(model_.summary.records)) {
      const RecordPart& first = model_.first_part(r);
      const FaceId own_anchor = anchor_of(first);
      if (index(r) % kRecordsPerBlock == 0) {
        sink_.begin_block();
        recent_.clear();
        difference(Field::kAnchorFirst, own_anchor, FaceId{});
      } else if (const std::uint32_t position = recent_.find(own_anchor); position < RecentFaces::kSize) {
        sink_.symbol(Field::kAnchor, position);
      } else {
        sink_.number(Field::kAnchor, zigzag_difference(own_anchor, last_anchor), RecentFaces::kSize);
      }
      recent_.add(own_anchor, first);
      last_anchor = own_anchor;
      encode(r);
    }
  }

 private:
  using Ring = VertexRing<VertexId>;

  void encode(RecordId record) {
    const RecordPart& first = model_.first_part(record);
    const VertexId u = model_.vertex_of(record);
    Ring ring;
    ring.add(first.parent);
    gather_ring(first, ring);

    if (first.radius == 0) {
      sink_.symbol(Field::kRadius, 0);
    } else {
      const std::uint32_t below = max_radius_ - first.radius + 1u;
      sink_.symbol(Field::kRadius, std::min(below, kRareRadius));
      if (below >= kRareRadius) sink_.rare(below);
    }
    const std::uint32_t shape = shape_of(first, ring);
    sink_.symbol(field_for(Field::kShape, first.radius), shape);
    if (shape == Shape::kUnusual) {
      encode_explicitly(record, u, ring);
    } else {
      sink_.symbol(Field::kCorner, first.deformed(0).corner());
      const Field born = field_for(Field::kBornFirst, first.radius), next = field_for(Field::kBornNext, first.radius);
      difference(born, first.born[0].face(), first.deformed(0).face());
      if (first.born_count > 1) difference(next, first.born[1].face(), first.born[0].face());
      encode_position(u, first.radius, predictor_for(ring));
    }
    apply(record, u);
  }

  /// Adds the corners of the part's deformed faces, except the parent vertex.
  void gather_ring(const RecordPart& part, Ring& ring) const {
    for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
      const DeformedRef ref = part.deformed(i);
      const std::array<VertexId, 3> corners = front_.corners(ref.face());
      ring.add(corners[(ref.corner() + 1) % 3]);
      ring.add(corners[(ref.corner() + 2) % 3]);
    }
  }

  /// True if `face` is the next face after `before` around the parent vertex.
  [[nodiscard]] bool follows(const DeformedRef& before, const DeformedRef& face) const {
    ModelFront::CornerRef at{before.face(), before.corner()};
    return front_.swing(at) && at.face == face.face();
  }

  /// The symbol of the record's shape.
  [[nodiscard]] std::uint32_t shape_of(const RecordPart& part, const Ring& ring) const {
    if (part.next != kNone || part.deformed_count == 0 || part.deformed_count > Shape::kMaxFan ||
        part.born_count == 0) {
      return Shape::kUnusual;
    }
    for (std::uint32_t i = 1; i < part.deformed_count; ++i) {
      if (!follows(part.deformed(i - 1), part.deformed(i))) return Shape::kUnusual;
    }
    const auto is_at_first_end = [&](int i) { return part.born[i].order() == 0 && part.born_x[i] == ring[1]; };
    const auto is_at_last_end = [&](int i) {
      return part.born[i].order() == 1 && part.born_x[i] == ring[ring.size() - 1];
    };
    Shape shape{Shape::kBothEnds, static_cast<std::uint8_t>(part.deformed_count), 0};
    if (part.born_count == 1 && is_at_first_end(0)) {
      shape.born_at = Shape::kFirstEnd;
    } else if (part.born_count == 1 && is_at_last_end(0)) {
      shape.born_at = Shape::kLastEnd;
    } else if (part.born_count != 2 || !is_at_first_end(0) || !is_at_last_end(1)) {
      return Shape::kUnusual;
    }
    std::uint32_t bit = 0;
    for (int i = 0; i < part.born_count; ++i) shape.finest |= std::uint32_t{part.born[i].is_finest()} << bit++;
    shape.finest |= (part.finest & ((1u << part.deformed_count) - 1)) << bit;
    return shape.symbol();
  }

  void encode_explicitly(RecordId record, VertexId u, Ring& ring) {
    const PartIndex first{index(record)};
    FaceId before = anchor_of(model_.parts[first]);
    bool is_anchor = true;  // the next face is the anchor, which is encoded already
    std::optional<DeformedRef> last;
    const auto face = [&](Field field, FaceId own) {
      if (!is_anchor) difference(field, own, before);
      is_anchor = false;
      before = own;
    };
    std::optional<PositionPredictor> predictor;
    for (PartIndex p = first; p != kNone; p = model_.parts[p].next) {
      const RecordPart& part = model_.parts[p];
      sink_.raw(part.born_count | part.deformed_count << 2 | std::uint32_t{part.next != kNone} << 6, 7);
      if (p == first && part.deformed_count > 0) sink_.raw(part.deformed(0).corner(), 2);
      if (p == first && part.deformed_count == 0) sink_.rare(index(u) - index(part.parent));
      if (p != first) gather_ring(part, ring);
      for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
        const DeformedRef ref = part.deformed(i);
        const bool next = last && follows(*last, ref);
        if (last) sink_.raw(next, 1);
        if (!next) face(Field::kDeformed, ref.face());
        last = ref;
        sink_.raw(ref.is_finest(), 1);
      }
      for (int i = 0; i < part.born_count; ++i) {
        face(field_for(Field::kBornNext, part.radius), part.born[i].face());
        sink_.raw(part.born[i].bits & 3u, 2);
        const std::uint32_t at = ring.find(part.born_x[i]);
        const bool in_ring = at < ring.size();
        sink_.raw(in_ring, 1);
        sink_.rare(in_ring ? at : index(u) - index(part.born_x[i]));
        ring.add(part.born_x[i]);
      }
      if (p == first) predictor.emplace(predictor_for(ring));
    }
    encode_position(u, model_.parts[first].radius, *predictor);
  }

  [[nodiscard]] PositionPredictor predictor_for(const Ring& ring) const {
    return {model_.summary, ring,
            [this](VertexId v) -> const std::array<float, 3>& { return model_.positions[index(v)]; }};
  }
  void encode_position(VertexId u, std::uint16_t radius, const PositionPredictor& predictor) {
    const PositionPredictor::Residuals residuals = predictor.residuals_to(model_.positions[index(u)]);
    for (std::size_t i = 0; i < 3; ++i) {
      sink_.number(field_for(i < 2 ? Field::kTangentialResidual : Field::kNormalResidual, radius),
                   zigzag(static_cast<std::int32_t>(residuals[i])));
    }
  }

  void difference(Field field, FaceId face, FaceId before) { sink_.number(field, zigzag_difference(face, before)); }

  void apply(RecordId record, VertexId u) {
    ModelFront::Split faces;
    for_each_change(
        model_.parts, PartIndex{index(record)}, u,
        [&](DeformedRef ref) {
          front_.set_corner({ref.face(), ref.corner()}, u);
          faces.deform({ref.face(), ref.corner()});
        },
        [&](BornRef ref, const std::array<VertexId, 3>& corners, PartIndex, std::uint32_t) {
          front_.set(ref.face(), corners);
          faces.add_born_face(ref.face(), ref.order());
        });
    front_.link_split(faces);
  }

  const Model& model_;
  Sink& sink_;
  RecentFaces recent_;
  std::uint32_t max_radius_;
  ModelFront front_;
};

/// Counts the symbols that the intervals of all lists and their first anchors take.
void count_lists(const Model& model, Counter& counter) {
  for (std::uint32_t region = 0; region < model.summary.regions; ++region) {
    std::uint32_t end = 0;
    FaceId anchor{};
    for (const Interval& interval : model.intervals_of(RegionId{region})) {
      counter.number(Field::kIntervalDistance, interval.first - end);
      counter.number(Field::kIntervalLength, interval.count - 1);
      end = interval.first + interval.count;
      const FaceId first = anchor_of(model.first_part(RecordId{interval.first}));
      counter.number(Field::kAnchorFirst, zigzag_difference(first, anchor));
      anchor = anchor_of(model.first_part(RecordId{end - 1}));
    }
  }
  // A message can have any subset of a list, so numbers of every size need a symbol.
  for (const Field field : {Field::kIntervalDistance, Field::kIntervalLength, Field::kAnchor, Field::kAnchorFirst}) {
    const std::uint32_t base = field == Field::kAnchor ? RecentFaces::kSize : 0;
    for (std::uint64_t size = kSmallNumbers; size < std::uint64_t{1} << 33; size *= 2) {
      counter.number(field, size, base);
      counter.number(field, size + size / 2, base);
    }
    for (std::uint64_t value = 0; value < kSmallNumbers; ++value) counter.number(field, value, base);
  }
  for (std::uint32_t place = 0; place < RecentFaces::kSize; ++place) counter.symbol(Field::kAnchor, place);
}

/// Number of shapes of fans with fewer than `deformed` faces, with one born face at a given end.
constexpr std::uint32_t first_shape(std::uint32_t deformed) { return (1u << (deformed + 1)) - 4; }
/// Number of all shapes with one born face at a given end.
constexpr std::uint32_t kOneBorn = first_shape(Shape::kMaxFan + 1);
static_assert(4 * kOneBorn == Shape::kUnusual);

}  // namespace

std::uint32_t Shape::symbol() const noexcept {
  if (born_at == kBothEnds) return 2 * first_shape(deformed) + finest;
  return (born_at == kFirstEnd ? 2 : 3) * kOneBorn + first_shape(deformed) + finest;
}

Shape Shape::from_symbol(std::uint32_t symbol) noexcept {
  const BornAt born_at = symbol < 2 * kOneBorn ? kBothEnds : symbol < 3 * kOneBorn ? kFirstEnd : kLastEnd;
  const std::uint32_t scale = born_at == kBothEnds ? 2 : 1;
  const std::uint32_t rest = symbol - (born_at == kBothEnds ? 0 : born_at == kFirstEnd ? 2 : 3) * kOneBorn;
  std::uint8_t deformed = 1;
  while (scale * first_shape(deformed + 1u) <= rest) ++deformed;
  return {born_at, deformed, rest - scale * first_shape(deformed)};
}

RecordTables::Counts RecordTables::zero_counts() {
  Counts counts;
  const auto symbols = symbols_of_fields();
  for (std::size_t field = 0; field < kFields; ++field) counts[field].assign(symbols[field], 0);
  return counts;
}

RecordTables::RecordTables(const Counts& counts) {
  for (std::size_t field = 0; field < kFields; ++field) codes_[field] = PrefixCode{counts[field]};
}

void RecordTables::write(BitWriter& out) const {
  for (const PrefixCode& code : codes_) code.write(out);
}

bool RecordTables::read(BitReader& in) {
  const auto symbols = symbols_of_fields();
  for (std::size_t field = 0; field < kFields; ++field) {
    if (!codes_[field].read(in, symbols[field])) return false;
  }
  return true;
}

EncodedRecords encode_records(const Model& model) {
  Counter counter;
  RecordEncoder<Counter>{model, counter}.encode_all();
  count_lists(model, counter);
  RecordTables tables{counter.counts_};
  Writer writer{tables};
  RecordEncoder<Writer>{model, writer}.encode_all();
  std::vector<std::uint64_t>& bits = writer.block_starts_;
  bits.push_back(writer.out_.size());
  std::adjacent_difference(bits.begin(), bits.end(), bits.begin());
  bits.erase(bits.begin());
  return {std::move(tables), writer.out_.take(), std::move(bits)};
}

std::array<std::uint64_t, kFields + 1> bits_by_field(const Model& model, const RecordTables& tables) {
  Writer writer{tables};
  RecordEncoder<Writer>{model, writer}.encode_all();
  return writer.bits_;
}

}  // namespace tactus::spm::codec
