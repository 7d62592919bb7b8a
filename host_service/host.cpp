#include "host_service/host.hpp"

#include <algorithm>
#include <chrono>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <variant>

#include "host_service/host_core.hpp"
#include "host_service/model_store.hpp"
#include "realtime/realtime.hpp"
#include "realtime/service_manager.hpp"
#include "session/printable.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace tactus::host_service {

using session::Severity;

namespace {

using realtime::monotonic_ns;
using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr milliseconds kMaxUnmatchedWait{5};  // while readers of an HRTC are not matched
constexpr milliseconds kMaxWait{50};          // otherwise; the loop reads the stop flag at least this often
constexpr milliseconds kMaxLeaveWait{300};    // for acknowledgements of the withdrawn catalogue
constexpr int kMaxChunksPerPass = 64;         // between two reads of the inbox
constexpr std::size_t kInboxCapacity = 8192;

/// A request of an HRTC's failure detector (session/failure_detector.hpp).
struct FailureDetectorRequest {
  session::ClockSample sample;
};
using Sample = std::variant<session::RosterEntry, session::Demand, session::ClockSample, session::EmergencyStop,
                            session::ForceReset, session::SessionEnd, FailureDetectorRequest, session::CatalogueEntry,
                            session::ObjectClaim, session::ObjectPose>;
using Inbox = wire::Inbox<Sample>;

/// The bulk writers to one HRTC.
struct BulkLink {
  BulkLink(wire::Participants& participants, const std::string& hrtc)
      : name{hrtc},
        base{participants, wire::topics::kBase, {wire::hrtc_partition(hrtc)}},
        records{participants, wire::topics::kRecords, {wire::hrtc_partition(hrtc)}} {}

  /// Returns whether the readers are matched. A sample that is sent before is lost.
  [[nodiscard]] bool is_ready() const { return base.matched() > 0 && records.matched() > 0; }
  [[nodiscard]] wire::Writer<session::BulkChunk>& writer_of(const session::BulkChunk& chunk) {
    return chunk.kind() == session::BulkKind::kBase ? base : records;
  }

  std::string name;
  wire::Writer<session::BulkChunk> base, records;
};

/// The endpoints for requests of one HRTC's failure detector, and for the answers.
struct FailureDetectorLink {
  FailureDetectorLink(wire::Participants& participants, const std::string& hrtc, Inbox& inbox)
      : answers{participants, wire::topics::kClock, {wire::hrtc_partition(hrtc)}},
        requests{participants,
                 wire::topics::kClock,
                 [&inbox](session::ClockSample&& sample) { inbox.put(FailureDetectorRequest{std::move(sample)}); },
                 {wire::hrtc_partition(hrtc)}} {}

  wire::Writer<session::ClockSample> answers;
  wire::Reader<session::ClockSample> requests;
};

struct ServedObject {
  ObjectConfig config;
  spm::offline::MappedModel model;
};

void check(const HostOptions& options) {
  if (options.objects.empty()) throw HostError{"nothing to serve: found no model, expected at least one"};
  std::set<std::string> names;
  for (const ObjectConfig& object : options.objects) {
    if (object.name.empty() || object.name.size() > session::kMaxName) {
      throw HostError{"object name '" + object.name + "' has " + std::to_string(object.name.size()) +
                      " bytes, expected 1 to " + std::to_string(session::kMaxName)};
    }
    if (session::has_control_character(object.name))
      throw HostError{"object name '" + object.name + "' has a control character, expected none"};
    if (!names.insert(object.name).second) throw HostError{"two objects have the name '" + object.name + "'"};
  }
}

std::vector<ServedObject> open_models(const HostOptions& options, const Log& log, const std::atomic<bool>& stop) {
  check(options);
  std::vector<std::string> names;
  for (const ObjectConfig& object : options.objects) names.push_back(object.name);
  wire::check_keys(options.address, names);  // before the models are built, which may take minutes
  const ModelStore store{options.cache, [&](const std::string& line) { log(Severity::kInfo, line); }, stop};
  std::vector<ServedObject> served;
  for (const ObjectConfig& object : options.objects) {
    served.push_back({object, store.open(object.model)});
    const spm::ModelSummary& summary = served.back().model.compressed().summary();
    const double longest = spm::longest_side(summary) * summary.metres_per_unit;
    if (!object.size && !object.scale && !spm::is_touchable(longest))
      log(Severity::kWarning, "object '" + object.name + "': the longest side is " + std::to_string(longest) +
                                  " m; if that is wrong, set 'size' or 'scale' in the file of --config");
  }
  return served;
}

/// Raises the priority if requested, and returns the address. Initialises a member, so that it runs before the threads
/// of DDS start, which inherit the priority, and after all models are open. Models are built with the normal priority,
/// because building takes all processors for minutes.
const wire::SessionAddress& address_after_raising_priority(const HostOptions& options, const Log& log) {
  if (options.raise_priority)
    log(Severity::kInfo, realtime::raise_priority("host '" + options.address.participant + "'"));
  return options.address;
}

HostCoreSettings core_settings(const HostOptions& options, const std::vector<ServedObject>& served,
                               std::size_t chunk_bytes) {
  HostCoreSettings settings;
  settings.name = options.address.participant;
  settings.session = options.address.session;
  for (const ServedObject& object : served) settings.objects.push_back({object.config, &object.model.compressed()});
  settings.at = options.at;
  settings.chunk_bytes = chunk_bytes;
  return settings;
}

}  // namespace

struct Host::Impl {
  Impl(HostOptions given, Log log_to_use, const std::atomic<bool>& stop_flag)
      : options{std::move(given)},
        log{std::move(log_to_use)},
        stop{stop_flag},
        served{open_models(options, log, stop)},
        participants{address_after_raising_priority(options, log)},
        core{participants.origin(), core_settings(options, served, participants.chunk_bytes()), monotonic_ns()} {
    core.on_event = [this](Severity severity, const std::string& text) { log(severity, text); };
    core.on_receiver = [this](std::uint64_t id, const std::string& name) {
      bulk.try_emplace(id, participants, name);
      failure_detectors.try_emplace(id, participants, name, inbox);
    };
    core.on_receiver_gone = [this](std::uint64_t id) {
      bulk.erase(id);
      failure_detectors.erase(id);
    };
    if (!core.authority().empty()) {
      listen(wire::topics::kCatalogue);
      listen(wire::topics::kObjectClaim);
      listen(wire::topics::kObjectPose);
      grants_out.emplace(participants, wire::topics::kObjectGrant);
      poses_out.emplace(participants, wire::topics::kObjectPose);
    }
    listen(wire::topics::kRoster);
    listen(wire::topics::kDemand);
    listen(wire::topics::kClock);
    listen(wire::topics::kStop);
    listen(wire::topics::kReset);
    listen(wire::topics::kEnd);
  }

  template <class T>
  void listen(const wire::TopicSpec<T>& topic) {
    readers.push_back(std::make_shared<wire::Reader<T>>(participants, topic, [this](T&& sample) {
      inbox.put(std::move(sample), wire::kIsSentOnce<T> ? wire::Urgency::kMustArrive : wire::Urgency::kWakes);
    }));
  }

  int run();
  void on_sample(const session::RosterEntry& entry, std::int64_t at_ns) { core.on_roster(entry, at_ns); }
  void on_sample(const session::Demand& demand, std::int64_t at_ns) { core.on_demand(demand, at_ns); }
  void on_sample(const session::ClockSample& sample, std::int64_t at_ns) {
    if (const auto answer = core.on_clock(sample, at_ns, monotonic_ns())) (void)clock_out.send(*answer);
  }
  void on_sample(const FailureDetectorRequest& request, std::int64_t at_ns) {
    const auto link = failure_detectors.find(request.sample.origin.participant);
    if (link == failure_detectors.end()) return;
    if (const auto answer = core.on_failure_detector(request.sample, at_ns, monotonic_ns()))
      (void)link->second.answers.send(*answer);
  }
  void on_sample(const session::EmergencyStop& sample, std::int64_t) { core.on_stop(sample); }
  void on_sample(const session::ForceReset& reset, std::int64_t) { core.on_reset(reset); }
  void on_sample(const session::SessionEnd& end, std::int64_t) { core.on_end(end); }
  void on_sample(const session::CatalogueEntry& entry, std::int64_t) { core.on_catalogue(entry); }
  void on_sample(const session::ObjectClaim& claim, std::int64_t at_ns) { core.on_claim(claim, at_ns); }
  void on_sample(const session::ObjectPose& pose, std::int64_t at_ns) { core.on_pose(pose, at_ns); }

  void send(const HostMessages& messages);
  [[nodiscard]] microseconds send_chunks();
  void send_catalogue(bool withdrawn);
  void leave();
  void log_info(const std::string& line) const { log(Severity::kInfo, line); }

  HostOptions options;
  Log log;
  const std::atomic<bool>& stop;
  std::vector<ServedObject> served;  // declared before the members that borrow from it
  wire::Participants participants;
  HostCore core;
  std::optional<wire::Writer<session::ObjectGrant>> grants_out;  // if there are movable objects
  std::optional<wire::Writer<session::ObjectPose>> poses_out;
  wire::Writer<session::RosterEntry> roster_out{participants, wire::topics::kRoster};
  wire::Writer<session::CatalogueEntry> catalogue_out{participants, wire::topics::kCatalogue};
  wire::Writer<session::ClockSample> clock_out{participants, wire::topics::kClock};
  wire::Writer<session::Metrics> metrics_out{participants, wire::topics::kMetrics};
  std::map<std::uint64_t, BulkLink> bulk;  // by HRTC
  Inbox inbox{kInboxCapacity};
  std::map<std::uint64_t, FailureDetectorLink>
      failure_detectors;                       // by HRTC; after the inbox, which their callbacks fill
  std::vector<std::shared_ptr<void>> readers;  // last, so that no callback outlives the inbox
};

int Host::Impl::run() {
  for (const session::CatalogueEntry& entry : core.catalogue()) {
    log_info("serving '" + entry.object + "': " + std::to_string(entry.summary.faces) + " faces in " +
             std::to_string(entry.summary.regions) + " regions, base mesh of " + std::to_string(entry.base_bytes) +
             " bytes");
  }
  log_info("host '" + options.address.participant + "' is in session '" + options.address.session + "' on domain " +
           std::to_string(options.address.domain));
  realtime::ServiceManager service_manager;
  service_manager.ready();
  microseconds max_wait{0};
  while (!stop && core.end() == HostEnd::kNone) {
    for (const Inbox::Arrived& arrived : inbox.take(max_wait))
      std::visit([&](const auto& sample) { on_sample(sample, arrived.at_ns); }, arrived.sample);
    send(core.tick(monotonic_ns()));
    max_wait = send_chunks();
    service_manager.alive(monotonic_ns());
  }
  service_manager.stopping();
  if (stop) log_info("stopped by a signal");
  leave();
  return core.end() == HostEnd::kNameTaken ? 2 : 0;
}

void Host::Impl::send(const HostMessages& messages) {
  if (messages.catalogue) send_catalogue(false);
  if (messages.roster) (void)roster_out.send(*messages.roster);
  if (messages.clock_request) (void)clock_out.send(*messages.clock_request);
  if (messages.metrics) (void)metrics_out.send(*messages.metrics);
  for (const session::ObjectGrant& grant : messages.grants) (void)grants_out->send(grant);
  for (const session::ObjectPose& pose : messages.poses) (void)poses_out->send(pose);
}

/// Sends chunks that are due, at most kMaxChunksPerPass. Returns the time for which the caller may wait for samples.
microseconds Host::Impl::send_chunks() {
  const bool has_unmatched =
      std::any_of(bulk.begin(), bulk.end(), [](const auto& link) { return !link.second.is_ready(); });
  const auto can_send = [&](std::uint64_t hrtc) {
    const auto link = bulk.find(hrtc);
    return link != bulk.end() && link->second.is_ready();
  };
  for (int i = 0; i < kMaxChunksPerPass; ++i) {
    const std::int64_t now_ns = monotonic_ns();
    const std::optional<session::Outgoing> out = core.next_chunk(now_ns, can_send);
    if (!out) {
      const microseconds due{std::max<std::int64_t>(0, core.due_ns() - now_ns) / 1000};
      return std::min<microseconds>(due, has_unmatched ? kMaxUnmatchedWait : kMaxWait);
    }
    BulkLink& link = bulk.at(out->hrtc);
    wire::Writer<session::BulkChunk>& writer = link.writer_of(out->chunk);
    // A blocked chunk is no error, because the next demand lists the chunks that did not arrive.
    if (writer.send(out->chunk) == wire::SendStatus::kInvalid)
      log(Severity::kError, "a chunk for '" + link.name + "' cannot be sent: " + writer.invalid_reason());
  }
  return microseconds{0};
}

void Host::Impl::send_catalogue(bool withdrawn) {
  for (session::CatalogueEntry entry : core.catalogue()) {
    entry.origin = participants.origin();
    entry.withdrawn = withdrawn;
    const wire::SendStatus status = catalogue_out.send(entry);
    if (status == wire::SendStatus::kSent) continue;
    const std::string reason =
        status == wire::SendStatus::kInvalid ? catalogue_out.invalid_reason() : "the history of the writer is full";
    log(Severity::kError, "the catalogue entry of '" + entry.object + "' cannot be sent: " + reason);
  }
}

void Host::Impl::leave() {
  send_catalogue(true);
  (void)metrics_out.send(core.metrics(monotonic_ns()));
  wire::send_leave_messages([this] {
    session::RosterEntry entry = core.roster_entry(monotonic_ns());
    entry.leaving = true;
    (void)roster_out.send(entry);
  });
  (void)catalogue_out.wait_acknowledged(kMaxLeaveWait);
  const session::DeliveryCounters& all = core.delivery().counters();
  log_info("left the session after sending " + std::to_string(all.regions) + " regions with " +
           std::to_string(all.records) + " records; " + std::to_string(all.payload_bytes) + " bytes with base meshes");
}

Host::Host(HostOptions options, Log log, const std::atomic<bool>& stop)
    : impl_{std::make_unique<Impl>(std::move(options), std::move(log), stop)} {}
Host::~Host() = default;
int Host::run() { return impl_->run(); }

}  // namespace tactus::host_service
