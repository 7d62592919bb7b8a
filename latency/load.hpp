/// Mesh traffic beside the pings: demand, delivery, pacer and topics as in host and HRTC. With other profiles it sends
/// as many chunks as a writer with the library's defaults accepts.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <variant>
#include <vector>

#include "latency/carrier.hpp"
#include "session/delivery_client.hpp"
#include "session/delivery_server.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace tactus::latency {

/// A host of one generated model, in a thread of normal priority; joins the session on its own.
class Load final : public LoadSource {
 public:
  /// With Profile::kShared its endpoints are in `shared`, which must outlive it.
  Load(const Cell& cell, wire::SessionAddress address, wire::Participants* shared = nullptr);
  ~Load() override;
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;

  [[nodiscard]] bool matched() const noexcept override { return records_.matched() > 0; }
  void start() override;
  /// Bytes of payload sent so far.
  [[nodiscard]] std::uint64_t sent_bytes() const noexcept { return sent_bytes_; }

 private:
  void serve();
  void flood();

  const double mbit_;
  const bool plain_, tuned_;
  const std::unique_ptr<wire::Participants> own_participants_;
  wire::Participants& participants_;
  wire::Writer<session::CatalogueEntry> catalogue_;
  wire::Writer<session::BulkChunk> base_, records_;
  wire::Inbox<session::Demand> demands_{1024};
  wire::Reader<session::Demand> reader_;
  std::atomic<std::uint64_t> sent_bytes_{0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// The HRTC for that load: requests the regions of the model in turn, without end.
class Sink final : public LoadSink {
 public:
  /// `burst_bytes` 0: requests continuously. Otherwise requests about so many bytes at once, and again when they have
  /// arrived.
  Sink(const Cell& cell, wire::SessionAddress address, std::size_t burst_bytes = 0,
       wire::Participants* shared = nullptr);
  ~Sink() override;
  Sink(const Sink&) = delete;
  Sink& operator=(const Sink&) = delete;

  /// Counts complete messages.
  [[nodiscard]] double bytes_per_s() override;
  [[nodiscard]] std::uint64_t bytes() const noexcept { return bytes_; }
  struct Burst {
    double ms;
    std::size_t bytes;
  };
  /// Bursts since the last call; each lasts from the request to the last region.
  [[nodiscard]] std::vector<Burst> take_bursts();

 private:
  using Sample = std::variant<session::CatalogueEntry, session::BulkChunk>;
  void run();
  void take(const session::CatalogueEntry& entry, std::int64_t at_ns);
  void take(const session::BulkChunk& chunk, std::int64_t at_ns);
  void take(const session::DeliveryClient::Message& message, std::int64_t at_ns);
  void count_message(std::size_t bytes, std::int64_t at_ns);
  void request_next_regions(std::int64_t now_ns);
  template <class T>
  [[nodiscard]] std::function<void(T&&)> into_inbox() {
    return [this](T&& sample) { inbox_.put(std::move(sample)); };
  }

  const std::size_t min_burst_;  // bytes
  const bool plain_;
  const std::unique_ptr<wire::Participants> own_participants_;
  wire::Participants& participants_;
  session::DeliveryClient client_;
  std::uint64_t host_ = 0, host_incarnation_ = 0;
  std::vector<std::uint32_t> absent_, wanted_;  // regions, next one first
  std::vector<std::uint32_t> held_;             // oldest first
  bool retiring_ = false;                       // evicting; many at a time, as a cache does
  std::uint32_t regions_ = 0;
  std::int64_t burst_ns_ = 0, pause_until_ns_ = 0;
  std::size_t burst_bytes_ = 0, burst_regions_ = 8;
  std::mutex mutex_;
  std::vector<Burst> bursts_;
  std::atomic<std::uint64_t> bytes_{0};
  std::atomic<std::int64_t> first_ns_{0}, last_ns_{0};
  std::atomic<bool> stop_{false};
  wire::Writer<session::Demand> demand_;
  wire::Inbox<Sample> inbox_{8192};
  wire::Reader<session::CatalogueEntry> catalogue_;
  wire::Reader<session::BulkChunk> base_, records_;
  std::thread thread_;
};

}  // namespace tactus::latency
