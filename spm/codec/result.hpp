/// Result: a decoded value, or the reason for which the bytes were refused.
#pragma once

#include <string>
#include <utility>
#include <variant>

namespace tactus::spm::codec {

/// An error message: place of the error, value found, value expected.
struct DecodeError {
  std::string text;
};

template <class T, class E = DecodeError>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_{std::move(value)} {}
  Result(E error) : state_{std::move(error)} {}

  [[nodiscard]] explicit operator bool() const noexcept { return state_.index() == 0; }
  /// The value. The result must have one: bool(result) is true.
  [[nodiscard]] T& operator*() { return std::get<0>(state_); }
  [[nodiscard]] const T& operator*() const { return std::get<0>(state_); }
  [[nodiscard]] T* operator->() { return &std::get<0>(state_); }
  [[nodiscard]] const T* operator->() const { return &std::get<0>(state_); }
  /// The reason. The result must have no value: bool(result) is false.
  [[nodiscard]] const E& error() const { return std::get<1>(state_); }

 private:
  std::variant<T, E> state_;
};

}  // namespace tactus::spm::codec
