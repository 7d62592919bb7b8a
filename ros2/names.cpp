#include "ros2/names.hpp"

#include <algorithm>

namespace tactus::ros2 {
namespace {

constexpr std::string_view kDigits = "0123456789abcdef";

bool is_letter(char byte) { return (byte >= 'a' && byte <= 'z') || (byte >= 'A' && byte <= 'Z'); }
bool is_digit(char byte) { return byte >= '0' && byte <= '9'; }

/// Begin of a group, which no usual name contains.
constexpr std::string_view kGroup = "qx_";
constexpr std::size_t kGroupSize = kGroup.size() + 2;

/// Returns whether `text` begins with kGroup and two hexadecimal digits.
bool begins_with_group(std::string_view text) {
  return text.size() >= kGroupSize && text.starts_with(kGroup) &&
         kDigits.find(text[kGroup.size()]) != std::string_view::npos &&
         kDigits.find(text[kGroup.size() + 1]) != std::string_view::npos;
}

}  // namespace

std::string ros_name(std::string_view name) {
  std::string part;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const char byte = name[i];
    const bool is_first = part.empty();
    const bool is_plain = byte == '_'       ? !is_first && part.back() != '_'
                          : is_digit(byte)  ? !is_first
                          : is_letter(byte) ? !begins_with_group(name.substr(i))
                                            : false;
    if (is_plain) {
      part += byte;
    } else {
      const auto value = static_cast<unsigned char>(byte);
      part += kGroup;
      part += {kDigits[value >> 4], kDigits[value & 15u]};
    }
  }
  return part;
}

std::optional<std::string> name_of(std::string_view part) {
  std::string name;
  for (std::size_t i = 0; i < part.size(); ++i) {
    if (begins_with_group(part.substr(i))) {
      const std::string_view digits = part.substr(i + kGroup.size());
      name += static_cast<char>(kDigits.find(digits[0]) * 16 + kDigits.find(digits[1]));
      i += kGroupSize - 1;
    } else {
      name += part[i];
    }
  }
  if (name.empty() || ros_name(name) != part) return std::nullopt;
  return name;
}

}  // namespace tactus::ros2
