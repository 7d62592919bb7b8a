/// Writes and reads bytes: raw values in little-endian order, and varints (7 bits of the number in each byte).
#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

namespace tactus::spm::codec {

using Bytes = std::vector<std::uint8_t>;

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "raw values are copied from memory");

/// Maps the signed numbers 0, -1, 1, -2 ... to 0, 1, 2, 3 ..., so that a small difference takes a short varint.
[[nodiscard]] constexpr std::uint64_t zigzag(std::int64_t value) noexcept {
  return static_cast<std::uint64_t>(value) << 1 ^ static_cast<std::uint64_t>(value >> 63);
}
[[nodiscard]] constexpr std::int64_t unzigzag(std::uint64_t value) noexcept {
  return static_cast<std::int64_t>(value >> 1) ^ -static_cast<std::int64_t>(value & 1u);
}

class ByteWriter {
 public:
  template <class T>
  void raw(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    const auto* from = reinterpret_cast<const std::uint8_t*>(&value);
    bytes_.insert(bytes_.end(), from, from + sizeof(T));
  }
  void varint(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes_.push_back(static_cast<std::uint8_t>(value | 0x80u));
    bytes_.push_back(static_cast<std::uint8_t>(value));
  }
  [[nodiscard]] Bytes take() noexcept { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

/// Reads bytes that are not trusted. After the first value that is incomplete, and after a varint of more than ten
/// bytes, ok() remains false and all further values are 0. So a loop of bounded length can check ok() once, at its end.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::uint8_t> bytes) noexcept
      : at_{bytes.data()}, end_{bytes.data() + bytes.size()} {}

  template <class T>
  [[nodiscard]] T raw() noexcept {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    if (remaining() < sizeof(T)) {
      fail();
    } else {
      std::memcpy(&value, at_, sizeof(T));
      at_ += sizeof(T);
    }
    return value;
  }
  [[nodiscard]] std::uint64_t varint() noexcept {
    std::uint64_t value = 0;
    for (unsigned shift = 0; at_ != end_ && shift < 64; shift += 7) {
      const std::uint8_t byte = *at_++;
      value |= static_cast<std::uint64_t>(byte & 0x7fu) << shift;
      if (byte < 0x80) return value;
    }
    fail();
    return 0;
  }
  /// Reads a varint that must fit 32 bits.
  [[nodiscard]] std::uint32_t varint32() noexcept {
    const std::uint64_t value = varint();
    if (value <= 0xffffffffu) return static_cast<std::uint32_t>(value);
    fail();
    return 0;
  }

  [[nodiscard]] std::span<const std::uint8_t> remaining_bytes() const noexcept { return {at_, remaining()}; }
  /// Skips `count` bytes, at most remaining().
  void skip(std::size_t count) noexcept { at_ += count; }
  /// Number of bytes not yet read.
  [[nodiscard]] std::size_t remaining() const noexcept { return static_cast<std::size_t>(end_ - at_); }
  [[nodiscard]] bool ok() const noexcept { return ok_; }

 private:
  void fail() noexcept {
    ok_ = false;
    at_ = end_;
  }
  const std::uint8_t* at_;
  const std::uint8_t* end_;
  bool ok_ = true;
};

}  // namespace tactus::spm::codec
