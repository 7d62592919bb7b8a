/// A decoded value, or the reason why the bytes were refused.
#pragma once

#include <string>
#include <utility>
#include <variant>

namespace tactus::spm::codec {

/// What is wrong and where, the value found and the value expected.
struct DecodeError {
  std::string text;
};

template <class T, class E = DecodeError>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_{std::move(value)} {}
  Result(E error) : state_{std::move(error)} {}

  [[nodiscard]] explicit operator bool() const noexcept { return state_.index() == 0; }
  /// Only when true.
  [[nodiscard]] T& operator*() { return std::get<0>(state_); }
  [[nodiscard]] const T& operator*() const { return std::get<0>(state_); }
  [[nodiscard]] T* operator->() { return &std::get<0>(state_); }
  [[nodiscard]] const T* operator->() const { return &std::get<0>(state_); }
  /// Only when false.
  [[nodiscard]] const E& error() const { return std::get<1>(state_); }

 private:
  std::variant<T, E> state_;
};

}  // namespace tactus::spm::codec
