/// A model's records as bit strings: one for each, made once, the same whoever gets it and in whatever company.
///
///     anchor | radius | shape | corner | born faces | position
///
///     anchor    the record's first face: one that the last few records named (NamedFaces), or the difference to that
///     of
///               the record before. It is the only thing that depends on the company, and told anew for each
///     shape     which faces there are and which of them are finest now, one symbol for the usual cases; another says
///               that all is spelt out
///     corner    where t stands in the first deformed face, the anchor. The others follow each other around t and are
///               found (LoadedFront), and so are t and the third corners: the receiver knows the faces as its loaded
///               records leave them, and no loaded record can have changed those that this one deforms
///     faces     each as the difference to one before
///     position  the difference to what the vertices around let expect (PositionPredictor), in steps of the model's
///     profile
///
/// Every field has a prefix code of the model's own (RecordTables), which travels with the base mesh. See
/// docs/decisions/0006-record-compression.md.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/codec/bits.hpp"
#include "spm/codec/prefix_code.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

enum class Field : std::uint8_t {
  kRadius,
  kCorner,
  kAnchor,       ///< of a record that follows the one numbered before it
  kAnchorFirst,  ///< of any other; 0 stands before the first
  kDeformed,
  kGap,
  kCount,
  // Of a leaf, a record whose radius is 0, and of any other; after each other (of_kind).
  kShape,
  kShapeOfInner,
  kBornFirst,
  kBornFirstOfInner,
  kBornNext,
  kBornNextOfInner,
  kAlong,  ///< the surface, both coordinates
  kAlongOfInner,
  kAcross,
  kAcrossOfInner
};
inline constexpr std::size_t kFields = 17;

[[nodiscard]] constexpr Field of_kind(Field field, std::uint16_t radius) noexcept {
  return static_cast<Field>(static_cast<unsigned>(field) + (radius != 0 ? 1 : 0));
}

/// A radius is told by how far its code is below the greatest, 1 for that itself and 0 for no radius; this symbol says
/// that the number follows.
inline constexpr std::uint32_t kRareRadius = 255;

/// Small numbers travel as a symbol each, others as one for their size and their lower bits as they are.
inline constexpr std::uint32_t kSmallNumbers = 16;
inline constexpr std::uint32_t kNumberSymbols = kSmallNumbers + 2 * 29;

class RecordTables {
 public:
  using Counts = std::array<std::vector<std::uint64_t>, kFields>;  ///< by field and symbol
  [[nodiscard]] static Counts no_counts();

  /// Empty: decodes nothing.
  RecordTables() = default;
  explicit RecordTables(const Counts& counts);

  [[nodiscard]] const PrefixCode& operator[](Field field) const noexcept {
    return codes_[static_cast<std::size_t>(field)];
  }
  void write(BitWriter& out) const;
  [[nodiscard]] bool read(BitReader& in);

 private:
  std::array<PrefixCode, kFields> codes_;
};

/// The usual shapes: one part, one or two born faces at the ends of a fan of up to kMaxFan deformed ones.
struct Shape {
  static constexpr std::uint32_t kMaxFan = 6;
  static constexpr std::uint32_t kUnusual = 1008;
  static constexpr std::uint32_t kSymbols = kUnusual + 1;
  enum Endpoints : std::uint8_t { kBoth, kFirst, kLast };  ///< of the fan: where faces are born

  Endpoints ends;
  std::uint8_t deformed;  ///< 1 to kMaxFan
  std::uint32_t finest;   ///< bit by face, born ones first

  [[nodiscard]] std::uint32_t born() const noexcept { return ends == kBoth ? 2 : 1; }
  [[nodiscard]] std::uint32_t symbol() const noexcept;
  [[nodiscard]] static Shape of(std::uint32_t symbol) noexcept;  ///< below kUnusual
};

/// The faces that the records before named, as far as one reads who begins at the first of a run or lot: what is named
/// again takes few bits. As a symbol of Field::kAnchor, a place here stands for itself and a number's symbols follow.
class NamedFaces {
 public:
  static constexpr std::uint32_t kSize = 32;

  NamedFaces() noexcept { clear(); }
  void clear() noexcept { faces_.fill(kNone); }
  void add(std::uint32_t anchor, const RecordPart& part) noexcept {
    add(anchor);
    for (int i = part.born_count; i-- > 0;) add(part.born[i].face());
  }
  /// The last but `place`; kNone when there were fewer.
  [[nodiscard]] std::uint32_t operator[](std::uint32_t place) const noexcept {
    return faces_[(end_ - 1 - place) % kSize];
  }
  /// kSize when it is not there.
  [[nodiscard]] std::uint32_t find(std::uint32_t face) const noexcept {
    std::uint32_t place = 0;
    while (place < kSize && (*this)[place] != face) ++place;
    return place;
  }

 private:
  void add(std::uint32_t face) noexcept { faces_[end_++ % kSize] = face; }
  std::array<std::uint32_t, kSize> faces_;
  std::uint32_t end_ = kSize;
};

/// In a file, the codes of so many records follow each other as if sent alone; how many bits each such lot takes is
/// noted.
inline constexpr std::uint32_t kLot = 128;

struct EncodedRecords {
  RecordTables tables;
  Bytes codes;                          ///< of all records, in order
  std::vector<std::uint64_t> lot_bits;  ///< by lot
};
/// Replays the model twice. About 0.3 us a record.
[[nodiscard]] EncodedRecords encode_records(const Model& model);

/// Bits that the codes of a model's records take by field, all together; the last: what is spelt out.
[[nodiscard]] std::array<std::uint64_t, kFields + 1> bits_by_field(const Model& model, const RecordTables& tables);

/// The record's first face: of its deformed ones, or else of its born ones.
[[nodiscard]] inline std::uint32_t anchor_of(const RecordPart& part) noexcept {
  return part.deformed_count > 0 ? part.deformed[0].face() : part.born[0].face();
}

/// Where the bits of a number go: symbol, count of the lower bits.
struct NumberParts {
  std::uint32_t symbol, low_bits;
};
[[nodiscard]] inline NumberParts number_parts(std::uint64_t value) noexcept {
  if (value < kSmallNumbers) return {static_cast<std::uint32_t>(value), 0};
  std::uint32_t length = 5;
  while (value >> length != 0) ++length;
  return {kSmallNumbers + 2 * (length - 5) + static_cast<std::uint32_t>(value >> (length - 2) & 1u), length - 2};
}
/// Numbers below 2^33. Their symbols are those from `base` on.
inline void put_number(BitWriter& out, const PrefixCode& code, std::uint64_t value, std::uint32_t base = 0) {
  const NumberParts parts = number_parts(value);
  code.put(out, base + parts.symbol);
  out.put(value & ((std::uint64_t{1} << parts.low_bits) - 1), parts.low_bits);
}
[[nodiscard]] inline std::uint64_t rest_of_number(BitReader& in, std::uint32_t symbol) noexcept {
  if (symbol < kSmallNumbers) return symbol;
  const std::uint32_t low_bits = (symbol - kSmallNumbers) / 2 + 3;
  return (std::uint64_t{2} | (symbol & 1u)) << low_bits | in.get(low_bits);
}
[[nodiscard]] inline std::uint64_t get_number(BitReader& in, const PrefixCode& code, bool& ok) noexcept {
  return rest_of_number(in, code.get(in, ok));
}

/// What is spelt out because it is rare: six bits for its length, then the number.
inline void put_rare(BitWriter& out, std::uint64_t value) {
  unsigned length = 0;
  while (value >> length != 0) ++length;
  out.put(length, 6);
  out.put(value, length);
}
/// At most 56 bits are read, whatever the length says.
[[nodiscard]] inline std::uint64_t get_rare(BitReader& in) noexcept {
  const auto length = static_cast<unsigned>(in.get(6));
  return in.get(length < 56 ? length : 56);
}

}  // namespace tactus::spm::codec
