/// Tests the driver of Haply devices against a simulated service, with version 3.5 of the public protocol.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "haptics/plugin_device.hpp"
#include "tests/devices/haply_service.hpp"

namespace tactus::haptics {
namespace {

using Json = nlohmann::json;
using test_support::HaplyService;
using namespace std::chrono_literals;

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::string haply_open_error(const std::string& config) {
  try {
    const PluginDevice device{TACTUS_HAPLY, config};
  } catch (const DeviceError& error) {
    return error.what();
  }
  return "";
}

/// Reads and writes as a haptic thread does, until `condition` holds. Returns false after 10 s.
bool runs_until(PluginDevice& device, const Vec3d& force, const std::function<bool(const DeviceState&)>& condition) {
  for (const auto end = std::chrono::steady_clock::now() + 10s; std::chrono::steady_clock::now() < end;
       std::this_thread::sleep_for(1ms)) {  // period of a haptic thread
    const DeviceState state = device.read(now_ns());
    device.write(force);
    if (condition(state)) return true;
  }
  return false;
}

double force_of(const Json& message, const char* axis) {
  return message["inverse3"][0]["commands"]["set_cursor_force"]["vector"][axis];
}
bool is_zero(const Json& message) {
  return force_of(message, "x") == 0 && force_of(message, "y") == 0 && force_of(message, "z") == 0;
}

TEST(Haply, ExchangesPositionsAndForcesWithTheNamedDevice) {
  HaplyService service{HaplyService::state};
  {
    PluginDevice device{TACTUS_HAPLY, service.address() + "/049D"};
    EXPECT_LT(device.spec().max_force, 10);
    ASSERT_TRUE(service.receives([](const auto& all) { return !all.empty(); }));
    const std::int64_t start_ns = now_ns();
    ASSERT_TRUE(
        runs_until(device, {0.5, -1, 1.0 / 3}, [](const DeviceState& state) { return state.position.x() > 20e-6; }));
    const DeviceState state = device.read(now_ns());
    EXPECT_EQ(state.position.y(), -0.12);
    EXPECT_EQ(state.position.z(), 0.15);
    EXPECT_EQ(state.velocity.x(), 0.25);
    EXPECT_GE(state.time_ns, start_ns);
    EXPECT_LE(state.time_ns, now_ns());
    EXPECT_EQ(device.health(), DeviceHealth::kReady);
    EXPECT_TRUE(service.receives([](const auto& all) { return !all.empty() && force_of(all.back(), "x") == 0.5; }));
  }
  const std::vector<Json> received = service.received();
  EXPECT_EQ(received[0]["session"]["configure"]["profile"]["name"], "tactus:hrtc");
  EXPECT_TRUE(is_zero(received[0])) << "a force was sent before the first write";
  EXPECT_TRUE(is_zero(received.back())) << "the last message before the end has a force";
  const Json& forced = received[received.size() - 3];  // before the messages of the end
  EXPECT_EQ(forced, Json::parse(R"({"inverse3": [{"device_id": "049D", "commands": {"set_cursor_force": {"vector":
                                    {"x": 0.5, "y": -1.0, "z": 0.3333333333333333}}}}]})"));
}

TEST(Haply, UsesTheFirstDeviceIfNoneIsNamed) {
  HaplyService service{HaplyService::state};
  PluginDevice device{TACTUS_HAPLY, service.address()};
  EXPECT_TRUE(runs_until(device, Vec3d::Zero(), [](const DeviceState& state) { return state.position.x() == 9; }));
}

TEST(Haply, FindsAServiceAtLocalhost) {
  HaplyService service{HaplyService::state};
  const std::string address = service.address();
  const PluginDevice device{TACTUS_HAPLY, "localhost" + address.substr(address.find(':'))};
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
}

TEST(Haply, AnOpenErrorStatesTheFoundAndTheExpectedValue) {
  std::string unused_address;
  {
    HaplyService closed_service{HaplyService::state};
    EXPECT_THAT(haply_open_error(closed_service.address() + "/0000"),
                testing::HasSubstr("found Inverse3 04A1, 049D, expected 0000"));
    unused_address = closed_service.address();
  }
  EXPECT_THAT(haply_open_error(unused_address), testing::HasSubstr("refused; is the service running?"));
  // A look-up of a name could block longer than the time limit for the connection.
  for (const char* const config : {"nonsense", "tactus.invalid:10001", "127.0.0.1:http", "127.0.0.1:0"})
    EXPECT_THAT(haply_open_error(config),
                testing::HasSubstr("found '" + std::string{config} +
                                   "', expected HOST:PORT or HOST:PORT/DEVICE, HOST localhost or an IP address"));
  HaplyService empty{HaplyService::state, R"({"session_id": 1, "inverse3": []})"};
  EXPECT_THAT(haply_open_error(empty.address()), testing::HasSubstr("found no Inverse3, expected one"));
}

TEST(Haply, InvalidMessagesAreIgnored) {
  const std::vector<std::string> invalid_messages{
      "not JSON",
      "[]",
      "3",
      "null",
      "{}",
      R"({"inverse3": 5})",
      R"({"error": "what?"})",
      R"({"inverse3": [5, {"device_id": 4}, {"device_id": "049D"}]})",
      R"({"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": 1, "y": 1}}}]})",
      R"({"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": "1", "y": 1, "z": 1}, "cursor_velocity": {"x": 0, "y": 0, "z": 0}}}]})",
      R"({"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": 1e999, "y": 1, "z": 1}, "cursor_velocity": {"x": 0, "y": 0, "z": 0}}}]})",
      R"({"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": null, "y": 1, "z": 1}, "cursor_velocity": {"x": 0, "y": 0, "z": 0}}}]})",
      std::string(5000, '['),
      std::string("{\"inverse3\":\0", 13)};
  // From answer 20 on, each 20 answers begin with all invalid messages, and valid states follow.
  const auto answer = [&](std::size_t number) {
    return number % 20 < invalid_messages.size() && number >= 20 ? invalid_messages[number % 20]
                                                                 : HaplyService::state(number);
  };
  HaplyService service{answer};
  PluginDevice device{TACTUS_HAPLY, service.address() + "/049D"};
  double max_coordinate = 0;
  EXPECT_TRUE(runs_until(device, {0, 0, 1}, [&](const DeviceState& state) {
    max_coordinate = std::max(max_coordinate, state.position.cwiseAbs().maxCoeff());
    return state.position.x() > 100e-6;
  }));
  EXPECT_LE(max_coordinate, 0.15) << "a position of an invalid message was used";
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
}

TEST(Haply, ManyConsecutiveInvalidMessagesAreAFailure) {
  HaplyService service{
      [](std::size_t number) { return number < 5 ? HaplyService::state(number) : std::string{"nonsense"}; }};
  PluginDevice device{TACTUS_HAPLY, service.address() + "/049D"};
  EXPECT_TRUE(runs_until(device, Vec3d::Zero(), [&](const auto&) { return device.health() == DeviceHealth::kFailed; }));
}

TEST(Haply, AClosedConnectionIsAFailure) {
  HaplyService service{[](std::size_t number) { return number < 30 ? HaplyService::state(number) : std::string{}; }};
  PluginDevice device{TACTUS_HAPLY, service.address() + "/049D"};
  EXPECT_TRUE(runs_until(device, {1, 0, 0}, [&](const auto&) { return device.health() == DeviceHealth::kFailed; }));
  const std::int64_t last_ns = device.read(now_ns()).time_ns;
  EXPECT_EQ(device.read(now_ns() + 1'000'000).time_ns, last_ns) << "a failed device returned a new pose time";
}

TEST(Haply, ASilentServiceIsAFailureAfterASecond) {
  HaplyService service{[](std::size_t number) {
    return number < 30 ? HaplyService::state(number) : std::string{HaplyService::kSilence};
  }};
  PluginDevice device{TACTUS_HAPLY, service.address() + "/049D"};
  const std::int64_t start_ns = now_ns();
  EXPECT_TRUE(runs_until(device, {1, 0, 0}, [&](const auto&) { return device.health() == DeviceHealth::kFailed; }));
  EXPECT_GT(now_ns() - start_ns, 900'000'000) << "the device failed after less than 0.9 s of silence";
}

TEST(Haply, AnUnpluggedDeviceIsAFailure) {
  HaplyService service{[](std::size_t number) {
    return number < 30 ? HaplyService::state(number) : R"({"inverse3": [{"device_id": "04A1", "state": {}}]})";
  }};
  PluginDevice device{TACTUS_HAPLY, service.address() + "/049D"};
  EXPECT_TRUE(runs_until(device, {1, 0, 0}, [&](const auto&) { return device.health() == DeviceHealth::kFailed; }));
}

TEST(Haply, AForceThatIsNotWrittenAgainIsReplacedByZero) {
  HaplyService service{HaplyService::state};
  PluginDevice device{TACTUS_HAPLY, service.address() + "/049D"};
  device.write({2, 0, 0});
  ASSERT_TRUE(service.receives([](const auto& all) { return !all.empty() && force_of(all.back(), "x") == 2; }));
  EXPECT_TRUE(service.receives([](const auto& all) { return is_zero(all.back()); }));
}

}  // namespace
}  // namespace tactus::haptics
