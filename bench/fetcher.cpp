#include "bench/fetcher.hpp"

#include "session/periodic.hpp"

namespace tactus::bench {
namespace {

constexpr std::int64_t kBeatNs = 100'000'000;
constexpr std::chrono::microseconds kPatience{500};

}  // namespace

Fetcher::Fetcher(const wire::SessionAddress& address)
    : links_{address},
      client_{links_.origin(), {}},
      roster_out_{links_, wire::topics::kRoster},
      demand_out_{links_, wire::topics::kDemand},
      catalogue_{listen(wire::topics::kCatalogue)},
      roster_{listen(wire::topics::kRoster)},
      base_{listen(wire::topics::kBase, {wire::hrtc_partition(address.participant)})},
      records_{listen(wire::topics::kRecords, {wire::hrtc_partition(address.participant)})} {}

void Fetcher::take(const session::CatalogueEntry& entry, std::int64_t) {
  client_.offer(entry);
  if (object_ != 0) return;
  object_ = entry.object_id;
  regions_ = entry.summary.regions;
  client_.open(object_, entry.summary.digest);
}

void Fetcher::take(const session::RosterEntry& entry, std::int64_t at_ns) {
  if (entry.role != session::Role::kHost) return;
  if (entry.leaving)
    client_.host_gone(entry.origin.participant);
  else
    client_.host_seen(entry.origin.participant, entry.origin.incarnation, at_ns);
}

void Fetcher::take(const session::BulkChunk& chunk, std::int64_t at_ns) {
  for (const session::DeliveryClient::Message& message : client_.on_chunk(chunk, at_ns)) take(message, at_ns);
}

void Fetcher::take(const session::DeliveryClient::Message& message, std::int64_t at_ns) {
  if (message.kind == session::BulkKind::kBase) {
    client_.base_held(message.object_id);
    ready_ = true;
    return;
  }
  client_.held(message.object_id, message.region);
  if (wanted_ != message.region) return;
  if (times_ != nullptr) times_->add(static_cast<double>(at_ns - wanted_ns_) / 1e6);
  held_ = std::exchange(wanted_, std::nullopt);
}

void Fetcher::beat() {
  session::RosterEntry entry;
  entry.origin = links_.origin();
  entry.role = session::Role::kHrtc;
  entry.name = links_.address().participant;
  entry.session = links_.address().session;
  entry.heartbeat = ++heartbeat_;
  (void)roster_out_.send(entry);
}

void Fetcher::want_next() {
  if (held_ && !client_.retire(object_, *held_)) return;  // no demand has published it yet
  held_.reset();
  wanted_ = last_ = (last_ + 1) % regions_;
  wanted_ns_ = wire::monotonic_ns();
  client_.want(object_, {{*wanted_, 0}});
}

void Fetcher::run(std::int64_t until_ns, Samples* times) {
  times_ = times;
  session::Every beat_due{kBeatNs};
  for (std::int64_t now; (now = wire::monotonic_ns()) < until_ns && !wire::stop_signal();) {
    for (auto& arrived : inbox_.take(kPatience))
      std::visit([&](const auto& sample) { take(sample, arrived.at_ns); }, arrived.sample);
    if (beat_due.due(now)) beat();
    if (times_ != nullptr && ready_ && !wanted_) want_next();
    while (std::optional<session::Demand> demand = client_.demand(wire::monotonic_ns()))
      (void)demand_out_.send(*demand);
    if (object_ != 0) (void)client_.take_released(object_);
  }
  times_ = nullptr;
}

}  // namespace tactus::bench
