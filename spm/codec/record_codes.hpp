/// A model's records as bit strings. Each record has one code, whatever the receiver and the other records in a
/// message.
///
///     anchor | radius | shape | corner | born faces | residuals
///
///     anchor     the first face of the record: a reference to a face of the last few records (NamedFaces), or the
///                difference to the anchor of the previous record. Only this field depends on the previous records in a
///                message, so each message encodes it again.
///     shape      one symbol for the usual combinations of faces and of their `last` flags; another symbol announces
///                the explicit form.
///     corner     the corner of t in the anchor, which is the first deformed face. The receiver finds the other
///                deformed faces by walking around t (LoadedFront), and so the parent and the third corners. It can,
///                because no loaded record changes the faces that this record deforms.
///     faces      each as the difference to the previous one.
///     residuals  the difference to the predicted position (PositionPredictor), in steps of the model's profile.
///
/// Each field has a prefix code of the model's own (RecordTables), which is part of the base mesh message. See
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
  kAnchor,       ///< if the previous record number is also the previous one in the message
  kAnchorFirst,  ///< otherwise; the previous anchor of the first record is 0
  kDeformed,
  kGap,
  kCount,
  // In pairs (of_kind): for a leaf, a record with radius 0, and for any other record.
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

/// A radius is encoded as its distance below the maximum code plus 1, and as 0 if there is none. This symbol announces
/// an explicit number.
inline constexpr std::uint32_t kRareRadius = 255;

/// A small number is one symbol; a larger one is a symbol for its size, followed by its lower bits.
inline constexpr std::uint32_t kSmallNumbers = 16;
inline constexpr std::uint32_t kNumberSymbols = kSmallNumbers + 2 * 29;

class RecordTables {
 public:
  using Counts = std::array<std::vector<std::uint64_t>, kFields>;  ///< by field and symbol
  [[nodiscard]] static Counts no_counts();

  /// Empty: cannot decode.
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
  enum Endpoints : std::uint8_t { kBoth, kFirst, kLast };  ///< the ends of the fan at which faces are born

  Endpoints ends;
  std::uint8_t deformed;  ///< 1 to kMaxFan
  std::uint32_t finest;   ///< a bit for each face, born faces first

  [[nodiscard]] std::uint32_t born() const noexcept { return ends == kBoth ? 2 : 1; }
  [[nodiscard]] std::uint32_t symbol() const noexcept;
  [[nodiscard]] static Shape of(std::uint32_t symbol) noexcept;  ///< below kUnusual
};

/// The faces of the previous records since the start of the interval or block: a reference to one of them takes few
/// bits. The first kSize symbols of Field::kAnchor are positions here; the symbols of a number follow.
class NamedFaces {
 public:
  static constexpr std::uint32_t kSize = 32;

  NamedFaces() noexcept { clear(); }
  void clear() noexcept { faces_.fill(kNone); }
  void add(FaceId anchor, const RecordPart& part) noexcept {
    add(anchor);
    for (int i = part.born_count; i-- > 0;) add(part.born[i].face());
  }
  /// The face at `place`, counted from the last one; kNone if there are fewer.
  [[nodiscard]] FaceId operator[](std::uint32_t place) const noexcept { return faces_[(end_ - 1 - place) % kSize]; }
  /// The position of `face`, or kSize.
  [[nodiscard]] std::uint32_t find(FaceId face) const noexcept {
    std::uint32_t place = 0;
    while (place < kSize && (*this)[place] != face) ++place;
    return place;
  }

 private:
  void add(FaceId face) noexcept { faces_[end_++ % kSize] = face; }
  std::array<FaceId, kSize> faces_;
  std::uint32_t end_ = kSize;
};

/// Records per block of a file. Each block is encoded like a message of its own, and its size is stored.
inline constexpr std::uint32_t kRecordsPerBlock = 128;

struct EncodedRecords {
  RecordTables tables;
  Bytes codes;                            ///< of all records, in order
  std::vector<std::uint64_t> block_bits;  ///< by block
};
/// Applies all records twice. About 0.3 us a record.
[[nodiscard]] EncodedRecords encode_records(const Model& model);

/// Bits of all records by field; the last entry: the explicit form.
[[nodiscard]] std::array<std::uint64_t, kFields + 1> bits_by_field(const Model& model, const RecordTables& tables);

/// The first deformed face of the record, or else its first born face.
[[nodiscard]] inline FaceId anchor_of(const RecordPart& part) noexcept {
  return part.deformed_count > 0 ? part.deformed[0].face() : part.born[0].face();
}

/// The difference of two face ids, for put_number.
[[nodiscard]] inline std::uint64_t zigzag_difference(FaceId face, FaceId before) noexcept {
  return zigzag(std::int64_t{index(face)} - index(before));
}

/// The symbol of a number and the count of its lower bits.
struct NumberParts {
  std::uint32_t symbol, low_bits;
};
[[nodiscard]] inline NumberParts number_parts(std::uint64_t value) noexcept {
  if (value < kSmallNumbers) return {static_cast<std::uint32_t>(value), 0};
  std::uint32_t length = 5;
  while (value >> length != 0) ++length;
  return {kSmallNumbers + 2 * (length - 5) + static_cast<std::uint32_t>(value >> (length - 2) & 1u), length - 2};
}
/// Writes a number below 2^33. The symbols of numbers begin at `base`.
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

/// Writes a rare number without prefix code: six bits for its length, then the number.
inline void put_rare(BitWriter& out, std::uint64_t value) {
  unsigned length = 0;
  while (value >> length != 0) ++length;
  out.put(length, 6);
  out.put(value, length);
}
/// Reads at most 56 bits, whatever the length is.
[[nodiscard]] inline std::uint64_t get_rare(BitReader& in) noexcept {
  const auto length = static_cast<unsigned>(in.get(6));
  return in.get(length < 56 ? length : 56);
}

}  // namespace tactus::spm::codec
