/// Serializes the state that a cycle passes to the next one, and restores it from bytes that may be damaged.
///
/// A class has one function that visits each member that outlives a cycle. For each member, the function states which
/// values are valid:
///
///     template <class Visit>
///     void for_each_carried(Visit& visit) noexcept {
///       visit.number("gain", gain_);
///       visit.flag("placed", placed_);
///     }
///
/// The same function counts the bytes (CarriedSize), writes them (CarriedWriter, realtime) and reads them
/// (CarriedReader). The reader checks each value before anything uses it. Only the build that wrote the bytes can read
/// them.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>

#include "spm/model.hpp"

namespace tactus::haptics {

/// The kinds of values that a class can visit. `Derived::take(name, value, is_valid, expected)` counts, writes or
/// reads.
template <class Derived>
class CarriedVisit {
 public:
  /// Visits a number or numbers that must be finite.
  void number(const char* name, double& value) noexcept {
    checked(
        name, value, [](double x) { return std::isfinite(x); }, "a finite number");
  }
  void number(const char* name, spm::Vec3d& value) noexcept {
    for (int axis = 0; axis < 3; ++axis) number(name, value[axis]);
  }
  void number(const char* name, Eigen::Quaterniond& value) noexcept {
    for (int i = 0; i < 4; ++i) number(name, value.coeffs()[i]);
  }
  template <std::size_t size>
  void number(const char* name, std::array<double, size>& value) noexcept {
    for (double& x : value) number(name, x);
  }
  /// Visits a number or numbers for which every value is valid, also NaN.
  template <class T>
  void any(const char* name, T& value) noexcept {
    static_assert(std::is_arithmetic_v<T> && !std::is_same_v<T, bool>);
    checked(
        name, value, [](const T&) { return true; }, "");
  }
  template <class T, std::size_t size>
  void any(const char* name, std::array<T, size>& value) noexcept {
    for (T& x : value) any(name, x);
  }
  void any(const char* name, spm::Vec3d& value) noexcept {
    for (int axis = 0; axis < 3; ++axis) any(name, value[axis]);
  }
  void any(const char* name, Eigen::Quaterniond& value) noexcept {
    for (int i = 0; i < 4; ++i) any(name, value.coeffs()[i]);
  }
  void flag(const char* name, bool& value) noexcept {
    std::uint8_t byte = value ? 1 : 0;
    checked(
        name, byte, [](std::uint8_t x) { return x <= 1; }, "0 or 1");
    value = byte != 0;
  }
  void count(const char* name, std::size_t& value, std::size_t max) noexcept {
    checked(
        name, value, [max](std::size_t x) { return x <= max; }, "a count that fits");
  }
  /// Visits an enumerator from `first` to `last`.
  template <class Enum>
  void choice(const char* name, Enum& value, Enum first, Enum last) noexcept {
    using Number = std::underlying_type_t<Enum>;
    auto number = static_cast<Number>(value);
    checked(
        name, number, [=](Number x) { return x >= static_cast<Number>(first) && x <= static_cast<Number>(last); },
        "one of its enumerators");
    value = static_cast<Enum>(number);
  }
  /// Visits a number or an array that must satisfy `is_valid`. `expected`: this condition in words.
  template <class T, class IsValid>
  void checked(const char* name, T& value, IsValid&& is_valid, const char* expected) noexcept {
    static_assert(std::is_trivially_copyable_v<T> && !std::is_same_v<T, bool>);
    static_cast<Derived*>(this)->take(name, value, is_valid, expected);
  }
};

/// Counts the bytes.
class CarriedSize : public CarriedVisit<CarriedSize> {
 public:
  template <class T, class IsValid>
  void take(const char* /*name*/, const T& value, const IsValid& /*is_valid*/, const char* /*expected*/) noexcept {
    bytes_ += sizeof value;
  }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }

 private:
  std::size_t bytes_ = 0;
};

/// Writes the values.
class CarriedWriter : public CarriedVisit<CarriedWriter> {
 public:
  /// `to` must have as many bytes as CarriedSize counts.
  explicit CarriedWriter(void* to) noexcept : to_{static_cast<unsigned char*>(to)} {}
  template <class T, class IsValid>
  void take(const char* /*name*/, const T& value, const IsValid& /*is_valid*/, const char* /*expected*/) noexcept {
    std::memcpy(to_, &value, sizeof value);
    to_ += sizeof value;
  }

 private:
  unsigned char* to_;
};

/// Reads the values.
class CarriedReader : public CarriedVisit<CarriedReader> {
 public:
  explicit CarriedReader(std::span<const std::uint8_t> from) noexcept : from_{from} {}
  /// The first invalid value and all values after it remain unchanged.
  template <class T, class IsValid>
  void take(const char* name, T& value, const IsValid& is_valid, const char* expected) noexcept {
    if (refused_ != nullptr) return;
    T read;
    const bool is_complete = sizeof read <= from_.size() - at_;
    if (is_complete) std::memcpy(&read, from_.data() + at_, sizeof read);
    if (!is_complete || !is_valid(read)) {
      refused_ = name;
      expected_ = is_complete ? expected : nullptr;
      return;
    }
    value = read;
    at_ += sizeof read;
  }
  /// Returns a message with the name of the first invalid value and the values expected there. Empty if all bytes were
  /// read. Allocates.
  [[nodiscard]] std::string error() const {
    const std::string size = "found a state of " + std::to_string(from_.size()) + " bytes, expected ";
    if (refused_ == nullptr) return at_ == from_.size() ? "" : size + std::to_string(at_);
    if (expected_ == nullptr) return size + "more: " + refused_ + " at byte " + std::to_string(at_) + " is missing";
    return std::string{"found an invalid value of '"} + refused_ + "' at byte " + std::to_string(at_) +
           " of the state, expected " + expected_;
  }

 private:
  std::span<const std::uint8_t> from_;
  std::size_t at_ = 0;
  const char* refused_ = nullptr;   // name of the first invalid value; null: none
  const char* expected_ = nullptr;  // null: the bytes end before that value
};

}  // namespace tactus::haptics
