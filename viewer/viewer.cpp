#include "viewer/viewer.hpp"

#include <chrono>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"
#include "wire/process.hpp"

namespace tactus::viewer {
namespace {

using wire::monotonic_ns;

using Sample = std::variant<session::RosterEntry, session::CatalogueEntry, session::BulkChunk, session::ProbeState,
                            session::Metrics, session::ObjectPose, session::EmergencyStop, session::ForceReset,
                            session::SessionEnd, session::ClockSample>;
using Inbox = wire::Inbox<Sample>;

constexpr std::chrono::milliseconds kTick{2};

wire::SessionAddress without_bulk_writers(wire::SessionAddress address) {
  address.only_reads_bulk = true;
  return address;
}

}  // namespace

struct Viewer::Impl {
  explicit Impl(ViewerOptions given)
      : options{std::move(given)},
        participants{without_bulk_writers(options.address)},
        core{participants.origin(),
             {options.address.participant, options.address.session, options.pool},
             monotonic_ns()},
        server{options.server, core},
        roster_out{participants, wire::topics::kRoster},
        demand_out{participants, wire::topics::kDemand},
        clock_out{participants, wire::topics::kClock},
        stop_out{participants, wire::topics::kStop} {
    core.on_event = options.log;
    server.on_stop_request = [this](const std::string& reason) { core.stop_forces(reason, monotonic_ns()); };
    server.on_event = [this](const std::string& text) { core.add_event(text, monotonic_ns()); };
    listen(wire::topics::kRoster);
    listen(wire::topics::kCatalogue);
    listen(wire::topics::kProbeState);
    listen(wire::topics::kMetrics);
    listen(wire::topics::kObjectPose);
    listen(wire::topics::kStop);
    listen(wire::topics::kReset);
    listen(wire::topics::kEnd);
    listen(wire::topics::kClock);
    const wire::EndpointOptions own{wire::hrtc_partition(options.address.participant)};
    listen(wire::topics::kBase, own);
    listen(wire::topics::kRecords, own);
  }

  template <class Typed>
  void listen(const wire::TopicSpec<Typed>& topic, const wire::EndpointOptions& endpoint = {}) {
    readers.push_back(std::make_shared<wire::Reader<Typed>>(
        participants, topic, [this](Typed&& sample) { inbox.put(std::move(sample), wire::Urgency::kWaits); },
        endpoint));
  }

  void process(const session::RosterEntry& entry, std::int64_t at_ns) { core.on_roster(entry, at_ns); }
  void process(const session::CatalogueEntry& entry, std::int64_t) { core.on_catalogue(entry); }
  void process(const session::BulkChunk& chunk, std::int64_t at_ns) { core.on_chunk(chunk, at_ns); }
  void process(const session::ProbeState& state, std::int64_t at_ns) { core.on_probe_state(state, at_ns); }
  void process(const session::Metrics& metrics, std::int64_t) { core.on_metrics(metrics); }
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
    for (session::Demand& demand : messages.demands) {
      demand.origin = participants.origin();
      (void)demand_out.send(demand);
    }
    if (messages.clock_request) {
      messages.clock_request->origin = participants.origin();
      (void)clock_out.send(*messages.clock_request);
    }
  }

  ViewerOptions options;
  wire::Participants participants;
  ViewerCore core;
  PageServer server;
  wire::Writer<session::RosterEntry> roster_out;
  wire::Writer<session::Demand> demand_out;
  wire::Writer<session::ClockSample> clock_out;
  wire::Writer<session::EmergencyStop> stop_out;
  Inbox inbox{1u << 15};
  std::vector<std::shared_ptr<void>> readers;  // last, so that callbacks end before other members are destroyed
};

Viewer::Viewer(ViewerOptions options) : impl_{std::make_unique<Impl>(std::move(options))} {}
Viewer::~Viewer() = default;

std::uint16_t Viewer::port() const { return impl_->server.port(); }

int Viewer::run(const std::atomic<bool>& stop) {
  Impl& viewer = *impl_;
  while (!stop && !viewer.core.is_name_taken()) {
    for (const Inbox::Arrived& arrived : viewer.inbox.take(kTick))
      std::visit([&](const auto& sample) { viewer.process(sample, arrived.at_ns); }, arrived.sample);
    const std::int64_t now_ns = monotonic_ns();
    viewer.send(viewer.core.tick(now_ns));
    viewer.server.poll(now_ns);
  }
  wire::send_leave_messages([&] {
    session::RosterEntry entry = viewer.core.roster_entry(true, monotonic_ns());
    entry.origin = viewer.participants.origin();
    (void)viewer.roster_out.send(entry);
  });
  return viewer.core.is_name_taken() ? 2 : 0;
}

}  // namespace tactus::viewer
