/// A canonical prefix code over a small alphabet: the lengths of the words determine the words.
///
/// The frequencies of the symbols determine the lengths. While a word is longer than kMaxLength bits, the frequencies
/// are halved and rounded up, which makes them more equal. Source: Huffman 1952.
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
  /// `frequencies`: by symbol, at most 2^kMaxLength symbols. A symbol with frequency 0 has no word.
  explicit PrefixCode(std::span<const std::uint64_t> frequencies);

  void put(BitWriter& out, std::uint32_t symbol) const { out.put(word_[symbol], length_[symbol]); }
  /// Reads a symbol. If the next bits are no word of the code, sets `ok` to false and returns symbol 0.
  [[nodiscard]] std::uint32_t get(BitReader& in, bool& ok) const noexcept {
    const std::uint32_t entry = table_[in.peek() & mask_];
    const std::uint32_t length = entry & kLengthMask;
    ok = ok && length != 0;
    in.skip(length);
    return entry >> kLengthBits;
  }

  /// Writes the lengths with four bits each. After the first of up to 16 zeros, the next four bits are the number of
  /// further zeros.
  void write(BitWriter& out) const;
  /// Reads the lengths for `symbols` symbols. Returns false if no prefix code has these lengths.
  [[nodiscard]] bool read(BitReader& in, std::uint32_t symbols);

 private:
  static constexpr unsigned kLengthBits = 4;
  static constexpr std::uint32_t kLengthMask = (1u << kLengthBits) - 1;
  [[nodiscard]] bool assign_words();

  std::vector<std::uint8_t> length_;     // bits of the word, by symbol; 0: no word
  std::vector<std::uint16_t> word_;      // by symbol, lowest bit first
  std::vector<std::uint16_t> table_{0};  // symbol and length, by the next bits: as many bits as the longest word
  std::uint32_t mask_ = 0;
};

}  // namespace tactus::spm::codec
