/// Writes and reads bits, the lowest bit of each byte first.
#pragma once

#include <cstdint>
#include <cstring>
#include <span>

#include "spm/codec/bytes.hpp"

namespace tactus::spm::codec {

class BitWriter {
 public:
  /// Appends the lowest `count` bits of `value`; `count` is at most 56. All higher bits of `value` must be 0.
  void put(std::uint64_t value, unsigned count) {
    window_ |= value << filled_;
    for (filled_ += count; filled_ >= 8; filled_ -= 8, window_ >>= 8)
      bytes_.push_back(static_cast<std::uint8_t>(window_));
  }
  /// Appends `count` bits of `bytes`, from bit `first` on.
  void copy(std::span<const std::uint8_t> bytes, std::uint64_t first, std::uint64_t count);

  /// Number of bits written.
  [[nodiscard]] std::uint64_t size() const noexcept { return 8 * std::uint64_t{bytes_.size()} + filled_; }
  /// Returns the bytes, the last one filled up with zero bits, and empties the writer.
  [[nodiscard]] Bytes take() {
    if (filled_ > 0) bytes_.push_back(static_cast<std::uint8_t>(window_));
    filled_ = 0;
    window_ = 0;
    return std::move(bytes_);
  }

 private:
  Bytes bytes_;
  std::uint64_t window_ = 0;
  unsigned filled_ = 0;
};

/// Reads bits that are not trusted. Every bit past the end is 0. ok() is false once such a bit has been read.
class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> bytes, std::uint64_t at = 0) noexcept
      : data_{bytes.data()}, size_{bytes.size()}, at_{at} {}

  /// Returns the next 57 bits or more; the reader stays where it is.
  [[nodiscard]] std::uint64_t peek() const noexcept {
    const std::uint64_t byte = at_ >> 3;
    std::uint64_t window = 0;
    if (byte + sizeof window <= size_) {
      std::memcpy(&window, data_ + byte, sizeof window);
    } else if (byte < size_) {
      std::memcpy(&window, data_ + byte, size_ - byte);
    }
    return window >> (at_ & 7u);
  }
  void skip(unsigned count) noexcept { at_ += count; }
  /// Reads the next `count` bits, at most 56.
  [[nodiscard]] std::uint64_t get(unsigned count) noexcept {
    const std::uint64_t value = peek() & ((std::uint64_t{1} << count) - 1);
    at_ += count;
    return value;
  }
  /// Number of bits read or skipped.
  [[nodiscard]] std::uint64_t position() const noexcept { return at_; }
  [[nodiscard]] bool ok() const noexcept { return at_ <= 8 * std::uint64_t{size_}; }
  /// Number of bits not yet read; 0 past the end.
  [[nodiscard]] std::uint64_t remaining() const noexcept { return ok() ? 8 * std::uint64_t{size_} - at_ : 0; }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
  std::uint64_t at_;
};

inline void BitWriter::copy(std::span<const std::uint8_t> bytes, std::uint64_t first, std::uint64_t count) {
  BitReader from{bytes, first};
  for (; count > 56; count -= 56) put(from.get(56), 56);
  put(from.get(static_cast<unsigned>(count)), static_cast<unsigned>(count));
}

}  // namespace tactus::spm::codec
