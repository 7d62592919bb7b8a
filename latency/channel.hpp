/// Control connection of the two sides of a test: lines of JSON and blocks of bytes over a stream socket.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace tactus::latency {

/// Owns the socket. One thread at a time. Every function throws LatencyError when the other side closes, sends
/// something unexpected, or `stop` is set during a wait.
class Channel {
 public:
  /// `stop` must outlive this.
  Channel(int socket, const std::atomic<bool>& stop) noexcept;
  ~Channel();
  Channel(const Channel&) = delete;
  Channel& operator=(const Channel&) = delete;

  void send(const nlohmann::ordered_json& message);
  /// The next line, at most 64 KiB. A message with a member "error" is thrown as a LatencyError with its text.
  [[nodiscard]] nlohmann::ordered_json receive(std::chrono::milliseconds patience);
  /// Waits for data without a time limit; false when the other side closes.
  [[nodiscard]] bool wait();

  void send_block(const void* data, std::size_t bytes);
  void receive_block(void* data, std::size_t bytes, std::chrono::milliseconds patience);

 private:
  void fill(std::chrono::milliseconds patience);

  int socket_;
  const std::atomic<bool>& stop_;
  std::string received_;  // not yet consumed
};

/// A socket that listens on `port` of all interfaces; 0: a free port. Throws LatencyError.
[[nodiscard]] int listen_at(std::uint16_t port);
/// The port of such a socket.
[[nodiscard]] std::uint16_t port_of(int listener);
/// The next incoming connection; -1 when `stop` was set first.
[[nodiscard]] int accept_from(int listener, const std::atomic<bool>& stop);
/// Connects. Throws LatencyError naming host and port.
[[nodiscard]] int connect_to(const std::string& host, std::uint16_t port);

}  // namespace tactus::latency
