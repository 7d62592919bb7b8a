/// A prefix code over a small alphabet, made from how often each symbol occurs. Canonical: its lengths say it all.
///
/// Source: Huffman 1952; lengths are kept to kMaxLength by flattening the counts.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/codec/bits.hpp"

namespace tactus::spm::codec {

class PrefixCode {
 public:
  static constexpr unsigned kMaxLength = 11;

  PrefixCode() = default;
  /// A symbol that never occurs gets no code. At most 2^kMaxLength symbols.
  explicit PrefixCode(Span<const std::uint64_t> counts);

  void put(BitWriter& out, std::uint32_t symbol) const { out.put(code_[symbol], length_[symbol]); }
  /// Any bits give a symbol of the alphabet; `ok` becomes false when they are no code.
  [[nodiscard]] std::uint32_t get(BitReader& in, bool& ok) const noexcept {
    const std::uint32_t entry = table_[in.peek() & mask_];
    const std::uint32_t length = entry & kLengthMask;
    ok = ok && length != 0;
    in.skip(length);
    return entry >> kLengthBits;
  }

  /// The lengths, four bits each, a run of zeros as 0 and its length less one in four bits.
  void write(BitWriter& out) const;
  /// False when the lengths are those of no prefix code.
  [[nodiscard]] bool read(BitReader& in, std::uint32_t symbols);

 private:
  static constexpr unsigned kLengthBits = 4;
  static constexpr std::uint32_t kLengthMask = (1u << kLengthBits) - 1;
  [[nodiscard]] bool assign();

  std::vector<std::uint8_t> length_;     // by symbol; 0: has no code
  std::vector<std::uint16_t> code_;      // by symbol, lowest bit first
  std::vector<std::uint16_t> table_{0};  // by the next bits, as many as the longest code has: symbol and length
  std::uint32_t mask_ = 0;
};

}  // namespace tactus::spm::codec
