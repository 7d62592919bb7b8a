/// Checksums of the blocks of a byte sequence. A block is checked when it is used for the first time. So a large file
/// can be opened without reading it.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace tactus::spm::codec {

class BlockChecksums {
 public:
  /// Size of all blocks but the last one.
  static constexpr std::size_t kBlockBytes = 65'536;

  [[nodiscard]] static constexpr std::size_t blocks_in(std::size_t bytes) noexcept {
    return (bytes + kBlockBytes - 1) / kBlockBytes;
  }
  /// Returns XXH3-64 of each block.
  [[nodiscard]] static std::vector<std::uint64_t> of(std::span<const std::uint8_t> bytes);

  /// `name` describes the bytes in error messages. `checksums` has one number for each block. `bytes` must outlive the
  /// object.
  BlockChecksums(std::string name, std::span<const std::uint8_t> bytes, std::vector<std::uint64_t> checksums);

  /// Checks the blocks with the bits from `first` to before `end`, unless they have been checked before. Returns a
  /// description of the first damaged block, or an empty string. Bits after the last byte are ignored. A first check
  /// takes some 10 us a block in memory. Any thread.
  [[nodiscard]] std::string damage(std::uint64_t first, std::uint64_t end) const;

 private:
  enum class State : std::uint8_t { kUnchecked, kSound, kDamaged };

  std::string name_;
  std::span<const std::uint8_t> bytes_;
  std::vector<std::uint64_t> checksums_;
  mutable std::vector<std::atomic<State>> states_;  // by block
};

}  // namespace tactus::spm::codec
