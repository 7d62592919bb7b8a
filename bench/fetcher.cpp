#include "bench/fetcher.hpp"

#include "session/periodic.hpp"

namespace tactus::bench {
namespace {

constexpr std::int64_t kHeartbeatPeriodNs = 100'000'000;
constexpr std::chrono::microseconds kMaxInboxWait{500};

}  // namespace

Fetcher::Fetcher(const wire::SessionAddress& address)
    : participants_{address},
      client_{participants_.origin(), {}},
      roster_out_{participants_, wire::topics::kRoster},
      demand_out_{participants_, wire::topics::kDemand},
      catalogue_{listen(wire::topics::kCatalogue)},
      roster_{listen(wire::topics::kRoster)},
      base_{listen(wire::topics::kBase, {wire::hrtc_partition(address.participant)})},
      records_{listen(wire::topics::kRecords, {wire::hrtc_partition(address.participant)})} {}

void Fetcher::receive(const session::CatalogueEntry& entry, std::int64_t) {
  client_.on_catalogue(entry);
  if (object_ != 0) return;
  object_ = entry.object_id;
  region_count_ = entry.summary.regions;
  client_.open(object_, entry.summary.digest);
}

void Fetcher::receive(const session::RosterEntry& entry, std::int64_t at_ns) {
  if (entry.role != session::Role::kHost) return;
  if (entry.leaving)
    client_.on_host_gone(entry.origin.participant);
  else
    client_.on_host_heartbeat(entry.origin.participant, entry.origin.incarnation, at_ns);
}

void Fetcher::receive(const session::BulkChunk& chunk, std::int64_t at_ns) {
  for (const session::DeliveryClient::Message& message : client_.on_chunk(chunk, at_ns)) receive(message, at_ns);
}

void Fetcher::receive(const session::DeliveryClient::Message& message, std::int64_t at_ns) {
  if (message.kind == session::BulkKind::kBase) {
    client_.answer_base_stored(message.object_id);
    ready_ = true;
    return;
  }
  client_.answer_stored(message.object_id, message.region);
  if (requested_ != message.region) return;
  if (times_ != nullptr) times_->add(static_cast<double>(at_ns - requested_ns_) / 1e6);
  received_ = std::exchange(requested_, std::nullopt);
}

void Fetcher::publish_heartbeat() {
  session::RosterEntry entry;
  entry.origin = participants_.origin();
  entry.role = session::Role::kHrtc;
  entry.name = participants_.address().participant;
  entry.session = participants_.address().session;
  entry.heartbeat = ++heartbeat_;
  (void)roster_out_.send(entry);
}

void Fetcher::request_next() {
  if (received_ && !client_.retire(object_, *received_))
    return;  // a region must be in a published demand before it retires
  received_.reset();
  requested_ = last_region_ = (last_region_ + 1) % region_count_;
  requested_ns_ = realtime::monotonic_ns();
  client_.set_wanted(object_, {{*requested_, 0}});
}

void Fetcher::run(std::int64_t until_ns, Samples* times) {
  times_ = times;
  session::PeriodicTimer heartbeat_timer{kHeartbeatPeriodNs};
  for (std::int64_t now; (now = realtime::monotonic_ns()) < until_ns && !realtime::stop_signal();) {
    for (auto& arrived : inbox_.take(kMaxInboxWait))
      std::visit([&](const auto& sample) { receive(sample, arrived.at_ns); }, arrived.sample);
    if (heartbeat_timer.due(now)) publish_heartbeat();
    if (times_ != nullptr && ready_ && !requested_) request_next();
    while (std::optional<session::Demand> demand = client_.demand(realtime::monotonic_ns()))
      (void)demand_out_.send(*demand);
    if (object_ != 0) (void)client_.take_released(object_);
  }
  times_ = nullptr;
}

void Fetcher::add_unanswered(Samples& times) const {
  if (times.empty())
    times.add(kUnfinished);
  else if (requested_)
    times.add(static_cast<double>(realtime::monotonic_ns() - requested_ns_) / 1e6);
}

}  // namespace tactus::bench
