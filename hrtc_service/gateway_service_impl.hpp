/// The members of the gateway's service, for the sources that implement its threads. Nothing else includes this file.
///
///   gateway_service.cpp          samples, passes of the service thread, sender thread, start and end
///   gateway_service_reports.cpp  reports of the haptic thread: metrics, logs, snapshots
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "hrtc_service/body_exchange.hpp"
#include "hrtc_service/contact_logger.hpp"
#include "hrtc_service/gateway.hpp"
#include "hrtc_service/gateway_service.hpp"
#include "hrtc_service/group_endpoints.hpp"
#include "hrtc_service/membership.hpp"
#include "hrtc_service/reference_timer.hpp"
#include "hrtc_service/servo/late_cycles.hpp"
#include "hrtc_service/shown_sender.hpp"
#include "hrtc_service/snapshot.hpp"
#include "hrtc_service/state_sender.hpp"
#include "hrtc_service/statistics.hpp"
#include "hrtc_service/stop_switch.hpp"
#include "hrtc_service/user_devices.hpp"
#include "realtime/service_manager.hpp"
#include "session/periodic.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace tactus::hrtc_service {

struct GatewayService::Impl {
  static constexpr std::int64_t kMetricsNs = 500'000'000;
  static constexpr std::int64_t kAllMetricsNs = 5'000'000'000;
  static constexpr std::int64_t kOverrunLogNs = 1'000'000'000;
  static constexpr std::int64_t kTargetsLogNs = 10'000'000'000;
  static constexpr std::int64_t kGroupsNs = 20'000'000;
  static constexpr std::int64_t kNoHostLogNs = 5'000'000'000;
  static constexpr std::int64_t kEarlierUsersNs = 5'000'000'000;  // for which users of an earlier gateway keep probes

  using PeriodicTimer = session::PeriodicTimer;
  struct HostAnswer {
    session::ClockSample sample;
  };
  /// A probe state that arrived at the endpoints of a group.
  struct FullRateState {
    session::ProbeState state;
  };
  /// A stop that a roster entry of another program lists.
  struct RelayedStop {
    std::string by;
  };

  using Sample = std::variant<HostAnswer, session::RosterEntry, session::CatalogueEntry, session::BulkChunk,
                              session::Intent, session::ClockSample, session::Control, session::EmergencyStop,
                              session::ForceReset, session::SessionEnd, RelayedStop, session::ProbeState,
                              session::Metrics, FullRateState, session::ObjectGrant, session::ObjectPose>;
  using Inbox = wire::Inbox<Sample>;

  Impl(const HrtcOptions& given, ServoLink& servo_link, ContactQuery::LogRing* log, const spm::MeshProbe* tool);
  ~Impl();
  int run(const std::atomic<bool>& stop);

  // Each of these processes one received sample.
  void process(const session::RosterEntry& entry, std::int64_t now_ns) { membership.on_roster(entry, now_ns); }
  void process(const session::CatalogueEntry& entry, std::int64_t now_ns);
  void process(const session::BulkChunk& chunk, std::int64_t now_ns) { gateway.on_chunk(chunk, now_ns); }
  void process(const session::Intent& intent, std::int64_t now_ns);
  void process(const session::ClockSample& sample, std::int64_t now_ns);
  void process(const HostAnswer& answer, std::int64_t now_ns) { membership.on_host_answer(answer.sample, now_ns); }
  void process(const session::Control& control, std::int64_t now_ns);
  // The callbacks have already passed stops and resets to the servo.
  void process(const session::EmergencyStop& stop, std::int64_t now_ns);
  void process(const RelayedStop& stop, std::int64_t now_ns);
  void process(const session::ForceReset& reset, std::int64_t now_ns);
  void process(const session::SessionEnd& end, std::int64_t now_ns);
  void process(const session::ProbeState& state, std::int64_t now_ns) {
    membership.on_state(state, session::StateStream::kDeadbandCoded, now_ns);
  }
  void process(const FullRateState& full_rate, std::int64_t now_ns) {
    membership.on_state(full_rate.state, session::StateStream::kFullRate, now_ns);
  }
  void process(const session::Metrics& received, std::int64_t now_ns) { membership.on_metrics(received, now_ns); }
  void process(const session::ObjectGrant& grant, std::int64_t now_ns) { gateway.on_grant(grant, now_ns); }
  void process(const session::ObjectPose& pose, std::int64_t now_ns) {
    gateway.on_pose(pose, now_ns, membership.clock().session_time(now_ns));
  }

  void process_output();
  void acknowledge_stops();
  void request_flight(const std::string& reason);
  void process_reports();
  void log_fault(std::uint32_t slot, std::uint32_t status);
  void log_hold(std::uint32_t slot, const ProbeOutput& probe);
  void add_local_users();
  void measure_first_touch(std::int64_t now_ns);
  void send(session::RosterEntry entry);
  void send_metrics(bool all);
  void tick_gateway(std::int64_t now_ns);
  void send_requests();
  void check_for_hosts(std::int64_t now_ns);
  void send_states();
  void serve(std::int64_t now_ns);
  void log_overrun(const CycleTrace& trace, const LateVerdict& verdict);
  void classify_late_cycles();
  void drain_rings();
  void take_snapshots(std::int64_t now_ns);
  void end_servo();
  void finish();

  const HrtcOptions options;
  ServoLink& link;
  const bool is_successor{link.heartbeats() > 0};  // the servo had an earlier gateway
  wire::Participants participants;
  Inbox inbox{1u << 14};
  Gateway gateway;
  const Loader& loader{gateway.loader()};
  Membership membership;
  UserDevices devices;
  StopSwitch stops{participants.origin(), link};
  bool stopped = false;  // at the last pass of the service thread
  std::vector<session::StopRecord> stops_acknowledged;
  session::StopName stop_received;  // newest stop; used by the callback only
  haptics::Mailbox<session::ClockMap> sender_clock;

  wire::Writer<session::RosterEntry> roster_out;
  wire::Writer<session::Demand> demand_out;
  wire::Writer<session::ClockSample> clock_out;
  wire::Writer<session::ClockSample> host_clock_out;
  wire::Writer<session::Metrics> metrics_out, losses_out;
  GroupEndpoints groups;
  StateSender states;
  BodyExchange exchange;

  CycleStatistics statistics;
  Samples timer_samples{kMaxSamples};
  std::unique_ptr<ReferenceTimer> reference_timer;
  std::unique_ptr<ContactLogger> contact_log;

  PeriodicTimer metrics{kMetricsNs}, all_metrics{kAllMetricsNs}, no_host{kNoHostLogNs}, sync_groups{kGroupsNs};
  std::int64_t started_ns = 0;
  realtime::ServiceManager service_manager;
  bool ended = false;
  int exit_code = 0;
  std::array<std::uint32_t, kMaxProbes> holds_logged{};  // status bits
  LateCycleClassifier late_cycles;
  std::deque<CycleTrace> late_traces;  // late cycles that are not classified yet
  PeriodicTimer overrun_logged{kOverrunLogNs}, targets_logged{kTargetsLogNs};
  std::uint32_t overruns_unlogged = 0;
  std::uint64_t first_cycle = 0;  // number of the first reported cycle; 0: none
  std::int64_t first_cycle_ns = 0;
  RingReader<CycleTrace, ServoLink::kTraces> traces{link.traces};
  RingReader<ThreadUsage, ServoLink::kUsages> usages{link.usages};
  RingWriter<FlightRequest, ServoLink::kFlightRequests> flight_requests{link.flight_requests};
  ShownSender shown;
  MailboxReader<MeshHashes> mesh_hashes{link.mesh_hashes};
  std::optional<SnapshotTaker> snapshots;  // only with HrtcOptions::snapshot
  struct {
    // Times of the first catalogue entry, base mesh and exact contact; 0: none.
    std::int64_t catalogue_ns = 0, base_ns = 0, exact_ns = 0;
    std::uint64_t bytes = 0;  // payload received until `exact_ns`
  } first;

  std::thread sender;
  std::atomic<bool> sending{false};
  std::atomic<std::int64_t> pass_ns{0};  // begin of the service thread's last pass

  // Declared last, so that the callbacks of readers end before the members that they use are destroyed.
  std::vector<std::shared_ptr<void>> readers;
  /// Samples that every program sends to every other do not wake the service, because a large session has many of them.
  template <class Typed>
  static constexpr wire::Urgency kUrgency =
      wire::kIsSentOnce<Typed> ? wire::Urgency::kMustArrive
      : std::is_same_v<Typed, session::RosterEntry> || std::is_same_v<Typed, session::ClockSample> ||
              std::is_same_v<Typed, session::ProbeState> || std::is_same_v<Typed, session::Metrics>
          ? wire::Urgency::kWaits
          : wire::Urgency::kWakes;
  template <class Typed>
  void listen(const wire::TopicSpec<Typed>& topic, const wire::EndpointOptions& where = {}) {
    readers.push_back(std::make_shared<wire::Reader<Typed>>(
        participants, topic, [this](Typed&& sample) { receive(std::move(sample)); }, where));
  }
  // Called in threads of DDS.
  template <class Typed>
  void receive(Typed&& sample) {
    inbox.put(std::forward<Typed>(sample), kUrgency<Typed>);
  }
  void receive(session::EmergencyStop&& stop);
  void receive(session::ForceReset&& reset);
  void receive(session::RosterEntry&& entry);
};

}  // namespace tactus::hrtc_service
