#include "hrtc_service/hrtc.hpp"

#include <spdlog/spdlog.h>
#include <sys/prctl.h>

#include <algorithm>
#include <deque>
#include <map>
#include <mutex>
#include <thread>
#include <type_traits>
#include <utility>
#include <variant>

#include "hrtc_service/body_exchange.hpp"
#include "hrtc_service/contact_journal.hpp"
#include "hrtc_service/gateway.hpp"
#include "hrtc_service/group_endpoints.hpp"
#include "hrtc_service/membership.hpp"
#include "hrtc_service/realtime.hpp"
#include "hrtc_service/snapshot.hpp"
#include "hrtc_service/state_sender.hpp"
#include "hrtc_service/statistics.hpp"
#include "hrtc_service/stop_switch.hpp"
#include "hrtc_service/timer_beside.hpp"
#include "hrtc_service/user_devices.hpp"
#include "session/periodic.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMs = 1'000'000;
// A pass is one call of `serve` by the service thread. Limits of the period of passes:
constexpr std::int64_t kMinServiceNs = 2 * kMs;
constexpr std::int64_t kMinServiceAtRestNs = 8 * kMs;  // while Loader::at_rest
constexpr std::int64_t kServicePeriodFactor = 10;      // period / duration of the last pass
constexpr std::int64_t kMaxServiceNs = 10 * kMs;
constexpr std::int64_t kMetricsNs = 500 * kMs;
constexpr std::int64_t kSceneMetricsNs = 100 * kMs;
constexpr std::int64_t kAllMetricsNs = 5000 * kMs;
constexpr std::int64_t kOverrunLogNs = 1000 * kMs;
constexpr std::int64_t kTargetsLogNs = 10'000 * kMs;
constexpr std::int64_t kGroupsNs = 20 * kMs;
constexpr std::int64_t kNoHostLogNs = 5000 * kMs;

using session::PeriodicTimer;
struct HostAnswer {
  session::ClockSample sample;
};
/// A probe state that arrived at the endpoints of a group.
struct FullRateState {
  session::ProbeState state;
};
wire::SessionAddress without_bulk_writers(wire::SessionAddress address) {
  address.only_reads_bulk = true;
  return address;
}

/// A stop that a roster entry of another program lists.
struct RelayedStop {
  std::string by;
};

using Sample = std::variant<HostAnswer, session::RosterEntry, session::CatalogueEntry, session::BulkChunk,
                            session::Intent, session::ClockSample, session::Control, session::EmergencyStop,
                            session::ForceReset, session::SessionEnd, RelayedStop, session::ProbeState,
                            session::Metrics, FullRateState, session::ObjectGrant, session::ObjectPose>;
using Inbox = wire::Inbox<Sample>;

bool is_same(const session::StopName& a, const session::StopName& b) {
  return a.participant == b.participant && a.incarnation == b.incarnation && a.number == b.number;
}

bool touches_exactly(const ProbeReports& reports) {
  constexpr std::uint32_t kTouching = session::kInContact | session::kExact;
  return std::any_of(reports.probes.begin(), reports.probes.end(),
                     [](const ProbeOutput& probe) { return (probe.status & kTouching) == kTouching; });
}

}  // namespace

struct Hrtc::Impl {
  explicit Impl(HrtcOptions given);
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
  void finish();

  HrtcOptions options;
  wire::Participants participants;
  Inbox inbox{1u << 14};
  std::unique_ptr<FlightSaver> flight;  // null: no flight recorder
  HrtcCore core;
  Gateway& gateway{core.gateway()};
  const Loader& loader{core.gateway().loader()};
  HapticThread haptic;
  Membership membership;
  HapticOrders orders{haptic};
  UserDevices devices;
  StopSwitch stops{participants.origin(), core.link()};
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
  Samples timer_samples{1'000'000};
  std::unique_ptr<TimerBeside> timer;
  std::unique_ptr<ContactJournal> log;

  PeriodicTimer metrics{kMetricsNs}, all_metrics{kAllMetricsNs}, no_host{kNoHostLogNs}, sync_groups{kGroupsNs};
  std::int64_t started_ns = 0;
  bool ended = false;
  int exit_code = 0;
  std::array<std::uint32_t, kMaxProbes> faults_logged{};  // status bits
  std::array<std::uint32_t, kMaxProbes> holds_logged{};   // status bits
  LateCycleClassifier late_cycles;
  std::deque<CycleTrace> late_traces;  // late cycles without a class
  PeriodicTimer overrun_logged{kOverrunLogNs}, targets_logged{kTargetsLogNs};
  std::uint32_t overruns_unlogged = 0;
  std::uint64_t first_cycle = 0;  // number of the first reported cycle; 0: none
  std::int64_t first_cycle_ns = 0;
  std::optional<SnapshotTaker> snapshots;  // only with HrtcOptions::snapshot
  std::uint32_t save_requests_seen = 0;
  struct {
    // Times of the first catalogue entry, base mesh and exact contact; 0: none.
    std::int64_t catalogue_ns = 0, base_ns = 0, exact_ns = 0;
    std::uint64_t bytes = 0;  // payload received until `exact_ns`
  } first;

  std::thread sender;
  std::atomic<bool> sending{false};

  // Declared last, so that the callbacks of readers end before the members that they use are destroyed.
  std::vector<std::shared_ptr<void>> readers;
  /// Samples that every program sends to every other do not wake the service, because a large session has many of them.
  template <class Typed>
  static constexpr wire::Urgency kUrgency =
      std::is_same_v<Typed, session::SessionEnd> ? wire::Urgency::kLast
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
    inbox.put(std::move(sample), kUrgency<Typed>);
  }
  void receive(session::EmergencyStop&& stop) {
    const bool is_new = stops.on_stop(stop.name());
    // A roster entry may have reported the stop before, but without its reason.
    if (is_new || !is_same(stop.name(), stop_received)) inbox.put(session::EmergencyStop{stop});
    stop_received = stop.name();
  }
  void receive(session::ForceReset&& reset) {
    if (stops.on_reset(reset)) inbox.put(std::move(reset));
  }
  void receive(session::RosterEntry&& entry) {
    if (stops.on_roster(entry)) inbox.put(RelayedStop{session::text(entry)});
    inbox.put(std::move(entry), kUrgency<session::RosterEntry>);
  }
};

namespace {

std::array<haptics::DeviceSpec, kMaxProbes> specs_of(const HrtcOptions& options) {
  std::array<haptics::DeviceSpec, kMaxProbes> specs;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (i < options.local_users.size())
      specs[i] = options.haptic.frame.to_world(options.local_users[i].device->spec());
    else if (options.core.servo.cycle.tool != nullptr)  // a client itself limits the torque to that of its device
      specs[i].max_torque = options.core.servo.cycle.force.max_torque;
  return specs;
}

std::unique_ptr<FlightSaver> flight_saver(const HrtcOptions& options) {
  if (options.flight.seconds <= 0) return nullptr;
  return std::make_unique<FlightSaver>(
      options.flight,
      flight_start(options.address.participant, options.core.servo.cycle, options.core.pool, specs_of(options)),
      static_cast<std::uint32_t>(std::min<std::size_t>(options.max_users, kMaxProbes)));
}

HrtcCoreSettings core_settings(const HrtcOptions& options, FlightSaver* flight) {
  HrtcCoreSettings settings = options.core;
  settings.servo.specs = specs_of(options);
  settings.servo.recorder = flight == nullptr ? nullptr : &flight->recorder();
  settings.gateway.loader.clock = monotonic_ns;
  return settings;
}

HapticSettings haptic_settings(const HrtcOptions& options) {
  HapticSettings settings = options.haptic;
  settings.period = options.core.servo.cycle.period;
  return settings;
}

}  // namespace

Hrtc::Impl::Impl(HrtcOptions given)
    : options{std::move(given)},
      participants{without_bulk_writers(options.address)},
      flight{flight_saver(options)},
      core{participants.origin(), core_settings(options, flight.get())},
      haptic{haptic_settings(options), core.servo()},
      membership{participants.origin(),
                 {options.address.participant, options.address.session, options.max_users},
                 gateway,
                 monotonic_ns()},
      devices{participants, orders, [this](session::Intent&& intent) { inbox.put(std::move(intent)); }},
      roster_out{participants, wire::topics::kRoster},
      demand_out{participants, wire::topics::kDemand},
      clock_out{participants, wire::topics::kClock},
      host_clock_out{participants, wire::topics::kClock, {wire::hrtc_partition(options.address.participant)}},
      metrics_out{participants, wire::topics::kMetrics},
      losses_out{participants, wire::topics::kMetrics, {wire::kLossesPartition}},
      groups{participants, [this](session::ProbeState&& state) { inbox.put(FullRateState{std::move(state)}); }},
      states{participants, options.core.servo.cycle.radius, options.uses_deadband,
             devices,      membership.remote_users(),       groups},
      exchange{participants, core.link().bodies, gateway} {
  gateway.on_event = [](const std::string& text) { spdlog::info("{}", text); };
  gateway.on_object = [this](const TouchObject& object) {
    exchange.add(object);
    states.set_object_id(object.index, object.id);
    if (log) log->add(object);
  };
  membership.on_object_gone = [this](const Loader::ObjectInfo& object) {
    if (object.index == spm::kNone) return;  // its base mesh was never in the pool
    exchange.remove(object.index, object.id);
    states.set_object_id(object.index, 0);
    if (log) log->close(object);
  };
  add_local_users();
  // The directory is made after every step that may throw, so that a failed start leaves none.
  if (!options.snapshot.empty()) expect_snapshot_directory(options.snapshot);
  if (!options.log.empty()) log = std::make_unique<ContactJournal>(options.log, core.link().log);
  if (!options.snapshot.empty()) {
    std::filesystem::create_directories(options.snapshot);
    snapshots.emplace(options.snapshot, options.address.participant, loader);
  }
  listen(wire::topics::kStop);
  listen(wire::topics::kReset);
  listen(wire::topics::kEnd);
  listen(wire::topics::kRoster);
  listen(wire::topics::kCatalogue);
  listen(wire::topics::kClock);
  listen(wire::topics::kControl);
  listen(wire::topics::kProbeState);
  listen(wire::topics::kObjectGrant);
  listen(wire::topics::kObjectPose);
  listen(wire::topics::kMetrics, {wire::kLossesPartition});
  const wire::EndpointOptions own{wire::hrtc_partition(options.address.participant)};
  listen(wire::topics::kBase, own);
  listen(wire::topics::kRecords, own);
  readers.push_back(std::make_shared<wire::Reader<session::ClockSample>>(
      participants, wire::topics::kClock,
      [this](session::ClockSample&& answer) { inbox.put(HostAnswer{std::move(answer)}); }, own));
}

Hrtc::Impl::~Impl() {
  haptic.stop();
  sending = false;
  if (sender.joinable()) sender.join();
  if (flight) static_cast<void>(flight->stop());
}

void Hrtc::Impl::add_local_users() {
  for (LocalUser& local : options.local_users) {
    const std::optional<std::uint32_t> probe = membership.add_local(local.user);
    if (!probe) throw haptics::DeviceError("no slot left for user " + local.user);
    devices.add_local(*probe, local.user, std::move(local.device));
  }
}

void Hrtc::Impl::process(const session::CatalogueEntry& entry, std::int64_t now_ns) {
  if (ended) return;  // the last metrics must still contain the objects that hosts withdraw at the end
  if (first.catalogue_ns == 0) first.catalogue_ns = now_ns;
  membership.on_catalogue(entry);
}

/// Converts the intent from session time to the clock of this machine.
void Hrtc::Impl::process(const session::Intent& intent, std::int64_t now_ns) {
  devices.on_intent(intent, now_ns - membership.clock().session_time(now_ns));
}

/// Answers at once, because a delay adds to the error of the measurement.
void Hrtc::Impl::process(const session::ClockSample& sample, std::int64_t now_ns) {
  membership.on_clock(sample, now_ns, monotonic_ns());
  process_output();
}

void Hrtc::Impl::process(const session::Control& control, std::int64_t) {
  switch (control.kind) {
    case session::ControlKind::kStart:
      spdlog::info("session {} starts", options.address.session);
      break;
    case session::ControlKind::kMode:
      membership.on_mode(control.text);
      break;
  }
}

void Hrtc::Impl::process(const session::EmergencyStop& stop, std::int64_t) {
  spdlog::warn("emergency stop: {}", stop.text);
}

void Hrtc::Impl::process(const RelayedStop& stop, std::int64_t) {
  spdlog::warn("emergency stop: {} forwards it", stop.by);
}

void Hrtc::Impl::process(const session::ForceReset& reset, std::int64_t) {
  spdlog::info("forces are reset: {}{}", reset.text, stops.stopped() ? "; another stop holds them off" : "");
}

void Hrtc::Impl::process(const session::SessionEnd& end, std::int64_t) {
  spdlog::info("session {} ends{}{}", options.address.session, end.text.empty() ? "" : ": ", end.text);
  ended = true;
}

/// Sends the samples of the membership, logs its events, and adds and removes users.
void Hrtc::Impl::process_output() {
  MembershipOutput& output = membership.output;
  for (const SessionEvent& event : output.events) {
    constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::info, spdlog::level::warn, spdlog::level::err};
    spdlog::log(kLevels[static_cast<std::size_t>(event.severity)], "{}", event.text);
  }
  for (session::ClockSample& sample : output.clock) {
    sample.origin = participants.origin();
    (void)clock_out.send(sample);
  }
  for (session::ClockSample& sample : output.clock_to_host) {
    sample.origin = participants.origin();
    (void)host_clock_out.send(sample);
  }
  for (const UserChange& user : output.users) {
    if (user.joined)
      devices.add(user.probe, user.name, user.client);
    else
      devices.remove(user.probe);
  }
  if (output.roster) send(std::move(*output.roster));
  // Other programs compare their scene with the scene in the metrics, so the metrics are due soon.
  if (output.scene_changed) metrics.make_due_within(monotonic_ns(), kSceneMetricsNs);
  if (output.name_conflict) {
    exit_code = 2;
    ended = true;
  }
  output.clear();
}

/// Acknowledges in the roster the stops that the servo has obeyed, and saves the cycles before a stop.
void Hrtc::Impl::acknowledge_stops() {
  if (stops.acknowledge(stops_acknowledged)) membership.on_stops(stops_acknowledged);
  const bool before = std::exchange(stopped, stops.stopped());
  if (stopped && !before && flight) flight->save("emergency stop", false);
}

void Hrtc::Impl::send(session::RosterEntry entry) {
  entry.origin = participants.origin();
  (void)roster_out.send(entry);
}

void Hrtc::Impl::send_metrics(bool all) {
  namespace names = session::figures;
  session::Metrics sample;
  sample.origin = participants.origin();
  sample.scene = session::scene_hash(membership.roster(), participants.origin(), session::Role::kHrtc);
  statistics.add_figures(sample.figures, all);
  if (all && !timer_samples.empty()) {
    sample.figures.push_back({names::kTimerP50, timer_samples.percentile(0.5) * 1e-3});
    sample.figures.push_back({names::kTimerP99, timer_samples.percentile(0.99) * 1e-3});
    sample.figures.push_back({names::kTimerMax, timer_samples.percentile(1) * 1e-3});
  }
  if (timer != nullptr) sample.figures.push_back({names::kTimerOverruns, static_cast<double>(timer->overruns())});
  if (gateway.reports().cycle > first_cycle)
    sample.figures.push_back({names::kRate, static_cast<double>(gateway.reports().cycle - first_cycle) * 1e9 /
                                                static_cast<double>(gateway.reports().time_ns - first_cycle_ns)});
  const LoaderFigures figures = loader.figures();
  const auto& delivery = loader.delivery_counters();
  const std::pair<const char*, double> counts[] = {
      {names::kPoolUsed, figures.slots_used},
      {names::kPoolPeak, figures.slots_peak},
      {names::kPoolLimit, figures.slots_limit},
      {names::kCompressedUsed, figures.compressed_used},
      {names::kCompressedPeak, figures.compressed_peak},
      {names::kCompressedLimit, figures.compressed_limit},
      {names::kRegionsHeld, static_cast<double>(figures.regions_held)},
      {names::kRegionsCoarsened, static_cast<double>(figures.regions_coarsened)},
      {names::kRegionsReceived, static_cast<double>(figures.regions_received)},
      {names::kEvictions, static_cast<double>(figures.regions_evicted)},
      {names::kReloads, static_cast<double>(figures.regions_reloaded)},
      {names::kRegionsRefused, static_cast<double>(figures.refused_full)},
      {names::kObjectsRefused, static_cast<double>(figures.objects_refused)},
      {names::kRecordsReceived, static_cast<double>(figures.records_received)},
      {names::kRecordsReturned, static_cast<double>(figures.records_returned)},
      {names::kRecordsRepeated, static_cast<double>(figures.records_repeated)},
      {names::kRecordsPublished, static_cast<double>(figures.records_published)},
      {names::kBytesReceived, static_cast<double>(delivery.payload_bytes)},
      {names::kLoadLatency, figures.load_latency * 1e6},
      {names::kFalseAlarms, static_cast<double>(membership.false_suspicions())},
      {names::kHostChanges, static_cast<double>(delivery.host_changes)},
      {names::kImplausible,
       static_cast<double>(membership.implausible() + delivery.implausible + devices.implausible() +
                           gateway.ownership().implausible() + exchange.implausible())}};
  for (const auto& [name, value] : counts) sample.figures.push_back({name, value});
  states.add_figures(sample.figures);
  devices.add_figures(sample.figures);
  static_assert(std::size(names::kInterventions) == haptics::kForceBits);
  for (std::size_t i = 0; i < haptics::kForceBits; ++i)
    sample.figures.push_back({names::kInterventions[i], static_cast<double>(gateway.reports().interventions[i])});
  const auto since_catalogue = [&](const char* name, std::int64_t at_ns) {
    if (at_ns != 0) sample.figures.push_back({name, static_cast<double>(at_ns - first.catalogue_ns) * 1e-3});
  };
  since_catalogue(names::kFirstBase, first.base_ns);
  since_catalogue(names::kFirstExact, first.exact_ns);
  if (first.exact_ns != 0) sample.figures.push_back({names::kFirstExactBytes, static_cast<double>(first.bytes)});
  membership.remote_users().add_figures(sample.figures);
  sample.figures.push_back({names::kCollaborating, static_cast<double>(groups.collaborating())});
  gateway.ownership().add_figures(sample.figures);
  static_assert(kMaxObjects <= session::kMaxMeshes);
  const MeshHashes& hashes = core.link().mesh_hashes.latest();
  for (const Loader::ObjectInfo& object : loader.objects()) sample.meshes.push_back({object.id, hashes[object.index]});
  (void)metrics_out.send(sample);
  sample.meshes.clear();
  sample.figures = membership.remote_users().losses();
  if (!sample.figures.empty()) (void)losses_out.send(sample);
}

/// Ticks the gateway between the two halves of the body exchange.
void Hrtc::Impl::tick_gateway(std::int64_t now_ns) {
  exchange.tick(now_ns, membership.clock());
  gateway.tick(now_ns, membership.clock());
  exchange.send_claims();
  if (gateway.has_new_reports()) process_reports();
}

void Hrtc::Impl::process_reports() {
  const ProbeReports& reports = gateway.reports();
  if (first_cycle == 0) {
    first_cycle = reports.cycle;
    first_cycle_ns = reports.time_ns;
  }
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    log_fault(i, reports.probes[i].status);
    log_hold(i, reports.probes[i]);
  }
}

/// Sends probe states, commands and copies, and samples the system counters of the haptic thread. Runs in the sender
/// thread. The haptic thread notifies no thread, so this one wakes by timer after the planned start of each cycle, and
/// every twentieth of a period until the cycle's reports are there.
void Hrtc::Impl::send_states() {
  pthread_setname_np(pthread_self(), "sender");
  prctl(PR_SET_TIMERSLACK, 1000);  // ns; by default ordinary threads wake 50 us late
  const std::int64_t step_ns = options.haptic.period_ns() / 20;
  const auto gap_ns = static_cast<std::int64_t>(1e9 / options.state_rate) - kMs / 2;
  std::int64_t sent_ns = 0;
  ProbeReports latest;
  while (sending) {
    wire::sleep_until(std::max(latest.next_due_ns, monotonic_ns()) + step_ns);
    if (!core.link().reports_for_sender.take(latest)) continue;
    devices.send_commands(latest);
    exchange.send();
    if (latest.time_ns - sent_ns >= gap_ns) {
      sent_ns = latest.time_ns;
      states.send(latest, sender_clock.latest());
    }
    haptic.usage().sample(monotonic_ns());
    if (timer) timer->usage().sample(monotonic_ns());
  }
}

/// Logs the costs of an overrun, at most one line in each second.
void Hrtc::Impl::log_overrun(const CycleTrace& trace, const LateVerdict& verdict) {
  ++overruns_unlogged;
  if (!overrun_logged.due(monotonic_ns())) return;
  const CycleCosts& costs = trace.costs;
  const auto us = [](auto ns) { return ns / 1000; };
  spdlog::warn(
      "overrun{}: {} us from begin to end, at least {} us of it own work; blocked {} times; {} minor and {} major page "
      "faults; loading {} us, refinement {} us ({} visits, {} changes), refit {} us, query {} us, forces {} us; {} "
      "arrivals; {} of {} probes in contact",
      overruns_unlogged == 1 ? std::string{} : fmt::format(" ({} since the last line)", overruns_unlogged),
      us(trace.times.end_ns - trace.times.began_ns), us(verdict.own_ns), verdict.blocked, verdict.minor_faults,
      verdict.major_faults, us(costs.load), us(costs.refine), costs.visits, costs.changes, us(costs.refit),
      us(costs.query), us(costs.force), costs.arrivals, trace.in_contact, trace.active);
  overruns_unlogged = 0;
}

void Hrtc::Impl::classify_late_cycles() {
  haptic.usage().drain([this](const ThreadUsage& usage) { late_cycles.add(usage); });
  while (const std::optional<LateVerdict> verdict = late_cycles.next()) {
    statistics.add(verdict->late_class);
    if (verdict->late_class == LateClass::kOverrun) log_overrun(late_traces.front(), *verdict);
    late_traces.pop_front();
  }
}

void Hrtc::Impl::drain_rings() {
  CycleTrace trace;
  while (haptic.traces().pop(trace)) {
    statistics.add(trace);
    if (trace.targets_dropped && targets_logged.due(monotonic_ns()))
      spdlog::warn(
          "the mesh near a probe remains partly coarse: more than {} regions of an object need refinement; "
          "raise --targets",
          options.core.servo.cycle.targets);
    late_cycles.add(trace.times);
    if (trace.times.late()) late_traces.push_back(trace);
  }
  classify_late_cycles();
  if (timer) timer->drain(timer_samples);
  if (log && !log->drain()) {
    spdlog::error("the contact log {} cannot be written any more (disk full?); the session goes on without it",
                  options.log.string());
    log.reset();
    exit_code = 1;
  }
}

void Hrtc::Impl::take_snapshots(std::int64_t now_ns) {
  if (!snapshots) return;
  try {
    snapshots->tick(now_ns, touches_exactly(gateway.reports()), gateway.reported_probes(), core.servo(), orders);
  } catch (const std::runtime_error& error) {
    spdlog::error("{}", error.what());
    exit_code = 1;
    snapshots.reset();
  }
}

void Hrtc::Impl::measure_first_touch(std::int64_t now_ns) {
  if (first.base_ns == 0 && !loader.objects().empty()) first.base_ns = now_ns;
  if (first.exact_ns != 0 || !touches_exactly(gateway.reports())) return;
  first.exact_ns = gateway.reports().time_ns;
  first.bytes = loader.delivery_counters().payload_bytes;
}

void Hrtc::Impl::log_fault(std::uint32_t slot, std::uint32_t status) {
  const std::uint32_t fault = status & (session::kFault | session::kFaultReason);
  if (fault == std::exchange(faults_logged[slot], fault)) return;
  const std::string& name = membership.name_at(slot);
  if ((fault & session::kFault) != 0) {
    spdlog::warn("the force of user {} is off until it is reset: {}", name, session::fault_reason(status));
    if (flight) flight->save(session::fault_reason(status), false);
  } else
    spdlog::info("the force of user {} is on again", name);
}

void Hrtc::Impl::log_hold(std::uint32_t slot, const ProbeOutput& probe) {
  constexpr std::uint32_t kHold = session::kHolding | session::kHoldRefused;
  const std::uint32_t now = probe.status & kHold, before = std::exchange(holds_logged[slot], now);
  if (now == before || !membership.has_user(slot)) return;
  std::string name = "something";
  for (const Loader::ObjectInfo& object : loader.objects())
    if (object.index == probe.object) name = "'" + object.name + "'";
  if ((now & session::kHolding) != 0) {
    spdlog::info("user {} holds {}", membership.name_at(slot), name);
  } else if ((before & session::kHolding) != 0) {
    spdlog::info("user {} has released the object", membership.name_at(slot));
  } else if ((now & session::kHoldRefused) != 0) {
    spdlog::warn("user {} cannot hold {}: it does not move here, or forces were off since the hand has closed",
                 membership.name_at(slot), name);
  }
}

void Hrtc::Impl::serve(std::int64_t now_ns) {
  tick_gateway(now_ns);
  measure_first_touch(now_ns);
  acknowledge_stops();
  membership.tick(now_ns);
  process_output();
  send_requests();
  sender_clock.post(membership.clock());
  devices.on_clock(membership.clock().session_time(now_ns) - now_ns);
  if (metrics.due(now_ns)) send_metrics(all_metrics.due(now_ns));
  devices.open_remote_devices();
  devices.free_departed();
  if (sync_groups.due(now_ns)) groups.sync(membership.remote_users(), membership.user_ids());
  drain_rings();
  if (options.save_requests != nullptr && save_requests_seen != *options.save_requests) {
    save_requests_seen = *options.save_requests;
    if (flight) flight->save("requested by a signal", true);
  }
  take_snapshots(now_ns);
  if (!membership.has_found_host()) check_for_hosts(now_ns);
}

void Hrtc::Impl::send_requests() {
  const std::int64_t now_ns = monotonic_ns();
  while (auto demand = gateway.demand(now_ns)) {
    demand->origin = participants.origin();
    (void)demand_out.send(*demand);
  }
  if (auto request = membership.clock_request(monotonic_ns())) {
    const std::int64_t sent_ns = request->sample.t0_ns;
    request->sample.origin = participants.origin();
    request->sample.t0_ns = sent_ns;
    (void)(request->to_host ? host_clock_out : clock_out).send(request->sample);
  }
}

/// Logs a warning while no host is found, and ends the program after `host_patience`.
void Hrtc::Impl::check_for_hosts(std::int64_t now_ns) {
  if (now_ns - started_ns > kNoHostLogNs && no_host.due(now_ns))
    spdlog::warn(
        "no host found in session {} on domain {}; still looking (is tactus-host running with the same --session and "
        "--domain?)",
        options.address.session, options.address.domain);
  if (options.host_patience <= 0 || static_cast<double>(now_ns - started_ns) <= options.host_patience * 1e9) return;
  spdlog::error("no host found in session {} on domain {} within {} s", options.address.session, options.address.domain,
                options.host_patience);
  exit_code = 1;
  ended = true;
}

void Hrtc::Impl::finish() {
  haptic.stop();
  sending = false;
  if (sender.joinable()) sender.join();
  timer.reset();
  late_cycles.finish();
  drain_rings();
  if (flight && !flight->stop()) exit_code = 1;
  if (haptic.traces_dropped() > 0)
    spdlog::warn("{} cycles are missing in the metrics: the service thread was too slow", haptic.traces_dropped());
  if (inbox.dropped() > 0) spdlog::warn("{} samples found the inbox full and were dropped", inbox.dropped());
  if (log) {
    for (const Loader::ObjectInfo& object : loader.objects()) log->close(object);
    for (const Loader::ObjectInfo& object : loader.withdrawn_objects()) log->close(object);
    if (core.servo().cycle().log_dropped() > 0)
      spdlog::warn("{} contact log entries were dropped", core.servo().cycle().log_dropped());
    if (!log->finish()) {
      spdlog::error("the contact log {} is incomplete: its last entries cannot be written (disk full?)",
                    options.log.string());
      exit_code = 1;
    }
    log.reset();
  }
  // The metrics topic does not repeat lost samples, so the last metrics are sent three times.
  for (int i = 0; i < 3; ++i) {
    send_metrics(true);
    std::this_thread::sleep_for(std::chrono::milliseconds{20});
  }
  wire::send_leave_messages([this] { send(membership.roster_entry(true, monotonic_ns())); });
}

int Hrtc::Impl::run(const std::atomic<bool>& stop) {
  if (options.haptic.priority > 0) spdlog::info("{}", wire::lock_memory());
  started_ns = monotonic_ns();
  if (flight) {
    flight->on_event = [](bool is_warning, const std::string& text) {
      spdlog::log(is_warning ? spdlog::level::warn : spdlog::level::info, "{}", text);
    };
    flight->start();
    spdlog::info("flight recorder: the last {:g} s, {:.1f} MiB at most", options.flight.seconds,
                 static_cast<double>(flight->max_bytes()) / (1 << 20));
  }
  spdlog::info("{}", haptic.start());
  if (options.timer_beside) timer = std::make_unique<TimerBeside>(options.haptic.period_ns(), options.haptic.priority);
  sending = true;
  sender = std::thread{[this] { send_states(); }};
  spdlog::info("{} serves {} probes in session {} on domain {}; pool of {} slots, {:.1f} MiB{}",
               options.address.participant, options.max_users, options.address.session, options.address.domain,
               options.core.pool.slots, static_cast<double>(options.core.pool.bytes()) / (1 << 20),
               options.core.gateway.loader.directory_bytes == ~std::uint64_t{0}
                   ? std::string{}
                   : fmt::format(", and {:.1f} MiB for directories",
                                 static_cast<double>(options.core.gateway.loader.directory_bytes) / (1 << 20)));
  // A timer starts each pass, not the arrival of a sample, because the number of samples grows with the square of the
  // session's size. Passes should take only a tenth of a processor. Otherwise they would slow down an overloaded
  // machine more and more: answers arrive later, so prediction looks further ahead and takes more time. The failure
  // detector also runs between passes.
  PeriodicTimer pass{kMinServiceNs}, watch{kMinServiceNs};
  while (!stop && !ended) {
    const std::int64_t before_ns = monotonic_ns();
    const std::int64_t watch_ns = membership.watch_period_ns();
    if (watch_ns > 0) watch.set_period(watch_ns);
    const auto patience =
        watch_ns > 0 ? std::min(pass.remaining(before_ns), watch.remaining(before_ns)) : pass.remaining(before_ns);
    for (const Inbox::Arrived& arrived : inbox.take(patience))
      std::visit([&](const auto& sample) { process(sample, arrived.at_ns); }, arrived.sample);
    const std::int64_t now_ns = monotonic_ns();
    if (watch_ns > 0 && watch.due(now_ns) && membership.watch_hosts(now_ns)) pass.make_due();
    process_output();
    if (!pass.due(now_ns)) continue;
    serve(now_ns);
    const std::int64_t min_ns = loader.at_rest() ? kMinServiceAtRestNs : kMinServiceNs;
    pass.set_period(std::clamp(kServicePeriodFactor * (monotonic_ns() - now_ns), min_ns, kMaxServiceNs));
  }
  finish();
  return exit_code;
}

Hrtc::Hrtc(HrtcOptions options) : impl_{std::make_unique<Impl>(std::move(options))} {}
Hrtc::~Hrtc() = default;
int Hrtc::run(const std::atomic<bool>& stop) { return impl_->run(stop); }

}  // namespace tactus::hrtc_service
