/// A matcher for the messages of refused models.
#pragma once

#include <gmock/gmock.h>

#include <regex>
#include <string>
#include <string_view>

namespace tactus::test_support {

/// Matches a message that begins with the path of the file, and then states a reason: at least two words, and no names
/// of C++ types or functions, such as "std::length_error" or "vector::_M_default_append".
MATCHER_P(NamesFileAndReason, file, "is a message with the file " + std::string{file} + " and a reason") {
  const std::string message{arg}, name = std::string{file} + ": ";
  if (message.rfind(name, 0) != 0) return false;
  std::string reason = message.substr(name.size());
  constexpr std::string_view kRefused = "cannot be read as a model: ";  // it states no reason yet
  if (reason.rfind(kRefused, 0) == 0) reason.erase(0, kRefused.size());
  static const std::regex two_words{"[A-Za-z]{2,}[^A-Za-z]+[A-Za-z]{2,}"};
  static const std::regex internal{"::|\\b_M_|\\b[A-Z][a-z]+[A-Za-z]*(Error|Exception)\\b|\\bbad_[a-z]+\\b"};
  return std::regex_search(reason, two_words) && !std::regex_search(reason, internal);
}

}  // namespace tactus::test_support
