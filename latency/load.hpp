/// Mesh records beside the pings: the bulk stream of a host to an HRTC, with the same ends, profiles and chunk size.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <thread>

#include "latency/cell.hpp"
#include "wire/ends.hpp"

namespace tactus::latency {

/// Sends full chunks at cell.load_mbit until it is destroyed; joins the session by itself. A thread of usual priority.
class Load {
 public:
  Load(const Cell& cell, wire::SessionAddress address);
  ~Load();
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;

  [[nodiscard]] bool matched() const noexcept { return writer_->matched() > 0; }
  /// Once, after matched().
  void start();

 private:
  void run();

  const double mbit_;
  std::unique_ptr<wire::Links> links_;
  std::unique_ptr<wire::Writer<session::BulkChunk>> writer_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// Counts what a Load sends.
class Sink {
 public:
  Sink(const Cell& cell, wire::SessionAddress address);
  /// Payload between the first and the last chunk, by the time between them; 0 with fewer than two.
  [[nodiscard]] double bytes_per_s() const noexcept;

 private:
  std::unique_ptr<wire::Links> links_;
  std::atomic<std::uint64_t> bytes_{0};
  std::atomic<std::int64_t> first_ns_{0}, last_ns_{0};
  std::unique_ptr<wire::Reader<session::BulkChunk>> reader_;
};

}  // namespace tactus::latency
