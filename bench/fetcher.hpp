/// An HRTC without pool and cycle, which requests one region after another and measures the time of each delivery.
///
/// One thread uses it; callbacks of DDS run in other threads.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <variant>

#include "bench/figures.hpp"
#include "session/delivery_client.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"
#include "wire/participants.hpp"

namespace tactus::bench {

class Fetcher {
 public:
  /// Joins the session as the HRTC `address.participant`. Requests regions of the first object in the catalogue.
  explicit Fetcher(const wire::SessionAddress& address);

  /// Takes part in the session until `until_ns` (monotonic) or realtime::stop_signal. If `times` is not null, also requests
  /// regions, one at a time, and adds to `times` the ms from each request to the complete region. Retires a region
  /// before it requests the next.
  void run(std::int64_t until_ns, Samples* times);

  /// Adds to `times` the time in ms since the request that is not answered yet, or kUnfinished if `times` is empty.
  /// Call it after the last `run` of a window, so that a request that is never answered counts.
  void add_unanswered(Samples& times) const;

  /// Returns whether the base mesh has arrived.
  [[nodiscard]] bool ready() const noexcept { return ready_; }

 private:
  using Sample = std::variant<session::CatalogueEntry, session::RosterEntry, session::BulkChunk>;
  template <class T>
  wire::Reader<T> listen(const wire::TopicSpec<T>& topic, const wire::EndpointOptions& options = {}) {
    return {participants_, topic, [this](T&& sample) { inbox_.put(std::move(sample)); }, options};
  }
  void receive(const session::CatalogueEntry& entry, std::int64_t at_ns);
  void receive(const session::RosterEntry& entry, std::int64_t at_ns);
  void receive(const session::BulkChunk& chunk, std::int64_t at_ns);
  void receive(const session::DeliveryClient::Message& message, std::int64_t at_ns);
  void publish_heartbeat();
  void request_next();

  wire::Participants participants_;
  session::DeliveryClient client_;
  wire::Writer<session::RosterEntry> roster_out_;
  wire::Writer<session::Demand> demand_out_;
  std::uint64_t heartbeat_ = 0;
  std::uint64_t object_ = 0;
  std::uint32_t region_count_ = 0;
  std::optional<std::uint32_t> requested_;
  std::uint32_t last_region_ = 0;
  std::int64_t requested_ns_ = 0;
  std::optional<std::uint32_t> received_;
  bool ready_ = false;
  Samples* times_ = nullptr;
  wire::Inbox<Sample> inbox_{1 << 16};
  wire::Reader<session::CatalogueEntry> catalogue_;
  wire::Reader<session::RosterEntry> roster_;
  wire::Reader<session::BulkChunk> base_, records_;
};

}  // namespace tactus::bench
