/// Encodes records as bits. Except for its anchor, a record has the same code in every message, whatever the receiver
/// has and whichever records are sent with it.
///
///     anchor | radius | shape | corner | born faces | residuals
///
///     anchor     the first deformed face of the record, or its first born face if it deforms none. The field is the
///                position of the anchor among the faces of the last few records (RecentFaces), or the difference to
///                the anchor of the previous record. It depends on the previous records in the message, so each message
///                encodes it anew.
///     shape      one symbol for each usual combination of faces and of their flags "finest". Symbol kUnusual announces
///                the explicit form, which has all faces one by one (RecordReader::get_explicit_faces).
///     corner     the corner of the anchor at which the parent vertex t is. The receiver walks around t (LoadedFront)
///                to find the other deformed faces. The walk succeeds: a record that changes these faces later
///                depends on this record, so it is not loaded yet. The third corners of the born faces follow from the
///                deformed faces.
///     born faces each as the difference to the previous face.
///     residuals  the difference to the predicted position (PositionPredictor), in steps of the model's profile.
///
/// Each field has its own prefix code, made for the model (RecordTables). The base mesh message contains these codes.
/// See docs/decisions/0006-record-compression.md.
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
  kAnchor,            ///< anchor of a record whose predecessor in the message has the previous record number
  kAnchorFirst,       ///< anchor of any other record; the previous anchor is face 0 at the start of a message or block
  kDeformed,          ///< deformed face, in the explicit form
  kIntervalDistance,  ///< distance between two intervals of a list
  kIntervalLength,    ///< length of an interval of a list, minus 1
  // The remaining fields are in pairs (field_for): for records with radius 0, and for all others, whose vertex has
  // children in the forest ("inner").
  kShape,
  kShapeOfInner,
  kBornFirst,
  kBornFirstOfInner,
  kBornNext,
  kBornNextOfInner,
  kTangentialResidual,  ///< residuals of the two coordinates along the surface
  kTangentialResidualOfInner,
  kNormalResidual,  ///< residual of the coordinate across the surface
  kNormalResidualOfInner
};
inline constexpr std::size_t kFields = 17;

/// The first or second field of the pair that begins with `field`, depending on the radius code of the record.
[[nodiscard]] constexpr Field field_for(Field field, std::uint16_t radius) noexcept {
  return static_cast<Field>(static_cast<unsigned>(field) + (radius != 0 ? 1 : 0));
}

/// The symbol of radius code 0 is 0. Any other radius code r becomes the number R - r + 1. R is the largest radius code
/// of the model, that of ModelSummary::deviation. A number below kRareRadius is itself the symbol. For any other
/// number, the symbol is kRareRadius, and the number follows (put_length_prefixed).
inline constexpr std::uint32_t kRareRadius = 255;

/// A number below kSmallNumbers is one symbol. Any other number is a symbol for its length in bits and its second
/// highest bit, followed by its lower bits.
inline constexpr std::uint32_t kSmallNumbers = 16;
inline constexpr std::uint32_t kNumberSymbols = kSmallNumbers + 2 * 29;

/// The prefix codes of a model, one for each field.
class RecordTables {
 public:
  using Counts = std::array<std::vector<std::uint64_t>, kFields>;  ///< frequencies by field and symbol
  [[nodiscard]] static Counts zero_counts();

  /// Makes tables without any code, to which others can be assigned.
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

/// A usual combination of faces: one or two born faces, at the ends of a fan of up to kMaxFan deformed faces. The
/// record has one part.
struct Shape {
  static constexpr std::uint32_t kMaxFan = 6;
  static constexpr std::uint32_t kUnusual = 1008;
  static constexpr std::uint32_t kSymbols = kUnusual + 1;
  enum BornAt : std::uint8_t { kBothEnds, kFirstEnd, kLastEnd };  ///< the ends of the fan at which faces are born

  BornAt born_at;
  std::uint8_t deformed;  ///< number of deformed faces, 1 to kMaxFan
  std::uint32_t finest;   ///< one bit for each face, born faces first: the face is finest

  /// Number of born faces.
  [[nodiscard]] std::uint32_t born() const noexcept { return born_at == kBothEnds ? 2 : 1; }
  [[nodiscard]] std::uint32_t symbol() const noexcept;
  /// The shape of a symbol below kUnusual.
  [[nodiscard]] static Shape from_symbol(std::uint32_t symbol) noexcept;
};

/// The newest kSize anchors and born faces of the first parts of the previous records in the same interval or block. An
/// anchor is often one of these faces, and its position takes few bits. The first kSize symbols of Field::kAnchor are
/// the positions; the symbols of numbers follow.
class RecentFaces {
 public:
  static constexpr std::uint32_t kSize = 32;

  RecentFaces() noexcept { clear(); }
  void clear() noexcept { faces_.fill(kNone); }
  void add(FaceId anchor, const RecordPart& part) noexcept {
    add(anchor);
    for (int i = part.born_count; i-- > 0;) add(part.born[i].face());
  }
  /// The face at `position`; the newest face has position 0. kNone if there are fewer faces.
  [[nodiscard]] FaceId operator[](std::uint32_t position) const noexcept {
    return faces_[(end_ - 1 - position) % kSize];
  }
  /// The position of `face`, or kSize if it is not among the faces.
  [[nodiscard]] std::uint32_t find(FaceId face) const noexcept {
    std::uint32_t position = 0;
    while (position < kSize && (*this)[position] != face) ++position;
    return position;
  }

 private:
  void add(FaceId face) noexcept { faces_[end_++ % kSize] = face; }
  std::array<FaceId, kSize> faces_;
  std::uint32_t end_ = kSize;
};

/// Number of records in a block of a model file. Each block is encoded like a message of its own, and the file states
/// the size of each block.
inline constexpr std::uint32_t kRecordsPerBlock = 128;

struct EncodedRecords {
  RecordTables tables;
  Bytes codes;                            ///< of all records, in order of their numbers
  std::vector<std::uint64_t> block_bits;  ///< number of bits of each block
};
/// Encodes all records of a model. Applies each record twice: first to count symbols, then to write them. About 0.3 us
/// a record.
[[nodiscard]] EncodedRecords encode_records(const Model& model);

/// Number of bits of all records, by field. The last entry counts the bits that have no prefix code.
[[nodiscard]] std::array<std::uint64_t, kFields + 1> bits_by_field(const Model& model, const RecordTables& tables);

/// The anchor of a record: its first deformed face, or its first born face if it deforms none.
[[nodiscard]] inline FaceId anchor_of(const RecordPart& part) noexcept {
  return part.deformed_count > 0 ? part.deformed(0).face() : part.born[0].face();
}

/// The difference of two face ids, as put_number takes it.
[[nodiscard]] inline std::uint64_t zigzag_difference(FaceId face, FaceId before) noexcept {
  return zigzag(std::int64_t{index(face)} - index(before));
}

/// The symbol of a number, and how many of its lower bits follow.
struct NumberParts {
  std::uint32_t symbol, low_bits;
};
[[nodiscard]] inline NumberParts number_parts(std::uint64_t value) noexcept {
  if (value < kSmallNumbers) return {static_cast<std::uint32_t>(value), 0};
  std::uint32_t length = 5;
  while (value >> length != 0) ++length;
  return {kSmallNumbers + 2 * (length - 5) + static_cast<std::uint32_t>(value >> (length - 2) & 1u), length - 2};
}
/// Writes a number below 2^33. In `code`, number 0 has the symbol `base`.
inline void put_number(BitWriter& out, const PrefixCode& code, std::uint64_t value, std::uint32_t base = 0) {
  const NumberParts parts = number_parts(value);
  code.put(out, base + parts.symbol);
  out.put(value & ((std::uint64_t{1} << parts.low_bits) - 1), parts.low_bits);
}
/// Returns the number of a symbol. Reads the lower bits, if the number has any.
[[nodiscard]] inline std::uint64_t finish_number(BitReader& in, std::uint32_t symbol) noexcept {
  if (symbol < kSmallNumbers) return symbol;
  const std::uint32_t low_bits = (symbol - kSmallNumbers) / 2 + 3;
  return (std::uint64_t{2} | (symbol & 1u)) << low_bits | in.get(low_bits);
}
[[nodiscard]] inline std::uint64_t get_number(BitReader& in, const PrefixCode& code, bool& ok) noexcept {
  return finish_number(in, code.get(in, ok));
}

/// Writes a rare number without prefix code: its length in six bits, and the number.
inline void put_length_prefixed(BitWriter& out, std::uint64_t value) {
  unsigned length = 0;
  while (value >> length != 0) ++length;
  out.put(length, 6);
  out.put(value, length);
}
/// Reads a number written by put_length_prefixed. The length is not trusted: at most 56 bits are read.
[[nodiscard]] inline std::uint64_t get_length_prefixed(BitReader& in) noexcept {
  const auto length = static_cast<unsigned>(in.get(6));
  return in.get(length < 56 ? length : 56);
}

}  // namespace tactus::spm::codec
