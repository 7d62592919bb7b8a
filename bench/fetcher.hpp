/// The smallest HRTC there is: it asks a host for one region after the other and says how long each took. No cycle, no
/// pool; what benchmarks of delivery watch a real host with.
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
  /// Joins the session as an HRTC of `address.participant`. It touches the first object that a host offers.
  explicit Fetcher(const wire::SessionAddress& address);

  /// Takes part until `until_ns`, monotonic, or until `*stop`. With `times` it also fetches, one region at a time, and
  /// adds ms from wanting a region to having all of it. A region is given back when the next is wanted.
  void run(std::int64_t until_ns, Samples* times);

  /// The base mesh is here.
  [[nodiscard]] bool ready() const noexcept { return ready_; }

 private:
  using Sample = std::variant<session::CatalogueEntry, session::RosterEntry, session::BulkChunk>;
  template <class T>
  wire::Reader<T> listen(const wire::TopicSpec<T>& topic, const wire::EndpointOptions& options = {}) {
    return {links_, topic, [this](T&& sample) { inbox_.put(std::move(sample)); }, options};
  }
  void take(const session::CatalogueEntry& entry, std::int64_t at_ns);
  void take(const session::RosterEntry& entry, std::int64_t at_ns);
  void take(const session::BulkChunk& chunk, std::int64_t at_ns);
  void take(const session::DeliveryClient::Message& message, std::int64_t at_ns);
  void beat();
  void want_next();

  wire::Participants links_;
  session::DeliveryClient client_;
  wire::Writer<session::RosterEntry> roster_out_;
  wire::Writer<session::Demand> demand_out_;
  std::uint64_t heartbeat_ = 0;
  std::uint64_t object_ = 0;
  std::uint32_t regions_ = 0;
  std::optional<std::uint32_t> wanted_;
  std::uint32_t last_ = 0;
  std::int64_t wanted_ns_ = 0;
  std::optional<std::uint32_t> held_;
  bool ready_ = false;
  Samples* times_ = nullptr;
  wire::Inbox<Sample> inbox_{1 << 16};
  wire::Reader<session::CatalogueEntry> catalogue_;
  wire::Reader<session::RosterEntry> roster_;
  wire::Reader<session::BulkChunk> base_, records_;
};

}  // namespace tactus::bench
