#include "viewer/page_request.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

namespace tactus::viewer {
namespace {

using Json = nlohmann::json;

constexpr double kMaxSeconds = 1e7;  // of a recording

/// True for a text that wire accepts as a reason: 1 to 150 bytes without control characters.
bool is_reason(const Json& value) {
  constexpr std::size_t kMax = 150;
  if (!value.is_string()) return false;
  const std::string& text = value.get_ref<const std::string&>();
  return !text.empty() && text.size() <= kMax &&
         std::all_of(text.begin(), text.end(), [](char byte) { return static_cast<unsigned char>(byte) >= ' '; });
}

/// True for 1 to 32 letters, digits, '-', '_' and '.', which are valid in names of participants and partitions.
bool is_plain_name(const Json& value) {
  constexpr std::size_t kMax = 32;
  if (!value.is_string()) return false;
  const std::string& text = value.get_ref<const std::string&>();
  return !text.empty() && text.size() <= kMax && std::all_of(text.begin(), text.end(), [](char byte) {
    return (byte >= 'a' && byte <= 'z') || (byte >= 'A' && byte <= 'Z') || (byte >= '0' && byte <= '9') ||
           byte == '-' || byte == '_' || byte == '.';
  });
}

/// True for three coordinates within kMaxCoordinate of the origin of the world.
bool is_position(const Json& value) {
  constexpr double kMaxCoordinate = 100;  // m
  return value.is_array() && value.size() == 3 && std::all_of(value.begin(), value.end(), [](const Json& number) {
           return number.is_number() && std::abs(number.get<double>()) <= kMaxCoordinate;
         });
}

std::optional<PageRequest> parse_touch(const Json& value) {
  if (!value.is_object() || !value.contains("user") || !is_plain_name(value["user"])) return std::nullopt;
  if (value.size() == 1) return TouchRequest{value["user"], {}};
  // The name of an HRTC is only compared with those of the roster, so any text is valid.
  if (value.size() != 2 || !value.contains("hrtc") || !value["hrtc"].is_string()) return std::nullopt;
  return TouchRequest{value["user"], value["hrtc"]};
}

std::optional<PageRequest> parse_hand(const Json& value) {
  if (!value.is_object() || value.size() != 2 || !value.contains("target") || !is_position(value["target"]) ||
      !value.contains("grab") || !value["grab"].is_boolean())
    return std::nullopt;
  return HandRequest{value["target"], value["grab"]};
}

std::optional<PageRequest> parse_camera(const Json& value) {
  constexpr double kMaxAngle = 3.2;  // rad
  const auto is_angle = [&](const char* name) {
    return value.contains(name) && value[name].is_number() && value[name].get<double>() >= 1e-6 &&
           value[name].get<double>() <= kMaxAngle;
  };
  if (!value.is_object() || value.size() != 4 || !value.contains("position") || !is_position(value["position"]) ||
      !value.contains("direction") || !is_position(value["direction"]) || !is_angle("halfAngle") || !is_angle("pixel"))
    return std::nullopt;
  const auto vector = [](const Json& numbers) {
    return spm::Vec3d{numbers[0].get<double>(), numbers[1].get<double>(), numbers[2].get<double>()};
  };
  const spm::Vec3d direction = vector(value["direction"]);
  constexpr double kMaxError = 1e-3;
  if (!(std::abs(direction.norm() - 1) < kMaxError)) return std::nullopt;
  return CameraRequest{{vector(value["position"]), direction, value["halfAngle"], value["pixel"]}};
}

}  // namespace

std::optional<PageRequest> parse_request(const std::string& text) {
  const Json request = Json::parse(text, nullptr, false);
  if (!request.is_object() || request.size() != 1) return std::nullopt;
  const std::string_view kind = request.begin().key();
  const Json& value = request.begin().value();
  if (kind == "token" && value.is_string()) return TokenRequest{value};
  if (kind == "seen" && value.is_number_unsigned()) return SeenRequest{value};
  if (kind == "stop" && is_reason(value)) return StopRequest{value};
  if (kind == "touch") return parse_touch(value);
  if (kind == "hand") return parse_hand(value);
  if (kind == "show" && value.is_string()) return ShowRequest{value};
  if (kind == "camera") return parse_camera(value);
  if (kind == "play" && value.is_boolean()) return PlayRequest{value};
  if (kind == "seek" && value.is_number() && value.get<double>() >= 0 && value.get<double>() <= kMaxSeconds)
    return SeekRequest{value};
  if (kind == "release" && value.is_boolean()) return ReleaseRequest{};
  return std::nullopt;
}

}  // namespace tactus::viewer
