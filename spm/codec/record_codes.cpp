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
  symbols[static_cast<std::size_t>(Field::kAnchor)] = NamedFaces::kSize + kNumberSymbols;
  symbols[static_cast<std::size_t>(Field::kShape)] = Shape::kSymbols;
  symbols[static_cast<std::size_t>(Field::kShapeOfInner)] = Shape::kSymbols;
  symbols[static_cast<std::size_t>(Field::kCorner)] = 3;
  return symbols;
}

/// Counts symbols, for the prefix codes.
class Counter {
 public:
  void symbol(Field field, std::uint32_t s) { ++counts_[static_cast<std::size_t>(field)][s]; }
  void number(Field field, std::uint64_t value, std::uint32_t base = 0) {
    symbol(field, base + number_parts(value).symbol);
  }
  void raw(std::uint64_t, unsigned) {}
  void rare(std::uint64_t) {}
  void begin_block() {}

  RecordTables::Counts counts_ = RecordTables::no_counts();
};

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
    put_rare(out_, value);
    count(kFields);
  }
  void begin_block() { places_.push_back(out_.size()); }

  BitWriter out_;
  std::vector<std::uint64_t> places_;
  std::array<std::uint64_t, kFields + 1> bits_{};  // by field; the last: explicit form

 private:
  void count(std::size_t field) {
    bits_[field] += out_.size() - before_;
    before_ = out_.size();
  }
  std::uint64_t before_ = 0;
  const RecordTables& tables_;
};

/// Applies the records in order and encodes each of them against the mesh before it.
template <class Sink>
class Coder {
 public:
  Coder(const Model& model, Sink& sink)
      : model_{model},
        sink_{sink},
        max_{radius_code(model.summary.deviation)},
        front_{base_front(model.summary, model.base_faces)} {}

  void interval() {
    FaceId anchor{};
    for (const RecordId r : ids<RecordId>(model_.summary.records)) {
      const RecordPart& first = model_.first_part(r);
      const FaceId own = anchor_of(first);
      if (index(r) % kRecordsPerBlock == 0) {
        sink_.begin_block();
        named_.clear();
        difference(Field::kAnchorFirst, own, FaceId{});
      } else if (const std::uint32_t place = named_.find(own); place < NamedFaces::kSize) {
        sink_.symbol(Field::kAnchor, place);
      } else {
        sink_.number(Field::kAnchor, zigzag_difference(own, anchor), NamedFaces::kSize);
      }
      named_.add(own, first);
      anchor = own;
      code(r);
    }
  }

 private:
  using Ring = VertexRing<VertexId>;

  void code(RecordId record) {
    const RecordPart& first = model_.first_part(record);
    const VertexId u = model_.vertex_of(record);
    Ring ring;
    ring.add(first.parent);
    gather(first, ring);

    if (first.radius == 0) {
      sink_.symbol(Field::kRadius, 0);
    } else {
      const std::uint32_t below = max_ - first.radius + 1u;
      sink_.symbol(Field::kRadius, std::min(below, kRareRadius));
      if (below >= kRareRadius) sink_.rare(below);
    }
    const std::uint32_t shape = shape_of(first, ring);
    sink_.symbol(of_kind(Field::kShape, first.radius), shape);
    if (shape == Shape::kUnusual) {
      spell_out(record, u, ring);
    } else {
      sink_.symbol(Field::kCorner, first.deformed[0].corner());
      const Field born = of_kind(Field::kBornFirst, first.radius), next = of_kind(Field::kBornNext, first.radius);
      difference(born, first.born[0].face(), first.deformed[0].face());
      if (first.born_count > 1) difference(next, first.born[1].face(), first.born[0].face());
      place_it(u, first.radius, expected(ring));
    }
    apply(record, u);
  }

  void gather(const RecordPart& part, Ring& ring) const {
    for (int i = 0; i < part.deformed_count; ++i) {
      const std::array<VertexId, 3>& corners = front_.corners(part.deformed[i].face());
      ring.add(corners[(part.deformed[i].corner() + 1) % 3]);
      ring.add(corners[(part.deformed[i].corner() + 2) % 3]);
    }
  }

  /// True if the next face around t after `before` is `face`.
  [[nodiscard]] bool follows(const DeformedRef& before, const DeformedRef& face) const {
    ModelFront::At at{before.face(), before.corner()};
    return front_.swing(at) && at.face == face.face();
  }

  [[nodiscard]] std::uint32_t shape_of(const RecordPart& part, const Ring& ring) const {
    if (part.next != kNone || part.deformed_count == 0 || part.deformed_count > Shape::kMaxFan ||
        part.born_count == 0) {
      return Shape::kUnusual;
    }
    for (int i = 1; i < part.deformed_count; ++i) {
      if (!follows(part.deformed[i - 1], part.deformed[i])) return Shape::kUnusual;
    }
    const auto at_first = [&](int i) { return part.born[i].order() == 0 && part.born_x[i] == ring[1]; };
    const auto at_last = [&](int i) { return part.born[i].order() == 1 && part.born_x[i] == ring[ring.size() - 1]; };
    Shape shape{Shape::kBoth, part.deformed_count, 0};
    if (part.born_count == 1 && at_first(0)) {
      shape.ends = Shape::kFirst;
    } else if (part.born_count == 1 && at_last(0)) {
      shape.ends = Shape::kLast;
    } else if (part.born_count != 2 || !at_first(0) || !at_last(1)) {
      return Shape::kUnusual;
    }
    std::uint32_t bit = 0;
    for (int i = 0; i < part.born_count; ++i) shape.finest |= std::uint32_t{part.born[i].last()} << bit++;
    for (int i = 0; i < part.deformed_count; ++i) shape.finest |= std::uint32_t{part.deformed[i].last()} << bit++;
    return shape.symbol();
  }

  void spell_out(RecordId record, VertexId u, Ring& ring) {
    const PartIndex first{index(record)};
    FaceId before = anchor_of(model_.parts[first]);
    bool anchor = true;
    DeformedRef last{};
    bool any_deformed = false;
    const auto face = [&](Field field, FaceId own) {
      if (!anchor) difference(field, own, before);
      anchor = false;
      before = own;
    };
    std::optional<PositionPredictor> place;
    for (PartIndex p = first; p != kNone; p = model_.parts[p].next) {
      const RecordPart& part = model_.parts[p];
      sink_.raw(part.born_count | part.deformed_count << 2 | std::uint32_t{part.next != kNone} << 6, 7);
      if (p == first && part.deformed_count > 0) sink_.raw(part.deformed[0].corner(), 2);
      if (p == first && part.deformed_count == 0) sink_.rare(index(u) - index(part.parent));
      if (p != first) gather(part, ring);
      for (int i = 0; i < part.deformed_count; ++i) {
        const bool next = any_deformed && follows(last, part.deformed[i]);
        if (any_deformed) sink_.raw(next, 1);
        if (!next) face(Field::kDeformed, part.deformed[i].face());
        last = part.deformed[i];
        any_deformed = true;
        sink_.raw(part.deformed[i].last(), 1);
      }
      for (int i = 0; i < part.born_count; ++i) {
        face(of_kind(Field::kBornNext, part.radius), part.born[i].face());
        sink_.raw(part.born[i].bits & 15u, 4);
        const std::uint32_t at = ring.find(part.born_x[i]);
        const bool in_ring = at < ring.size();
        sink_.raw(in_ring, 1);
        sink_.rare(in_ring ? at : index(u) - index(part.born_x[i]));
        ring.add(part.born_x[i]);
      }
      if (p == first) place.emplace(expected(ring));
    }
    place_it(u, model_.parts[first].radius, *place);
  }

  [[nodiscard]] PositionPredictor expected(const Ring& ring) const {
    return {model_.summary, ring,
            [this](VertexId v) -> const std::array<float, 3>& { return model_.positions[index(v)]; }};
  }
  void place_it(VertexId u, std::uint16_t radius, const PositionPredictor& place) {
    const PositionPredictor::Residuals offsets = place.residuals_to(model_.positions[index(u)]);
    for (std::size_t i = 0; i < 3; ++i) {
      sink_.number(of_kind(i < 2 ? Field::kAlong : Field::kAcross, radius),
                   zigzag(static_cast<std::int32_t>(offsets[i])));
    }
  }

  void difference(Field field, FaceId face, FaceId before) { sink_.number(field, zigzag_difference(face, before)); }

  void apply(RecordId record, VertexId u) {
    ModelFront::Split faces;
    for_each_change(
        model_.parts, PartIndex{index(record)}, u,
        [&](DeformedRef ref) {
          front_.corners(ref.face())[ref.corner()] = u;
          faces.deform({ref.face(), ref.corner()});
        },
        [&](BornRef ref, const std::array<VertexId, 3>& corners, PartIndex, std::uint32_t) {
          front_.set(ref.face(), corners);
          faces.bear(ref.face(), ref.order());
        });
    front_.join(faces);
  }

  const Model& model_;
  Sink& sink_;
  NamedFaces named_;
  std::uint32_t max_;
  ModelFront front_;
};

/// Counts the symbols of the intervals and of their first anchors.
void count_lists(const Model& model, Counter& counter) {
  for (std::uint32_t region = 0; region < model.summary.regions; ++region) {
    std::uint32_t end = 0;
    FaceId anchor{};
    for (const Interval& interval : model.intervals_of(RegionId{region})) {
      counter.number(Field::kGap, interval.first - end);
      counter.number(Field::kCount, interval.count - 1);
      end = interval.first + interval.count;
      const FaceId first = anchor_of(model.first_part(RecordId{interval.first}));
      counter.number(Field::kAnchorFirst, zigzag_difference(first, anchor));
      anchor = anchor_of(model.first_part(RecordId{end - 1}));
    }
  }
  // A message can have any part of any list, so numbers of every size need a symbol.
  for (const Field field : {Field::kGap, Field::kCount, Field::kAnchor, Field::kAnchorFirst}) {
    const std::uint32_t base = field == Field::kAnchor ? NamedFaces::kSize : 0;
    for (std::uint64_t size = kSmallNumbers; size < std::uint64_t{1} << 33; size *= 2) {
      counter.number(field, size, base);
      counter.number(field, size + size / 2, base);
    }
    for (std::uint64_t value = 0; value < kSmallNumbers; ++value) counter.number(field, value, base);
  }
  for (std::uint32_t place = 0; place < NamedFaces::kSize; ++place) counter.symbol(Field::kAnchor, place);
}

/// The first shape of a fan of `deformed` faces, among the shapes with one born face.
constexpr std::uint32_t first_shape(std::uint32_t deformed) { return (1u << (deformed + 1)) - 4; }
constexpr std::uint32_t kOneBorn = first_shape(Shape::kMaxFan + 1);
static_assert(4 * kOneBorn == Shape::kUnusual);

}  // namespace

std::uint32_t Shape::symbol() const noexcept {
  if (ends == kBoth) return 2 * first_shape(deformed) + finest;
  return (ends == kFirst ? 2 : 3) * kOneBorn + first_shape(deformed) + finest;
}

Shape Shape::of(std::uint32_t symbol) noexcept {
  const Endpoints ends = symbol < 2 * kOneBorn ? kBoth : symbol < 3 * kOneBorn ? kFirst : kLast;
  const std::uint32_t scale = ends == kBoth ? 2 : 1;
  const std::uint32_t rest = symbol - (ends == kBoth ? 0 : ends == kFirst ? 2 : 3) * kOneBorn;
  std::uint8_t deformed = 1;
  while (scale * first_shape(deformed + 1u) <= rest) ++deformed;
  return {ends, deformed, rest - scale * first_shape(deformed)};
}

RecordTables::Counts RecordTables::no_counts() {
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
  Coder<Counter>{model, counter}.interval();
  count_lists(model, counter);
  RecordTables tables{counter.counts_};
  Writer writer{tables};
  Coder<Writer>{model, writer}.interval();
  std::vector<std::uint64_t>& bits = writer.places_;
  bits.push_back(writer.out_.size());
  std::adjacent_difference(bits.begin(), bits.end(), bits.begin());
  bits.erase(bits.begin());
  return {std::move(tables), writer.out_.take(), std::move(bits)};
}

std::array<std::uint64_t, kFields + 1> bits_by_field(const Model& model, const RecordTables& tables) {
  Writer writer{tables};
  Coder<Writer>{model, writer}.interval();
  return writer.bits_;
}

}  // namespace tactus::spm::codec
