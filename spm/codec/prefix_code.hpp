/// A canonical prefix code over a small alphabet, made from the frequencies of the symbols. Its lengths determine it.
///
/// Source: Huffman 1952. Lengths are limited to kMaxLength by flattening the frequencies.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/codec/bits.hpp"

namespace tactus::spm::codec {

class PrefixCode {
 public:
  static constexpr unsigned kMaxLength = 11;

  PrefixCode() = default;
  /// A symbol with frequency 0 gets no code. At most 2^kMaxLength symbols.
  explicit PrefixCode(std::span<const std::uint64_t> counts);

  void put(BitWriter& out, std::uint32_t symbol) const { out.put(code_[symbol], length_[symbol]); }
  /// Any bits give a symbol of the alphabet. `ok` becomes false if they are not a code.
  [[nodiscard]] std::uint32_t get(BitReader& in, bool& ok) const noexcept {
    const std::uint32_t entry = table_[in.peek() & mask_];
    const std::uint32_t length = entry & kLengthMask;
    ok = ok && length != 0;
    in.skip(length);
    return entry >> kLengthBits;
  }

  /// Writes the lengths, four bits each. A sequence of zeros is 0 and its length less one, in four bits.
  void write(BitWriter& out) const;
  /// False if the lengths are not those of a prefix code.
  [[nodiscard]] bool read(BitReader& in, std::uint32_t symbols);

 private:
  static constexpr unsigned kLengthBits = 4;
  static constexpr std::uint32_t kLengthMask = (1u << kLengthBits) - 1;
  [[nodiscard]] bool assign();

  std::vector<std::uint8_t> length_;     // by symbol; 0: has no code
  std::vector<std::uint16_t> code_;      // by symbol, lowest bit first
  std::vector<std::uint16_t> table_{0};  // symbol and length, by as many bits as the longest code has
  std::uint32_t mask_ = 0;
};

}  // namespace tactus::spm::codec
