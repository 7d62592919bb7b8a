#include "bench/base_mesh_host.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include "realtime/process.hpp"
#include "session/units.hpp"

namespace tactus::bench {
namespace {

constexpr std::int64_t kHeartbeatNs = 50 * kMs;
constexpr std::int64_t kMaxWaitNs = 1 * kMs;
constexpr int kChunksPerRound = 64;

}  // namespace

BaseMeshHost::BaseMeshHost(const wire::SessionAddress& address, const std::string& hrtc,
                           const spm::codec::CompressedModel& model)
    : model_{model},
      participants_{address},
      catalogue_{participants_, wire::topics::kCatalogue},
      roster_{participants_, wire::topics::kRoster},
      base_{participants_, wire::topics::kBase, {wire::hrtc_partition(hrtc)}},
      reader_{participants_, wire::topics::kDemand,
              [this](session::Demand&& demand) { demands_.put(std::move(demand)); }},
      thread_{[this] { serve(); }} {}

BaseMeshHost::~BaseMeshHost() {
  stop_ = true;
  thread_.join();
  withdraw_offered();
  send_roster_entry(true);
}

void BaseMeshHost::offer() {
  const std::lock_guard lock{mutex_};
  withdraw_offered();
  entry_ = {};
  entry_.origin = participants_.origin();
  entry_.host = participants_.address().participant;
  entry_.object = "base-" + std::to_string(++offers_);
  entry_.object_id = session::id_of(entry_.object);
  entry_.summary = model_.summary();
  entry_.pose.position = {100, 0, 0};  // out of the reach of the tips
  // A new server for each offer, because a server cannot remove an object.
  server_.emplace(participants_.origin(), participants_.chunk_bytes());
  server_->add(entry_.object_id, model_);
  entry_.base_bytes = server_->base_bytes(entry_.object_id);
  sent_ns_ = decoded_ns_ = 0;
  (void)catalogue_.send(entry_);
}

void BaseMeshHost::withdraw() {
  const std::lock_guard lock{mutex_};
  withdraw_offered();
}

void BaseMeshHost::withdraw_offered() {
  if (!server_) return;
  entry_.origin = participants_.origin();
  entry_.withdrawn = true;
  (void)catalogue_.send(entry_);
  server_.reset();
}

void BaseMeshHost::send_roster_entry(bool leaving) {
  session::RosterEntry entry;
  entry.origin = participants_.origin();
  entry.role = session::Role::kHost;
  entry.name = participants_.address().participant;
  entry.session = participants_.address().session;
  entry.heartbeat = ++beats_;
  entry.leaving = leaving;
  (void)roster_.send(entry);
}

void BaseMeshHost::serve() {
  std::int64_t beat_ns = 0, wait_ns = 0;
  while (!stop_) {
    const auto arrived = demands_.take(std::chrono::microseconds{wait_ns / kUs});
    const std::lock_guard lock{mutex_};
    wait_ns = kMaxWaitNs;
    if (realtime::monotonic_ns() >= beat_ns) {
      beat_ns = realtime::monotonic_ns() + kHeartbeatNs;
      send_roster_entry(false);
    }
    if (!server_) continue;
    for (const auto& [at_ns, demand] : arrived) {
      (void)server_->on_demand(demand, at_ns);
      if (demand.object_id == entry_.object_id && !demand.need_base && decoded_ns_ == 0) decoded_ns_ = at_ns;
    }
    for (int i = 0; i < kChunksPerRound; ++i) {
      const auto out = server_->next(realtime::monotonic_ns());
      if (!out) break;
      (void)base_.send(out->chunk);
      if (sent_ns_ == 0 && server_->counters().bases > 0) sent_ns_ = realtime::monotonic_ns();
      if (i + 1 == kChunksPerRound) wait_ns = 0;
    }
    if (wait_ns > 0) wait_ns = std::clamp<std::int64_t>(server_->due_ns() - realtime::monotonic_ns(), 0, kMaxWaitNs);
  }
}

}  // namespace tactus::bench
