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
    const Entry entry = table_[in.peek() & ((1u << kMaxLength) - 1)];
    ok = ok && entry.length != 0;
    in.skip(entry.length);
    return entry.symbol;
  }

  /// The lengths, four bits each, a run of zeros as 0 and its length less one in four bits.
  void write(BitWriter& out) const;
  /// False when the lengths are those of no prefix code.
  [[nodiscard]] bool read(BitReader& in, std::uint32_t symbols);

 private:
  struct Entry {
    std::uint16_t symbol, length;
  };
  [[nodiscard]] bool assign();

  std::vector<std::uint8_t> length_;  // by symbol; 0: has no code
  std::vector<std::uint16_t> code_;   // by symbol, lowest bit first
  std::vector<Entry> table_;          // by the next kMaxLength bits
};

}  // namespace tactus::spm::codec
