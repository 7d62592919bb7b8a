/// The load of a latency test: mesh traffic during the pings.
///
/// With profile tactus, a MeshSource and a MeshSink exchange demands, base mesh and records as a host and an HRTC do,
/// pacer included. With the other profiles the source sends as many chunks as the writer accepts, up to the rate of the
/// test.
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

/// The host of one generated model, in a thread of normal priority.
class MeshSource final : public LoadSource {
 public:
  /// If `shared` is null, joins the session with participants of its own. Otherwise makes its endpoints in `shared`,
  /// which must outlive this.
  MeshSource(const TestCase& test, wire::SessionAddress address, wire::Participants* shared = nullptr);
  ~MeshSource() override;
  MeshSource(const MeshSource&) = delete;
  MeshSource& operator=(const MeshSource&) = delete;

  [[nodiscard]] bool matched() const noexcept override { return records_.matched() > 0; }
  void start() override;
  /// Bytes of payload sent so far.
  [[nodiscard]] std::uint64_t sent_bytes() const noexcept { return sent_bytes_; }

 private:
  void serve();
  void flood();

  const double mbit_;
  const bool is_flood_, is_tuned_;  // flood: chunks without demands, with any profile but tactus; tuned: profile tuned
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

/// The HRTC that receives from a MeshSource. Requests the regions of the model in turn until it is destroyed.
class MeshSink final : public LoadSink {
 public:
  /// If `burst_bytes` is 0, requests continuously. Otherwise requests regions of about `burst_bytes` at once, and the
  /// next ones 20 ms after the last of them has arrived.
  MeshSink(const TestCase& test, wire::SessionAddress address, std::size_t burst_bytes = 0,
           wire::Participants* shared = nullptr);
  ~MeshSink() override;
  MeshSink(const MeshSink&) = delete;
  MeshSink& operator=(const MeshSink&) = delete;

  /// Counts the bytes of complete messages with profile tactus, and of chunks with the other profiles.
  [[nodiscard]] double bytes_per_s() override;
  [[nodiscard]] std::uint64_t bytes() const noexcept { return bytes_; }
  struct Burst {
    double ms;            ///< from the request to the arrival of the last region
    std::int64_t end_ns;  ///< arrival of the last region, monotonic
    std::size_t bytes;
  };
  /// Returns the complete bursts since the last call.
  [[nodiscard]] std::vector<Burst> take_bursts();

 private:
  using Sample = std::variant<session::CatalogueEntry, session::BulkChunk>;
  void run();
  void on_sample(const session::CatalogueEntry& entry, std::int64_t at_ns);
  void on_sample(const session::BulkChunk& chunk, std::int64_t at_ns);
  void on_sample(const session::DeliveryClient::Message& message, std::int64_t at_ns);
  void count_message(std::size_t bytes, std::int64_t at_ns);
  void request_next_regions(std::int64_t now_ns);
  template <class T>
  [[nodiscard]] std::function<void(T&&)> into_inbox() {
    return [this](T&& sample) { inbox_.put(std::move(sample)); };
  }

  const double seconds_;         // duration of the test
  const std::size_t min_burst_;  // bytes
  const bool is_flood_;          // the source sends chunks without demands
  const std::unique_ptr<wire::Participants> own_participants_;
  wire::Participants& participants_;
  session::DeliveryClient client_;
  std::uint64_t host_ = 0, host_incarnation_ = 0;
  std::vector<std::uint32_t> absent_, wanted_;  // regions; the next to request is first
  std::vector<std::uint32_t> held_;             // regions; the oldest is first
  bool is_retiring_ = false;                    // begins at kMaxHeld held regions, ends at kMinHeld
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
