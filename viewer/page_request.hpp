/// What a page requests (docs/reference/viewer-frames.md). A page is not trusted: every request is checked here.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <variant>

#include "viewer/screen_refinement.hpp"

namespace tactus::viewer {

/// Number of a page; unique during the life of a server.
using PageId = std::uint64_t;

/// First request of a page that needs a token.
struct TokenRequest {
  std::string token;
};
/// The number of messages that the page has processed since it connected.
struct SeenRequest {
  std::uint64_t messages = 0;
};
/// All forces of the session stop.
struct StopRequest {
  std::string reason;
};
/// The page wants a probe, as a user with this name.
struct TouchRequest {
  std::string user;
  std::string hrtc;  ///< empty: any
};
/// New target of the hand of the page's user.
struct HandRequest {
  std::array<double, 3> target{};                 ///< m, world frame
  bool grabs = false;                             ///< the grab button is pressed
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< unit quaternion x, y, z, w; a page has none
};
/// The page gives its probe back.
struct ReleaseRequest {};

/// The viewer shows the meshes of one HRTC, to all pages.
struct ShowRequest {
  std::string hrtc;  ///< empty: of all
};

/// The page's view of the objects.
struct CameraRequest {
  Camera camera;
};
/// The playback of the recording continues or pauses, for all pages.
struct PlayRequest {
  bool plays = false;
};
/// The playback of the recording shows another time, for all pages.
struct SeekRequest {
  double seconds = 0;  ///< after the begin of the recording
};

using PageRequest = std::variant<TokenRequest, SeenRequest, StopRequest, TouchRequest, HandRequest, ReleaseRequest,
                                 ShowRequest, CameraRequest, PlayRequest, SeekRequest>;

/// Returns the request, or none if the text is no valid request.
[[nodiscard]] std::optional<PageRequest> parse_request(const std::string& text);

}  // namespace tactus::viewer
