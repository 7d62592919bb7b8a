/// A simulated Haply Inverse Service, version 3.5 of the public protocol, for tests without a device.
#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cstddef>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace tactus::test_support {

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
    boost::beast::error_code ignored;
    acceptor_.close(ignored);
    if (!accepted_) boost::asio::ip::tcp::socket{context_}.connect(endpoint_, ignored);  // wakes the accepting thread
    thread_.join();
  }

  [[nodiscard]] std::string address() const { return "127.0.0.1:" + std::to_string(endpoint_.port()); }
  [[nodiscard]] std::vector<nlohmann::json> received() const {
    const std::lock_guard lock{mutex_};
    return received_;
  }
  /// Waits until `condition` holds for the received messages. Returns false after 10 s.
  [[nodiscard]] bool receives(const std::function<bool(const std::vector<nlohmann::json>&)>& condition) const {
    constexpr std::chrono::seconds kLimit{10};
    constexpr std::chrono::milliseconds kPoll{1};  // the thread of the service signals no arrival
    for (const auto end = std::chrono::steady_clock::now() + kLimit; std::chrono::steady_clock::now() < end;
         std::this_thread::sleep_for(kPoll))
      if (condition(received())) return true;
    return false;
  }

  /// A state of both devices. The position x of the second device grows with `number`.
  static std::string state(std::size_t number) {
    nlohmann::json message = nlohmann::json::parse(kInventory);
    for (nlohmann::json& device : message["inverse3"]) {
      device.erase("config");
      device["state"]["cursor_position"] = {{"x", 9}, {"y", 9}, {"z", 9}};
      device["state"]["cursor_velocity"] = {{"x", 0}, {"y", 0}, {"z", 0}};
    }
    nlohmann::json& second = message["inverse3"][1]["state"];
    second["cursor_position"] = {{"x", 1e-6 * static_cast<double>(number)}, {"y", -0.12}, {"z", 0.15}};
    second["cursor_velocity"] = {{"x", 0.25}, {"y", 0}, {"z", 0}};
    return message.dump();
  }

 private:
  void serve() {
    boost::beast::error_code error;
    boost::asio::ip::tcp::socket socket{context_};
    acceptor_.accept(socket, error);
    accepted_ = true;
    if (error) return;
    boost::beast::websocket::stream<boost::asio::ip::tcp::socket> stream{std::move(socket)};
    stream.accept(error);
    stream.text(true);
    if (!error) stream.write(boost::asio::buffer(inventory_), error);
    for (std::size_t number = 0; !error; ++number) {
      boost::beast::flat_buffer buffer;
      stream.read(buffer, error);
      if (error) return;
      const std::string text = boost::beast::buffers_to_string(buffer.data());
      {
        const std::lock_guard lock{mutex_};
        received_.push_back(nlohmann::json::parse(text));
      }
      const std::string answer = answer_(number);
      if (answer.empty()) return;
      if (answer == kSilence) {
        stream.read(buffer, error);  // until the other side closes
        return;
      }
      stream.write(boost::asio::buffer(answer), error);
    }
  }

  Answer answer_;
  std::string inventory_;
  boost::asio::io_context context_;
  boost::asio::ip::tcp::acceptor acceptor_{context_, {boost::asio::ip::address_v4::loopback(), 0}};
  boost::asio::ip::tcp::endpoint endpoint_ = acceptor_.local_endpoint();
  std::atomic<bool> accepted_{false};
  mutable std::mutex mutex_;
  std::vector<nlohmann::json> received_;
  std::thread thread_;
};

}  // namespace tactus::test_support
