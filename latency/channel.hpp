/// What the two sides of a test say to each other: lines of JSON and blocks of bytes over one stream socket.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace tactus::latency {

/// Owns the socket. One thread at a time. Every function throws LatencyError when the other side is gone, says
/// something else than was expected, or `stop` is set while it waits.
class Channel {
 public:
  /// `stop` must outlive this.
  Channel(int socket, const std::atomic<bool>& stop) noexcept;
  ~Channel();
  Channel(const Channel&) = delete;
  Channel& operator=(const Channel&) = delete;

  void send(const nlohmann::ordered_json& message);
  /// The next line, of 64 KiB at most. A message with a member "error" is thrown as a LatencyError with its text.
  [[nodiscard]] nlohmann::ordered_json receive(std::chrono::milliseconds patience);
  /// Whether anything comes before the other side closes; without limit of time.
  [[nodiscard]] bool wait();

  void send_block(const void* data, std::size_t bytes);
  void receive_block(void* data, std::size_t bytes, std::chrono::milliseconds patience);

 private:
  void fill(std::chrono::milliseconds patience);

  int socket_;
  const std::atomic<bool>& stop_;
  std::string received_;  // and not taken yet
};

/// A socket that listens at `port` of all interfaces, 0: at one that is free. Throws LatencyError.
[[nodiscard]] int listen_at(std::uint16_t port);
/// The port of such a socket, which the system chose if 0 was asked for.
[[nodiscard]] std::uint16_t port_of(int listener);
/// The next one who connects; -1 when `stop` was set first.
[[nodiscard]] int accept_from(int listener, const std::atomic<bool>& stop);
/// Throws LatencyError naming host and port.
[[nodiscard]] int connect_to(const std::string& host, std::uint16_t port);

}  // namespace tactus::latency
