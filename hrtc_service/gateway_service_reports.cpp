// The service thread of an HRTC evaluates the reports of the haptic thread. It publishes metrics, logs events and takes
// snapshots.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "hrtc_service/gateway_service_impl.hpp"
#include "realtime/periodic_clock.hpp"

namespace tactus::hrtc_service {
namespace {

bool touches_exactly(const ProbeReports& reports) {
  constexpr std::uint32_t kTouching = session::kInContact | session::kExact;
  return std::any_of(reports.probes.begin(), reports.probes.end(),
                     [](const ProbeOutput& probe) { return (probe.status & kTouching) == kTouching; });
}

}  // namespace

void GatewayService::Impl::send_metrics(bool with_percentiles) {
  namespace names = session::figures;
  session::Metrics sample;
  sample.origin = participants.origin();
  sample.scene = session::scene_hash(membership.roster(), participants.origin(), session::Role::kHrtc);
  statistics.add_figures(sample.figures, with_percentiles);
  if (with_percentiles && !timer_samples.empty()) {
    sample.figures.push_back({names::kTimerP50, timer_samples.percentile(0.5) * 1e-3});
    sample.figures.push_back({names::kTimerP99, timer_samples.percentile(0.99) * 1e-3});
    sample.figures.push_back({names::kTimerMax, timer_samples.percentile(1) * 1e-3});
  }
  if (reference_timer != nullptr)
    sample.figures.push_back({names::kTimerOverruns, static_cast<double>(reference_timer->overruns())});
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
      {names::kRecordsReceivedAgain, static_cast<double>(figures.records_received_again)},
      {names::kRecordsRepeated, static_cast<double>(figures.records_repeated)},
      {names::kRecordsRepeatedUnretired, static_cast<double>(figures.records_repeated_unretired)},
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
  const MeshHashes& hashes = mesh_hashes.latest();
  for (const Loader::ObjectInfo& object : loader.objects()) sample.meshes.push_back({object.id, hashes[object.index]});
  (void)metrics_out.send(sample);
  sample.meshes.clear();
  sample.figures = membership.remote_users().losses();
  if (!sample.figures.empty()) (void)losses_out.send(sample);
}

void GatewayService::Impl::process_reports() {
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

/// Logs the costs of an overrun, at most one line in each second.
void GatewayService::Impl::log_overrun(const CycleTrace& trace, const LateVerdict& verdict) {
  ++overruns_unlogged;
  if (!overrun_logged.due(realtime::monotonic_ns())) return;
  const CycleCosts& costs = trace.costs;
  const auto us = [](auto ns) { return ns / 1000; };
  spdlog::warn(
      "overrun{}: {} us from start to end, the thread itself computed or was blocked for at least {} us; in this and "
      "neighbouring cycles blocked {} times, {} minor and {} major page faults; loading {} us, refinement {} us ({} "
      "list entries visited, {} splits, collapses and base faces), refit {} us, "
      "query {} us, forces {} us; {} arrivals; {} of {} probes in contact",
      overruns_unlogged == 1 ? std::string{} : fmt::format(" ({} since the last line)", overruns_unlogged),
      us(trace.times.end_ns - trace.times.began_ns), us(verdict.own_ns), verdict.blocked, verdict.minor_faults,
      verdict.major_faults, us(costs.load), us(costs.refine), costs.visits, costs.changes, us(costs.refit),
      us(costs.query), us(costs.force), costs.arrivals, trace.in_contact, trace.active);
  overruns_unlogged = 0;
}

void GatewayService::Impl::classify_late_cycles() {
  for (ThreadUsage usage; usages.pop(usage);) late_cycles.add(usage);
  while (const std::optional<LateVerdict> verdict = late_cycles.next()) {
    statistics.add(verdict->late_class);
    if (verdict->late_class == LateClass::kOverrun) log_overrun(late_traces.front(), *verdict);
    late_traces.pop_front();
  }
}

void GatewayService::Impl::drain_rings() {
  CycleTrace trace;
  while (traces.pop(trace)) {
    statistics.add(trace);
    if (trace.targets_dropped && targets_logged.due(realtime::monotonic_ns()))
      spdlog::warn(
          "the mesh near a probe remains partly coarse: more than {} regions of an object need refinement, or the "
          "probe "
          "spans more than {} cells of the grid; raise --targets, or build the model with larger cells (tactus mesh "
          "build --cell-faces)",
          options.servo.cycle.targets, spm::RegionGrid::kMaxCells);
    late_cycles.add(trace.times);
    if (trace.times.late()) late_traces.push_back(trace);
  }
  classify_late_cycles();
  if (reference_timer) reference_timer->drain(timer_samples);
  if (contact_log && !contact_log->drain()) {
    spdlog::error("the contact log {} cannot be written any more (disk full?); the session goes on without it",
                  options.log.string());
    contact_log.reset();
    exit_code = 1;
  }
}

void GatewayService::Impl::take_snapshots(std::int64_t now_ns) {
  if (!snapshots) return;
  try {
    snapshots->tick(now_ns, touches_exactly(gateway.reports()), gateway.reported_probes());
  } catch (const std::runtime_error& error) {
    spdlog::error("{}", error.what());
    exit_code = 1;
    snapshots.reset();
  }
}

void GatewayService::Impl::measure_first_touch(std::int64_t now_ns) {
  if (first.base_ns == 0 && !loader.objects().empty()) first.base_ns = now_ns;
  if (first.exact_ns != 0 || first.catalogue_ns == 0 || !touches_exactly(gateway.reports())) return;
  first.exact_ns = gateway.reports().time_ns;
  first.bytes = loader.delivery_counters().payload_bytes;
}

void GatewayService::Impl::log_fault(std::uint32_t probe, std::uint32_t status) {
  const std::uint32_t fault = status & (session::kFault | session::kFaultReason);
  if (fault == link.exchange_fault_logged(probe, fault)) return;
  const std::string user = membership.has_user(probe) ? "user " + membership.name_at(probe) : "a user that has left";
  if ((fault & session::kFault) != 0) {
    spdlog::warn("the force of {} is off until a reset: {}", user, session::fault_reason(status));
    request_flight(session::fault_reason(status));
  } else if (membership.has_user(probe)) {
    spdlog::info("the force of {} is on again", user);
  }
}

void GatewayService::Impl::log_hold(std::uint32_t probe, const ProbeOutput& output) {
  constexpr std::uint32_t kHold = session::kHolding | session::kHoldRefused;
  const std::uint32_t now = output.status & kHold, before = std::exchange(holds_logged[probe], now);
  if (now == before || !membership.has_user(probe)) return;
  std::string name = "something";
  for (const Loader::ObjectInfo& object : loader.objects())
    if (object.index == output.object) name = "'" + object.name + "'";
  if ((now & session::kHolding) != 0) {
    spdlog::info("user {} holds {}", membership.name_at(probe), name);
  } else if ((before & session::kHolding) != 0) {
    spdlog::info("user {} no longer holds the object", membership.name_at(probe));
  } else if ((now & session::kHoldRefused) != 0) {
    spdlog::warn(
        "user {} cannot hold {}: the object is not movable, the user's force is off, or the grab button was not "
        "released after the hand lost the object",
        membership.name_at(probe), name);
  }
}

}  // namespace tactus::hrtc_service
