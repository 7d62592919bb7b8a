/// Tests the driver of Haply devices against a simulated service, with version 3.5 of the public protocol.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <functional>
#include <limits>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "haptics/plugin_device.hpp"

namespace tactus::haptics {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using Json = nlohmann::json;
using namespace std::chrono_literals;

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// A simulated service for one connection. It sends an inventory, and then an answer to each message.
class HaplyService {
 public:
  static constexpr const char* kInventory =
      R"({"session_id": 7, "inverse3": [{"device_id": "04A1", "config": {"type": "inverse3"}, "state": {}, "status": {}},
                                        {"device_id": "049D", "config": {"type": "inverse3"}, "state": {}, "status": {}}]})";

  static constexpr const char* kSilence = "silence";

  /// The answer to message `number`. An empty answer closes the connection, and kSilence sends nothing more.
  using Answer = std::function<std::string(std::size_t number)>;
  explicit HaplyService(Answer answer, std::string inventory = kInventory)
      : answer_{std::move(answer)}, inventory_{std::move(inventory)}, thread_{[this] { serve(); }} {}
  ~HaplyService() {
    beast::error_code ignored;
    acceptor_.close(ignored);
    if (!accepted_) asio::ip::tcp::socket{context_}.connect(endpoint_, ignored);  // wakes the accepting thread
    thread_.join();
  }

  [[nodiscard]] std::string address() const { return "127.0.0.1:" + std::to_string(endpoint_.port()); }
  [[nodiscard]] std::vector<Json> received() const {
    const std::lock_guard lock{mutex_};
    return received_;
  }
  /// Waits until `condition` holds for the received messages. Returns false after 10 s.
  [[nodiscard]] bool receives(const std::function<bool(const std::vector<Json>&)>& condition) const {
    for (const auto end = std::chrono::steady_clock::now() + 10s; std::chrono::steady_clock::now() < end;
         std::this_thread::sleep_for(1ms))  // poll, because the thread of the service signals no arrival
      if (condition(received())) return true;
    return false;
  }

  /// A state of both devices. The position x of the second device grows with `number`.
  static std::string state(std::size_t number) {
    Json message = Json::parse(kInventory);
    for (Json& device : message["inverse3"]) {
      device.erase("config");
      device["state"]["cursor_position"] = {{"x", 9}, {"y", 9}, {"z", 9}};
      device["state"]["cursor_velocity"] = {{"x", 0}, {"y", 0}, {"z", 0}};
    }
    Json& second = message["inverse3"][1]["state"];
    second["cursor_position"] = {{"x", 1e-6 * static_cast<double>(number)}, {"y", -0.12}, {"z", 0.15}};
    second["cursor_velocity"] = {{"x", 0.25}, {"y", 0}, {"z", 0}};
    return message.dump();
  }

 private:
  void serve() {
    beast::error_code error;
    asio::ip::tcp::socket socket{context_};
    acceptor_.accept(socket, error);
    accepted_ = true;
    if (error) return;
    beast::websocket::stream<asio::ip::tcp::socket> stream{std::move(socket)};
    stream.accept(error);
    stream.text(true);
    if (!error) stream.write(asio::buffer(inventory_), error);
    for (std::size_t number = 0; !error; ++number) {
      beast::flat_buffer buffer;
      stream.read(buffer, error);
      if (error) return;
      const std::string text = beast::buffers_to_string(buffer.data());
      {
        const std::lock_guard lock{mutex_};
        received_.push_back(Json::parse(text));
      }
      const std::string answer = answer_(number);
      if (answer.empty()) return;
      if (answer == kSilence) {
        stream.read(buffer, error);  // until the other side closes
        return;
      }
      stream.write(asio::buffer(answer), error);
    }
  }

  Answer answer_;
  std::string inventory_;
  asio::io_context context_;
  asio::ip::tcp::acceptor acceptor_{context_, {asio::ip::address_v4::loopback(), 0}};
  asio::ip::tcp::endpoint endpoint_ = acceptor_.local_endpoint();
  std::atomic<bool> accepted_{false};
  mutable std::mutex mutex_;
  std::vector<Json> received_;
  std::thread thread_;
};

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
