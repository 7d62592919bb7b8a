#include "hrtc_service/gateway_service.hpp"

#include <spdlog/spdlog.h>
#include <sys/prctl.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <thread>
#include <utility>
#include <variant>

#include "event_log/event_log.hpp"
#include "hrtc_service/gateway_service_impl.hpp"
#include "realtime/periodic_clock.hpp"
#include "session/units.hpp"

namespace tactus::hrtc_service {
namespace {

// A pass is one call of `serve` by the service thread. Limits of the period of passes:
constexpr std::int64_t kMinServiceNs = 2 * kMs;
constexpr std::int64_t kMinServiceAtRestNs = 8 * kMs;  // while Loader::at_rest
constexpr std::int64_t kServicePeriodFactor = 10;      // period / duration of the last pass
constexpr std::int64_t kMaxServiceNs = 10 * kMs;
constexpr std::int64_t kSceneMetricsNs = 100 * kMs;
constexpr std::int64_t kBaseMeshNs = kMs;        // period while a base mesh does not fit into the intake's ring
constexpr std::int64_t kMaxPassNs = 2000 * kMs;  // a longer pass means that the service thread hangs

wire::SessionAddress without_bulk_writers(wire::SessionAddress address) {
  address.only_reads_bulk = true;
  return address;
}

bool is_same(const session::StopName& a, const session::StopName& b) {
  return a.participant == b.participant && a.incarnation == b.incarnation && a.number == b.number;
}

GatewaySettings gateway_settings(const HrtcOptions& options, const spm::MeshProbe* tool) {
  GatewaySettings settings;
  settings.loader.radius = options.servo.cycle.radius;
  settings.loader.tool = tool;
  settings.loader.strategy = options.prediction;
  settings.loader.directory_bytes = options.directory_bytes;
  settings.loader.clock = realtime::monotonic_ns;
  return settings;
}

/// Returns the name of the contact log: `wanted`, or for a gateway that continues with a servo, a new file beside it
/// (desk-2.log), so that the log of the earlier gateway remains.
std::filesystem::path log_file(const std::filesystem::path& wanted, bool is_successor) {
  if (!is_successor) return wanted;
  for (int number = 2;; ++number) {
    std::filesystem::path file = wanted;
    file.replace_filename(wanted.stem().string() + "-" + std::to_string(number) + wanted.extension().string());
    if (!std::filesystem::exists(file)) return file;
  }
}

}  // namespace

GatewayService::Impl::Impl(const HrtcOptions& given, ServoLink& servo_link, ContactQuery::LogRing* log,
                           const spm::MeshProbe* tool)
    : options{given},
      link{servo_link},
      participants{without_bulk_writers(options.address)},
      gateway{options.pool, participants.origin(), gateway_settings(options, tool), link},
      membership{
          participants.origin(),
          {options.address.participant, options.address.session, options.max_users, UserDevices::users_in(link.devices),
           [this](const std::string& user, std::uint64_t client) { return participants.may_serve(user, client); }},
          gateway,
          realtime::monotonic_ns()},
      devices{participants, link.devices, [this](session::Intent&& intent) { inbox.put(std::move(intent)); }},
      roster_out{participants, wire::topics::kRoster},
      demand_out{participants, wire::topics::kDemand},
      clock_out{participants, wire::topics::kClock},
      host_clock_out{participants, wire::topics::kClock, {wire::hrtc_partition(options.address.participant)}},
      metrics_out{participants, wire::topics::kMetrics},
      losses_out{participants, wire::topics::kMetrics, {wire::kLossesPartition}},
      groups{participants, [this](session::ProbeState&& state) { inbox.put(FullRateState{std::move(state)}); }},
      states{participants, options.servo.cycle.radius, options.uses_deadband,
             devices,      membership.remote_users(),  groups},
      exchange{participants, link.bodies, gateway},
      shown{participants, link, loader} {
  gateway.on_event = event_log::write;
  gateway.on_object = [this](const ObjectDescription& object) {
    exchange.add(object);
    states.set_object_id(object.index, object.id);
    if (contact_log) contact_log->add(object);
  };
  membership.on_object_gone = [this](const Loader::ObjectInfo& object) {
    if (object.index == spm::kNone) return;  // its base mesh was never in the pool
    exchange.remove(object.index, object.id);
    states.set_object_id(object.index, 0);
    if (contact_log) contact_log->close(object);
  };
  stopped = link.stop().stopped;  // a stop that the earlier gateway has reported is not reported again
  add_local_users();
  // The directory is made after every step that may throw, so that a failed start leaves none.
  if (!options.snapshot.empty()) expect_snapshot_directory(options.snapshot);
  if (!options.log.empty()) contact_log = std::make_unique<ContactLogger>(log_file(options.log, is_successor), *log);
  if (!options.snapshot.empty() && is_successor) {
    spdlog::info("no further snapshots, because an earlier gateway has ended");
  } else if (!options.snapshot.empty()) {
    std::filesystem::create_directories(options.snapshot);
    snapshots.emplace(options.snapshot, options.address.participant, loader, link);
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

GatewayService::Impl::~Impl() {
  sending = false;
  if (sender.joinable()) sender.join();
}

void GatewayService::Impl::receive(session::EmergencyStop&& stop) {
  const bool is_new = stops.on_stop(stop.name());
  // A roster entry may have reported the stop before, but without its reason.
  if (is_new || !is_same(stop.name(), stop_received)) inbox.put(session::EmergencyStop{stop});
  stop_received = stop.name();
}

void GatewayService::Impl::receive(session::ForceReset&& reset) {
  if (stops.on_reset(reset)) inbox.put(std::move(reset));
}

void GatewayService::Impl::receive(session::RosterEntry&& entry) {
  if (stops.on_roster(entry)) inbox.put(RelayedStop{session::text(entry)});
  inbox.put(std::move(entry), kUrgency<session::RosterEntry>);
}

/// Adds them before all others, so that they get the first probes, as in `local_devices`.
void GatewayService::Impl::add_local_users() {
  std::uint32_t next = 0;
  for (const LocalUser& local : options.local_users) {
    participants.expect_permitted(local.user);
    const std::optional<std::uint32_t> probe = membership.add_local(local.user);
    if (!probe) throw haptics::DeviceError("no probe left for user " + local.user + "; raise --users");
    if (*probe != next++) throw haptics::DeviceError("user " + local.user + " has two devices; expected one");
    devices.add_local(*probe, local.user);
  }
}

void GatewayService::Impl::process(const session::CatalogueEntry& entry, std::int64_t now_ns) {
  if (ended) return;  // the last metrics must still contain the objects that hosts withdraw at the end
  if (first.catalogue_ns == 0) first.catalogue_ns = now_ns;
  membership.on_catalogue(entry);
}

/// Converts the intent from session time to the clock of this machine.
void GatewayService::Impl::process(const session::Intent& intent, std::int64_t now_ns) {
  devices.on_intent(intent, now_ns - membership.clock().session_time(now_ns));
}

/// Answers at once, because a delay adds to the error of the measurement.
void GatewayService::Impl::process(const session::ClockSample& sample, std::int64_t now_ns) {
  membership.on_clock(sample, now_ns, realtime::monotonic_ns());
  process_output();
}

void GatewayService::Impl::process(const session::Control& control, std::int64_t) {
  switch (control.kind) {
    case session::ControlKind::kStart:
      spdlog::info("session {} starts", options.address.session);
      break;
    case session::ControlKind::kMode:
      membership.on_mode(control.text);
      break;
  }
}

void GatewayService::Impl::process(const session::EmergencyStop& stop, std::int64_t) {
  spdlog::warn("emergency stop: {}", stop.text);
}

void GatewayService::Impl::process(const RelayedStop& stop, std::int64_t) {
  spdlog::warn("emergency stop, relayed by {}", stop.by);
}

void GatewayService::Impl::process(const session::ForceReset& reset, std::int64_t) {
  spdlog::info("forces are reset: {}{}", reset.text, stops.stopped() ? "; another stop is in force" : "");
}

void GatewayService::Impl::process(const session::SessionEnd& end, std::int64_t) {
  spdlog::info("session {} ends{}{}", options.address.session, end.text.empty() ? "" : ": ", end.text);
  ended = true;
}

/// Sends the samples of the membership, logs its events, and adds and removes users.
void GatewayService::Impl::process_output() {
  MembershipOutput& output = membership.output;
  for (const SessionEvent& event : output.events) event_log::write(event.severity, event.text);
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
  if (output.scene_changed) metrics.make_due_within(realtime::monotonic_ns(), kSceneMetricsNs);
  if (output.name_conflict) {
    exit_code = 2;
    ended = true;
  }
  output.clear();
}

/// Acknowledges in the roster the stops that the servo has obeyed, and saves the cycles before a stop.
void GatewayService::Impl::acknowledge_stops() {
  if (stops.issue_local_stop()) spdlog::warn("emergency stop at this HRTC, by the stop button of a device or a signal");
  if (stops.acknowledge(stops_acknowledged)) membership.on_stops(stops_acknowledged);
  const bool before = std::exchange(stopped, stops.stopped());
  if (stopped && !before) request_flight("emergency stop");
}

void GatewayService::Impl::request_flight(const std::string& reason) {
  FlightRequest request;
  reason.copy(request.reason.data(), request.reason.size() - 1);
  (void)flight_requests.push(request);
}

void GatewayService::Impl::send(session::RosterEntry entry) {
  entry.origin = participants.origin();
  if (roster_out.send(entry) == wire::SendStatus::kInvalid)
    spdlog::error("this HRTC is not in the session: its roster entry is invalid, {}", roster_out.invalid_reason());
}

/// Ticks the gateway between the two halves of the body exchange.
void GatewayService::Impl::tick_gateway(std::int64_t now_ns) {
  exchange.tick(now_ns, membership.clock());
  gateway.tick(now_ns, membership.clock());
  exchange.after_tick();
  if (!gateway.has_new_reports()) return;
  process_reports();
  service_manager.alive(now_ns);  // the haptic thread works, too
}

/// Sends probe states, commands and copies, and heartbeats to the servo while the service thread makes passes. Runs in
/// the sender thread. The haptic thread notifies no thread, so this one wakes by timer after the planned start of each
/// cycle, and every twentieth of a period until the cycle's reports are there.
void GatewayService::Impl::send_states() {
  pthread_setname_np(pthread_self(), "sender");
  prctl(PR_SET_TIMERSLACK, 1000);  // ns; by default ordinary threads wake 50 us late
  const std::int64_t step_ns = options.haptic.period_ns() / 20;
  const auto gap_ns = static_cast<std::int64_t>(1e9 / options.state_rate) - kMs / 2;
  std::int64_t sent_ns = 0;
  MailboxReader<ProbeReports> reports{link.reports};
  ProbeReports latest;
  while (sending) {
    realtime::sleep_until(std::max(latest.next_due_ns, realtime::monotonic_ns()) + step_ns);
    if (realtime::monotonic_ns() - pass_ns.load(std::memory_order_relaxed) < kMaxPassNs) link.beat();
    if (!reports.take(latest)) continue;
    devices.send_commands(latest);
    exchange.send();
    if (latest.time_ns - sent_ns >= gap_ns) {
      sent_ns = latest.time_ns;
      states.send(latest, sender_clock.latest());
    }
    if (reference_timer) reference_timer->usage().sample(realtime::monotonic_ns());
  }
}

void GatewayService::Impl::serve(std::int64_t now_ns) {
  tick_gateway(now_ns);
  measure_first_touch(now_ns);
  acknowledge_stops();
  membership.tick(now_ns);
  process_output();
  send_requests();
  sender_clock.post(membership.clock());
  devices.on_clock(membership.clock().session_time(now_ns) - now_ns);
  shown.tick(now_ns, participants.origin());
  if (metrics.due(now_ns)) send_metrics(all_metrics.due(now_ns));
  devices.open_remote_devices();
  if (now_ns - started_ns > kEarlierUsersNs) devices.remove_earlier_users();
  devices.free_departed();
  if (sync_groups.due(now_ns)) groups.sync(membership.remote_users(), membership.user_ids());
  drain_rings();
  take_snapshots(now_ns);
  if (!membership.has_found_host() && !is_successor) check_for_hosts(now_ns);
}

void GatewayService::Impl::send_requests() {
  const std::int64_t now_ns = realtime::monotonic_ns();
  while (auto demand = gateway.demand(now_ns)) {
    demand->origin = participants.origin();
    (void)demand_out.send(*demand);
  }
  if (auto request = membership.clock_request(realtime::monotonic_ns())) {
    const std::int64_t sent_ns = request->sample.t0_ns;
    request->sample.origin = participants.origin();
    request->sample.t0_ns = sent_ns;
    (void)(request->to_host ? host_clock_out : clock_out).send(request->sample);
  }
}

/// Logs a warning while no host is found, and ends the program after `host_patience`.
void GatewayService::Impl::check_for_hosts(std::int64_t now_ns) {
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

/// Waits until the servo has ended, so that logs and metrics have all of its cycles.
void GatewayService::Impl::end_servo() {
  link.end(exit_code);
  // Nothing notifies of a flag in shared memory. The process of the servo reads `end` every 50 ms.
  constexpr int kMaxWaits = 300;  // of 1 ms
  for (int i = 0; i < kMaxWaits && !link.has_servo_ended(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds{1});
}

void GatewayService::Impl::finish() {
  end_servo();
  sending = false;
  if (sender.joinable()) sender.join();
  reference_timer.reset();
  late_cycles.finish();
  drain_rings();
  if (link.traces_dropped() > 0)
    spdlog::warn("{} cycles are missing in the metrics: the service thread was too slow", link.traces_dropped());
  if (inbox.dropped() > 0) spdlog::warn("{} samples found the inbox full and were dropped", inbox.dropped());
  if (contact_log) {
    for (const Loader::ObjectInfo& object : loader.objects()) contact_log->close(object);
    for (const Loader::ObjectInfo& object : loader.withdrawn_objects()) contact_log->close(object);
    if (link.log_dropped() > 0) spdlog::warn("{} contact log entries were dropped", link.log_dropped());
    if (!contact_log->finish()) {
      spdlog::error("the contact log {} is incomplete: its last entries cannot be written (disk full?)",
                    options.log.string());
      exit_code = 1;
    }
    contact_log.reset();
  }
  // The metrics topic does not repeat lost samples, so the last metrics are sent three times.
  for (int i = 0; i < 3; ++i) {
    send_metrics(true);
    std::this_thread::sleep_for(std::chrono::milliseconds{20});
  }
  wire::send_leave_messages([this] { send(membership.roster_entry(true, realtime::monotonic_ns())); });
}

int GatewayService::Impl::run(const std::atomic<bool>& stop) {
  started_ns = realtime::monotonic_ns();
  if (options.reference_timer)
    reference_timer = std::make_unique<ReferenceTimer>(options.haptic.period_ns(), options.haptic.priority);
  sending = true;
  sender = std::thread{[this] { send_states(); }};
  spdlog::info(
      "{} serves {} probes in session {} on domain {}; pool of {} slots, {:.1f} MiB, and {:.1f} MiB for directories",
      options.address.participant, options.max_users, options.address.session, options.address.domain,
      options.pool.slots, static_cast<double>(options.pool.bytes()) / (1 << 20),
      static_cast<double>(options.directory_bytes) / (1 << 20));
  service_manager.ready();
  // A timer starts each pass, not the arrival of a sample, because the number of samples grows with the square of the
  // session's size. Passes should take only a tenth of a processor. Otherwise they would slow down an overloaded
  // machine more and more: answers arrive later, so prediction looks further ahead and takes more time. The failure
  // detector also runs between passes.
  PeriodicTimer pass{kMinServiceNs}, watch{kMinServiceNs};
  while (!stop && !ended) {
    const std::int64_t before_ns = realtime::monotonic_ns();
    const std::int64_t watch_ns = membership.watch_period_ns();
    if (watch_ns > 0) watch.set_period(watch_ns);
    pass_ns = before_ns;
    auto patience =
        watch_ns > 0 ? std::min(pass.remaining(before_ns), watch.remaining(before_ns)) : pass.remaining(before_ns);
    if (!gateway.send_waiting()) patience = std::min(patience, decltype(patience){kBaseMeshNs / 1000});
    for (const Inbox::Arrived& arrived : inbox.take(patience))
      std::visit([&](const auto& sample) { process(sample, arrived.at_ns); }, arrived.sample);
    const std::int64_t now_ns = realtime::monotonic_ns();
    if (watch_ns > 0 && watch.due(now_ns) && membership.watch_hosts(now_ns)) pass.make_due();
    process_output();
    if (!pass.due(now_ns)) continue;
    serve(now_ns);
    const std::int64_t min_ns = loader.at_rest() ? kMinServiceAtRestNs : kMinServiceNs;
    pass.set_period(std::clamp(kServicePeriodFactor * (realtime::monotonic_ns() - now_ns), min_ns, kMaxServiceNs));
  }
  service_manager.stopping();
  finish();
  return exit_code;
}

GatewayService::GatewayService(const HrtcOptions& options, ServoLink& link, ContactQuery::LogRing* log,
                               const spm::MeshProbe* tool)
    : impl_{std::make_unique<Impl>(options, link, log, tool)} {}
GatewayService::~GatewayService() = default;
int GatewayService::run(const std::atomic<bool>& stop) { return impl_->run(stop); }

}  // namespace tactus::hrtc_service
