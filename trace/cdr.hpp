/// Encodes and decodes our own structs as plain CDR (XCDR version 1, little-endian, with its encapsulation header), for
/// recordings.
///
/// Each struct has one function `fields`, for both reading and writing. It visits the fields in the order of the IDL:
///
///     template <class Self, class Visit>
///     static void fields(Self& self, Visit&& visit) { visit(self.cycle), visit(self.name); }
///
/// A field may be a number, an enum (32 bits in CDR), a bool, a std::string, a std::array, a std::vector, or another
/// struct with `fields`. Writing and reading may allocate.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace tactus::trace {

/// Thrown when a message is shorter than its type needs, or contains an impossible length.
class CdrError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

namespace cdr {
template <class T>
struct IsArray : std::false_type {};
template <class T, std::size_t size>
struct IsArray<std::array<T, size>> : std::true_type {};
template <class T>
struct IsVector : std::false_type {};
template <class T>
struct IsVector<std::vector<T>> : std::true_type {};
inline constexpr std::size_t kHeadBytes = 4;  // encapsulation header; fields are aligned relative to its end
}  // namespace cdr

class CdrWriter {
 public:
  template <class T>
  void operator()(const T& value) {
    if constexpr (std::is_enum_v<T>) {
      put(static_cast<std::uint32_t>(value));
    } else if constexpr (std::is_arithmetic_v<T>) {
      put(value);
    } else if constexpr (std::is_same_v<T, std::string>) {
      put(static_cast<std::uint32_t>(value.size() + 1));
      bytes_.insert(bytes_.end(), value.begin(), value.end());
      bytes_.push_back(0);
    } else if constexpr (cdr::IsArray<T>::value) {
      for (const auto& element : value) (*this)(element);
    } else if constexpr (cdr::IsVector<T>::value) {
      put(static_cast<std::uint32_t>(value.size()));
      for (const auto& element : value) (*this)(element);
    } else {
      T::fields(value, *this);
    }
  }
  /// Returns the encoded message. The span is valid until the next value is written, or `clear`.
  [[nodiscard]] std::span<const std::uint8_t> bytes() const noexcept { return {bytes_.data(), bytes_.size()}; }
  /// Discards the values and begins a new message.
  void clear() { bytes_.resize(cdr::kHeadBytes); }

 private:
  template <class Number>
  void put(Number value) {
    const std::size_t to =
        cdr::kHeadBytes + (bytes_.size() - cdr::kHeadBytes + sizeof value - 1) / sizeof value * sizeof value;
    bytes_.resize(to + sizeof value);
    std::memcpy(bytes_.data() + to, &value, sizeof value);  // the machine is little-endian, which spm/ requires too
  }
  std::vector<std::uint8_t> bytes_{0, 1, 0, 0};
};

class CdrReader {
 public:
  /// Throws CdrError if the message is not little-endian CDR. Reading a value throws CdrError if the message has ended.
  explicit CdrReader(std::span<const std::uint8_t> bytes) : bytes_{bytes} {
    if (bytes.size() < cdr::kHeadBytes || bytes[0] != 0 || bytes[1] != 1)
      throw CdrError("found another encoding, expected little-endian CDR");
  }
  template <class T>
  void operator()(T& value) {
    if constexpr (std::is_enum_v<T>) {
      value = static_cast<T>(take<std::uint32_t>());
    } else if constexpr (std::is_same_v<T, bool>) {
      value = take<std::uint8_t>() != 0;
    } else if constexpr (std::is_arithmetic_v<T>) {
      value = take<T>();
    } else if constexpr (std::is_same_v<T, std::string>) {
      const std::size_t size = count();
      if (size == 0) throw CdrError("found a string without its terminating zero");
      value.assign(reinterpret_cast<const char*>(bytes_.data() + at_), size - 1);
      at_ += size;
    } else if constexpr (cdr::IsArray<T>::value) {
      for (auto& element : value) (*this)(element);
    } else if constexpr (cdr::IsVector<T>::value) {
      value.clear();  // elements are added one by one, because a damaged count may exceed the data
      for (std::size_t left = count(); left > 0; --left) (*this)(value.emplace_back());
    } else {
      T::fields(value, *this);
    }
  }

 private:
  template <class Number>
  Number take() {
    const std::size_t from =
        cdr::kHeadBytes + (at_ - cdr::kHeadBytes + sizeof(Number) - 1) / sizeof(Number) * sizeof(Number);
    if (from + sizeof(Number) > bytes_.size()) throw CdrError("found the end of the message, expected more");
    at_ = from + sizeof(Number);
    Number value;
    std::memcpy(&value, bytes_.data() + from, sizeof value);
    return value;
  }
  /// Reads the number of elements of a vector or of bytes of a string. Throws if it exceeds the number of remaining
  /// bytes.
  std::size_t count() {
    const auto elements = take<std::uint32_t>();
    if (elements > bytes_.size() - at_)
      throw CdrError("found " + std::to_string(elements) + " elements, more than the message can hold");
    return elements;
  }
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = cdr::kHeadBytes;  // offset of the next byte to read, before alignment
};

}  // namespace tactus::trace
