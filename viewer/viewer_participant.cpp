#include "viewer/viewer_participant.hpp"

#include <algorithm>
#include <map>
#include <utility>
#include <variant>
#include <vector>

#include "realtime/process.hpp"
#include "session/units.hpp"
#include "wire/endpoints.hpp"
#include "wire/error.hpp"
#include "wire/inbox.hpp"

namespace tactus::viewer {
namespace {

using realtime::monotonic_ns;

using Sample = std::variant<session::RosterEntry, session::CatalogueEntry, session::BulkChunk, session::ProbeState,
                            session::Metrics, session::ShownRegions, session::ObjectPose, session::EmergencyStop,
                            session::ForceReset, session::SessionEnd, session::ClockSample>;
using Inbox = wire::Inbox<Sample>;

constexpr std::int64_t kTickNs = 4 * kMs;
constexpr std::int64_t kLeaveNs = 100 * kMs;  // from the last leave message of a client to the end of its participant

wire::SessionAddress without_bulk_writers(wire::SessionAddress address) {
  address.only_reads_bulk = true;
  return address;
}

wire::SessionAddress address_of(wire::SessionAddress viewer, const std::string& client) {
  viewer.participant = client;
  return without_bulk_writers(std::move(viewer));
}

ViewerSettings named(ViewerSettings settings, const wire::SessionAddress& address) {
  settings.name = address.participant;
  settings.session = address.session;
  return settings;
}

/// The participant of a pointed user.
struct Client {
  Client(const wire::SessionAddress& viewer, const session::RosterEntry& entry)
      : participants{address_of(viewer, entry.name)},
        roster{participants, wire::topics::kRoster},
        intents{participants, wire::topics::kIntent, {wire::user_partition(entry.users.front())}} {}

  wire::Participants participants;
  wire::Writer<session::RosterEntry> roster;
  wire::Writer<session::Intent> intents;
  std::int64_t left_ns = 0;  // time of the newest leave message; 0: none
};

}  // namespace

struct ViewerParticipant::Impl {
  explicit Impl(const ParticipantOptions& options)
      : address{options.address},
        participants{without_bulk_writers(address)},
        core{participants.origin(), named(options.settings, address), monotonic_ns()},
        users{core, address.participant, address.session, options.source},
        roster_out{participants, wire::topics::kRoster},
        demand_out{participants, wire::topics::kDemand},
        clock_out{participants, wire::topics::kClock},
        stop_out{participants, wire::topics::kStop} {
    if (!participants.may_write(wire::topics::kIntent.name))
      users.no_users = "the keys of this viewer do not permit users; expected keys of tactus keys add-user";
    listen(wire::topics::kRoster);
    listen(wire::topics::kCatalogue);
    listen(wire::topics::kProbeState);
    listen(wire::topics::kMetrics);
    listen(wire::topics::kMetrics, {wire::kLossesPartition});
    listen(wire::topics::kObjectPose);
    listen(wire::topics::kStop);
    listen(wire::topics::kReset);
    listen(wire::topics::kEnd);
    listen(wire::topics::kClock);
  }

  template <class Typed>
  void listen(const wire::TopicSpec<Typed>& topic, const wire::EndpointOptions& endpoint = {}) {
    readers.push_back(std::make_shared<wire::Reader<Typed>>(
        participants, topic,
        [this](Typed&& sample) {
          inbox.put(std::move(sample), wire::kIsSentOnce<Typed> ? wire::Urgency::kMustArrive : wire::Urgency::kWaits);
        },
        endpoint));
  }

  void process(const session::RosterEntry& entry, std::int64_t at_ns) { core.on_roster(entry, at_ns); }
  void process(const session::CatalogueEntry& entry, std::int64_t) { core.on_catalogue(entry); }
  void process(const session::BulkChunk& chunk, std::int64_t at_ns) { core.on_chunk(chunk, at_ns); }
  void process(const session::ProbeState& state, std::int64_t at_ns) { core.on_probe_state(state, at_ns); }
  void process(const session::Metrics& metrics, std::int64_t at_ns) { core.on_metrics(metrics, at_ns); }
  void process(const session::ShownRegions& shown, std::int64_t at_ns) { core.on_shown_regions(shown, at_ns); }
  void process(const session::ObjectPose& pose, std::int64_t at_ns) { core.on_object_pose(pose, at_ns); }
  void process(const session::EmergencyStop& stop, std::int64_t at_ns) { core.on_stop(stop, at_ns); }
  void process(const session::ForceReset& reset, std::int64_t at_ns) { core.on_reset(reset, at_ns); }
  void process(const session::SessionEnd& end, std::int64_t at_ns) { core.on_end(end, at_ns); }
  void process(const session::ClockSample& sample, std::int64_t at_ns) { core.on_clock(sample, at_ns); }

  void send(ViewerMessages&& messages) {
    if (messages.stop) {
      messages.stop->origin = participants.origin();
      if (stop_out.send(*messages.stop) == wire::SendStatus::kInvalid)
        core.add_event(std::string{"the stop was not sent: "} + stop_out.invalid_reason(), monotonic_ns());
    }
    if (messages.roster) {
      messages.roster->origin = participants.origin();
      (void)roster_out.send(*messages.roster);
    }
    if (!loads_meshes) messages.demands.clear();
    for (session::Demand& demand : messages.demands) {
      demand.origin = participants.origin();
      (void)demand_out.send(demand);
    }
    if (messages.clock_request) {
      messages.clock_request->origin = participants.origin();
      (void)clock_out.send(*messages.clock_request);
    }
  }

  /// Returns the client of an entry, and makes its participant if it has none. Null: it leaves before it has joined, or
  /// it cannot join; then its source gets no probe.
  Client* client_of(const session::RosterEntry& entry) {
    std::unique_ptr<Client>& client = clients[entry.origin.participant];
    const bool joins_again = client && client->left_ns != 0 && !entry.leaving;
    if (client && !joins_again) return client.get();
    const std::uint64_t id = entry.origin.participant;
    if (entry.leaving) {
      clients.erase(id);
      return nullptr;
    }
    try {
      participants.expect_permitted(entry.users.front());
      client = std::make_unique<Client>(address, entry);
      return client.get();
    } catch (const wire::WireError& error) {
      clients.erase(id);
      users.refuse(id, error.what());
      return nullptr;
    }
  }

  void send(PointedUserMessages&& messages, std::int64_t now_ns) {
    for (session::RosterEntry& entry : messages.roster) {
      Client* const client = client_of(entry);
      if (client == nullptr) continue;
      entry.origin = client->participants.origin();
      (void)client->roster.send(entry);
      if (entry.leaving) client->left_ns = now_ns;
    }
    for (auto& [id, intent] : messages.intents) {
      const auto client = clients.find(id);
      if (client == clients.end()) continue;
      intent.origin = client->second->participants.origin();
      (void)client->second->intents.send(intent);
    }
    // The last leave message may still be in a queue.
    std::erase_if(clients, [&](const auto& client) {
      return client.second->left_ns != 0 && now_ns - client.second->left_ns > kLeaveNs;
    });
  }

  /// Adds an event for each discovery server that is gone or present again.
  void watch_servers(std::int64_t now_ns) {
    const std::vector<std::string> lost = participants.lost_servers();
    const auto is_in = [](const std::vector<std::string>& names, const std::string& name) {
      return std::find(names.begin(), names.end(), name) != names.end();
    };
    for (const std::string& name : lost)
      if (!is_in(lost_servers, name))
        core.add_event("discovery server '" + name + "' is gone: programs that start now are not found", now_ns);
    for (const std::string& name : lost_servers)
      if (!is_in(lost, name)) core.add_event("discovery server '" + name + "' is present again", now_ns);
    lost_servers = lost;
  }

  wire::SessionAddress address;
  wire::Participants participants;
  std::vector<std::string> lost_servers;
  ViewerCore core;
  PointedUsers users;
  bool loads_meshes = false;
  session::PeriodicTimer tick{kTickNs};
  std::map<std::uint64_t, std::unique_ptr<Client>> clients;  // by participant
  wire::Writer<session::RosterEntry> roster_out;
  wire::Writer<session::Demand> demand_out;
  wire::Writer<session::ClockSample> clock_out;
  wire::Writer<session::EmergencyStop> stop_out;
  Inbox inbox{1u << 15};
  std::vector<std::shared_ptr<void>> readers;  // last, so that callbacks end before other members are destroyed
};

ViewerParticipant::ViewerParticipant(const ParticipantOptions& options) : impl_{std::make_unique<Impl>(options)} {}
ViewerParticipant::~ViewerParticipant() = default;

ViewerCore& ViewerParticipant::core() noexcept { return impl_->core; }
PointedUsers& ViewerParticipant::users() noexcept { return impl_->users; }

void ViewerParticipant::load_meshes() {
  if (std::exchange(impl_->loads_meshes, true)) return;
  const wire::EndpointOptions own{wire::hrtc_partition(impl_->address.participant)};
  impl_->listen(wire::topics::kBase, own);
  impl_->listen(wire::topics::kRecords, own);
  impl_->listen(wire::topics::kShownRegions);
}

void ViewerParticipant::step(std::chrono::microseconds timeout) {
  for (const Inbox::Arrived& arrived : impl_->inbox.take(timeout))
    std::visit([&](const auto& sample) { impl_->process(sample, arrived.at_ns); }, arrived.sample);
  const std::int64_t now_ns = monotonic_ns();
  if (!impl_->tick.due(now_ns)) return;
  impl_->watch_servers(now_ns);
  impl_->send(impl_->core.tick(now_ns));
  impl_->send(impl_->users.tick(now_ns), now_ns);
}

void ViewerParticipant::leave() {
  impl_->users.release_all();
  wire::send_leave_messages([&] {
    impl_->send(impl_->users.tick(monotonic_ns()), monotonic_ns());
    session::RosterEntry entry = impl_->core.roster_entry(true, monotonic_ns());
    entry.origin = impl_->participants.origin();
    (void)impl_->roster_out.send(entry);
  });
}

}  // namespace tactus::viewer
