#include "viewer/page_request.hpp"

#include <gtest/gtest.h>

namespace tactus::viewer {
namespace {

TEST(PageRequestTest, ReadsEachKind) {
  EXPECT_EQ(std::get<TokenRequest>(parse_request(R"({"token": "0a"})").value()).token, "0a");
  EXPECT_EQ(std::get<SeenRequest>(parse_request(R"({"seen": 8})").value()).messages, 8u);
  EXPECT_EQ(std::get<StopRequest>(parse_request(R"({"stop": "a reason"})").value()).reason, "a reason");
  const auto touch = std::get<TouchRequest>(parse_request(R"({"touch": {"user": "guest", "hrtc": "desk"}})").value());
  EXPECT_EQ(touch.user, "guest");
  EXPECT_EQ(touch.hrtc, "desk");
  EXPECT_EQ(std::get<TouchRequest>(parse_request(R"({"touch": {"user": "guest"}})").value()).hrtc, "");
  const auto hand = std::get<HandRequest>(parse_request(R"({"hand": {"target": [0.5, -1, 2], "grab": true}})").value());
  EXPECT_EQ(hand.target, (std::array<double, 3>{0.5, -1, 2}));
  EXPECT_TRUE(hand.grabs);
  EXPECT_EQ(std::get<ShowRequest>(parse_request(R"({"show": "desk"})").value()).hrtc, "desk");
  const Camera camera =
      std::get<CameraRequest>(
          parse_request(
              R"({"camera": {"position": [1, 2, 3], "direction": [0, 0, -1], "halfAngle": 0.5, "pixel": 0.001}})")
              .value())
          .camera;
  EXPECT_EQ(camera.position, (spm::Vec3d{1, 2, 3}));
  EXPECT_EQ(camera.direction, (spm::Vec3d{0, 0, -1}));
  EXPECT_EQ(camera.half_angle, 0.5);
  EXPECT_EQ(camera.pixel, 0.001);
  EXPECT_TRUE(std::get<PlayRequest>(parse_request(R"({"play": true})").value()).plays);
  EXPECT_EQ(std::get<SeekRequest>(parse_request(R"({"seek": 12.5})").value()).seconds, 12.5);
  EXPECT_TRUE(std::holds_alternative<ReleaseRequest>(parse_request(R"({"release": true})").value()));
}

class InvalidRequest : public testing::TestWithParam<const char*> {};

TEST_P(InvalidRequest, IsRefused) { EXPECT_FALSE(parse_request(GetParam()).has_value()); }

INSTANTIATE_TEST_SUITE_P(
    PageRequestTest, InvalidRequest,
    testing::Values("", "garbage", "[]", "{}", "null", R"({"jump": 1})", R"({"stop": ""})", R"({"stop": 1})",
                    R"({"stop": "a\u0007b"})", R"({"stop": "a", "touch": {"user": "b"}})", R"({"touch": "guest"})",
                    R"({"touch": {}})", R"({"touch": {"user": ""}})", R"({"touch": {"user": "a/b"}})",
                    R"({"touch": {"user": "a*"}})", R"({"touch": {"user": "guest", "hrtc": 1}})",
                    R"({"touch": {"user": "guest", "at": "desk"}})",
                    R"({"touch": {"user": "123456789012345678901234567890123"}})", R"({"hand": [0, 0, 0]})",
                    R"({"hand": {"target": [0, 0], "grab": true}})",
                    R"({"hand": {"target": [0, 0, "1"], "grab": true}})",
                    R"({"hand": {"target": [0, 0, 1e300], "grab": true}})",
                    R"({"hand": {"target": [0, 0, 0], "grab": 1}})", R"({"hand": {"target": [0, 0, 0]}})",
                    R"({"token": 5})", R"({"release": 1})", R"({"play": 1})", R"({"seek": -1})", R"({"seek": 1e300})",
                    R"({"seek": "1"})", R"({"camera": {}})",
                    R"({"camera": {"position": [0, 0, 0], "direction": [0, 0, 2],
                                             "halfAngle": 1, "pixel": 0.001}})",
                    R"({"camera": {"position": [0, 0, 0], "direction": [0, 0, 1],
                                             "halfAngle": 1, "pixel": 0}})"));

}  // namespace
}  // namespace tactus::viewer
