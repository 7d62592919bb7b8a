#include "host_service/host.hpp"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <variant>

#include "host_service/model_store.hpp"
#include "host_service/object_authority.hpp"
#include "host_service/scenery.hpp"
#include "session/clock.hpp"
#include "session/delivery_server.hpp"
#include "session/figures.hpp"
#include "session/periodic.hpp"
#include "session/roster.hpp"
#include "session/stop_latch.hpp"
#include "session/time_reference.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"
#include "wire/realtime.hpp"

namespace tactus::host_service {
namespace {

using session::Every;
using std::chrono::microseconds;
using std::chrono::milliseconds;
using wire::monotonic_ns;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kHeartbeatNs = 100 * kMs;
constexpr std::int64_t kClockNs = 500 * kMs;
constexpr std::int64_t kMetricsNs = 1000 * kMs;
constexpr std::int64_t kHungNs = 5000 * kMs;  // after which others may have forgotten what it serves
constexpr std::int64_t kMetricsSoonNs = 100 * kMs;
constexpr milliseconds kPoll{5};        // while an HRTC's readers are not found yet
constexpr milliseconds kPatience{50};   // so soon a signal is noticed
constexpr milliseconds kStep{1};        // while an object moves by itself
constexpr milliseconds kHeld{5};        // while somebody holds one
constexpr milliseconds kFarewell{300};  // for the catalogue's last words to arrive
constexpr int kChunksPerRound = 64;     // then demands are looked at again
constexpr std::size_t kInboxCapacity = 8192;
constexpr double kGap = 0.05;  // m, between objects that are given no pose

/// A question of one HRTC, which watches over this host (session/failure_detector.hpp).
struct Question {
  session::ClockSample sample;
};
using Sample = std::variant<session::RosterEntry, session::Demand, session::ClockSample, session::EmergencyStop,
                            session::ForceReset, session::SessionEnd, Question, session::CatalogueEntry,
                            session::ObjectClaim, session::ObjectPose>;
using Inbox = wire::Inbox<Sample>;
/// The bulk writers of one HRTC.
struct BulkLink {
  BulkLink(wire::Participants& participants, const std::string& hrtc)
      : name{hrtc},
        base{participants, wire::topics::kBase, {wire::hrtc_partition(hrtc)}},
        records{participants, wire::topics::kRecords, {wire::hrtc_partition(hrtc)}} {}

  /// What is sent before the readers are found is lost.
  [[nodiscard]] bool ready() const { return base.matched() > 0 && records.matched() > 0; }
  [[nodiscard]] wire::SendStatus send(const session::BulkChunk& chunk) {
    return (chunk.kind() == session::BulkKind::kBase ? base : records).send(chunk);
  }

  std::string name;
  wire::Writer<session::BulkChunk> base, records;
};

/// Where one HRTC asks whether this host lives, and is told.
struct FailureDetectorLink {
  FailureDetectorLink(wire::Participants& participants, const std::string& hrtc, Inbox& inbox)
      : answers{participants, wire::topics::kClock, {wire::hrtc_partition(hrtc)}},
        questions{participants,
                  wire::topics::kClock,
                  [&inbox](session::ClockSample&& sample) { inbox.put(Question{std::move(sample)}); },
                  {wire::hrtc_partition(hrtc)}} {}

  wire::Writer<session::ClockSample> answers;
  wire::Reader<session::ClockSample> questions;
};

struct Served {
  ObjectConfig config;
  spm::offline::MappedModel model;
};

double scale_of(const Served& served) {
  const spm::ModelSummary& s = served.model.summary();
  if (served.config.scale) return *served.config.scale;
  if (!served.config.size) return s.metres_per_unit;
  double longest = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    longest = std::max(longest, double{s.bounds_max[axis]} - s.bounds_min[axis]);
  }
  return *served.config.size / longest;
}

void check(const HostOptions& options) {
  if (options.objects.empty()) throw HostError{"nothing to serve: found no model, expected at least one"};
  std::set<std::string> names;
  for (const ObjectConfig& object : options.objects) {
    if (object.name.empty() || object.name.size() > session::kMaxName) {
      throw HostError{"object name '" + object.name + "' has " + std::to_string(object.name.size()) +
                      " bytes, expected 1 to " + std::to_string(session::kMaxName)};
    }
    if (!names.insert(object.name).second) throw HostError{"two objects are called '" + object.name + "'"};
  }
}

std::vector<Served> open_models(const HostOptions& options, const Log& log, const std::atomic<bool>& stop) {
  check(options);
  const ModelStore store{options.cache, [&](const std::string& line) { log(Severity::kInfo, line); }, stop};
  std::vector<Served> served;
  for (const ObjectConfig& object : options.objects) served.push_back({object, store.open(object.model)});
  return served;
}

/// Once the models are there, which may have taken all processors for minutes.
const wire::SessionAddress& in_turn(const HostOptions& options, const Log& log) {
  if (options.before_others) log(Severity::kInfo, wire::go_before_others("host '" + options.address.participant + "'"));
  return options.address;
}

}  // namespace

struct Host::Impl {
  Impl(HostOptions given, Log to, const std::atomic<bool>& until)
      : options{std::move(given)},
        log{std::move(to)},
        stop{until},
        served{open_models(options, log, stop)},
        participants{in_turn(options, log)} {
    for (const Served& object : served) {
      server.add(session::id_of(object.config.name), object.model.coded());
    }
    make_catalogue();
    for (const session::CatalogueEntry& entry : catalogue) object_authority.add(entry, started_ns);
    if (!object_authority.empty()) {
      make_scenery();
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
    readers.push_back(
        std::make_shared<wire::Reader<T>>(participants, topic, [this](T&& sample) { inbox.put(std::move(sample)); }));
  }

  void make_catalogue();
  void make_scenery();
  int run();
  void take(const Inbox::Arrived& arrived);
  void take(const session::RosterEntry& entry, std::int64_t at_ns);
  void take(const session::Demand& demand, std::int64_t at_ns);
  void take(const session::ClockSample& sample, std::int64_t at_ns);
  void take(const session::EmergencyStop& sample, std::int64_t) { (void)stops.on_stop(sample.name()); }
  void take(const session::ForceReset& reset, std::int64_t) { (void)stops.on_reset(reset); }
  void take(const session::SessionEnd& end, std::int64_t at_ns);
  void take(const Question& question, std::int64_t at_ns);
  void take(const session::CatalogueEntry& entry, std::int64_t at_ns) { object_authority.on_catalogue(entry, at_ns); }
  void take(const session::ObjectClaim& claim, std::int64_t at_ns) { object_authority.on_claim(claim, at_ns); }
  void take(const session::ObjectPose& pose, std::int64_t at_ns) {
    object_authority.on_pose(pose, at_ns, clock.map().session_time(at_ns));
  }
  void react(const session::RosterEvent& event, std::int64_t now_ns);
  void keep_time(std::int64_t now_ns);
  [[nodiscard]] microseconds send_chunks(std::int64_t now_ns);
  [[nodiscard]] microseconds keep_objects(std::int64_t now_ns);
  void send_roster(bool leaving);
  void send_catalogue(bool withdrawn);
  void send_metrics();
  void leave();
  void say(const std::string& line) const { log(Severity::kInfo, line); }

  HostOptions options;
  Log log;
  const std::atomic<bool>& stop;
  std::vector<Served> served;  // before what borrows from it
  wire::Participants participants;
  session::DeliveryServer server{participants.origin()};
  session::Roster roster{participants.origin(), {}};
  session::SessionClock clock{participants.origin(), {}, monotonic_ns()};
  std::optional<Scenery> scenery;  // when it has objects that move, and others
  ObjectAuthority object_authority{participants.origin()};
  std::optional<wire::Writer<session::ObjectGrant>> grants_out;  // when it has objects that move
  std::optional<wire::Writer<session::ObjectPose>> poses_out;
  std::vector<session::CatalogueEntry> catalogue;
  wire::Writer<session::RosterEntry> roster_out{participants, wire::topics::kRoster};
  wire::Writer<session::CatalogueEntry> catalogue_out{participants, wire::topics::kCatalogue};
  wire::Writer<session::ClockSample> clock_out{participants, wire::topics::kClock};
  wire::Writer<session::Metrics> metrics_out{participants, wire::topics::kMetrics};
  std::map<std::uint64_t, BulkLink> bulk;  // by HRTC
  Inbox inbox{kInboxCapacity};
  std::map<std::uint64_t, FailureDetectorLink>
      failure_detectors;  // by HRTC; after the inbox, which their callbacks fill
  std::int64_t started_ns = monotonic_ns();
  std::uint64_t heartbeat = 0;
  session::Heartbeat beat{kHeartbeatNs};
  session::StopLatch stops{participants.origin()};  // for HRTCs that start after a stop
  std::uint64_t stops_announced = 0;                // StopLatch::changes
  Every metrics_due{kMetricsNs};
  std::uint64_t demands_refused = 0, demands_implausible = 0;
  bool ended = false;
  int exit_code = 0;
  std::vector<std::shared_ptr<void>> readers;  // last: their callbacks fill the inbox
};

void Host::Impl::make_catalogue() {
  double x = options.at[0];  // where the next object without a pose begins
  bool first = true;
  for (const Served& object : served) {
    const spm::ModelSummary& summary = object.model.summary();
    session::CatalogueEntry entry;
    entry.host = options.address.participant;
    entry.object = object.config.name;
    entry.object_id = session::id_of(entry.object);
    entry.summary = summary;
    entry.scale = scale_of(object);
    entry.material = object.config.material;
    entry.base_bytes = server.base_bytes(entry.object_id);
    entry.surface = spm::surface_points(object.model.coded().base(), session::kMaxSurfacePoints);
    if (const std::optional<BodyConfig>& body = object.config.body)
      entry.body = {body->mass, body->inertia.value_or(sharing::inertia_of_bounds(summary, entry.scale, body->mass)),
                    body->friction, body->ground};
    if (object.config.pose) {
      entry.pose = *object.config.pose;
    } else {
      entry.pose.position = options.at;
      if (!first) entry.pose.position[0] = x - summary.bounds_min[0] * entry.scale;
      x = entry.pose.position[0] + summary.bounds_max[0] * entry.scale + kGap;
      first = false;
    }
    catalogue.push_back(entry);
  }
}

/// What its bodies meet beside the ground.
void Host::Impl::make_scenery() {
  std::vector<StandingObject> standing;
  for (std::size_t i = 0; i < served.size(); ++i)
    if (!sharing::can_move(catalogue[i]))
      standing.push_back({catalogue[i].pose, catalogue[i].scale, &served[i].model.coded()});
  if (standing.empty()) return;
  scenery.emplace(standing);
  object_authority.stand_among(&*scenery);
}

int Host::Impl::run() {
  for (const session::CatalogueEntry& entry : catalogue) {
    say("serving '" + entry.object + "': " + std::to_string(entry.summary.faces) + " faces in " +
        std::to_string(entry.summary.regions) + " regions, base mesh of " + std::to_string(entry.base_bytes) +
        " bytes");
  }
  say("host '" + options.address.participant + "' is in session '" + options.address.session + "' on domain " +
      std::to_string(options.address.domain));
  send_catalogue(false);
  Every request{kClockNs};
  microseconds patience{0};
  std::int64_t looked_ns = monotonic_ns();
  while (!stop && !ended) {
    for (const Inbox::Arrived& arrived : inbox.take(patience)) take(arrived);
    const std::int64_t now_ns = monotonic_ns();
    if (now_ns - looked_ns > kHungNs) send_catalogue(false);  // DDS has not lost it, so sends nothing again by itself
    looked_ns = now_ns;
    for (const session::RosterEvent& event : roster.tick(now_ns)) react(event, now_ns);
    keep_time(now_ns);
    if (std::exchange(stops_announced, stops.changes()) != stops.changes()) beat.at_once();
    if (beat.due(now_ns)) send_roster(false);
    const bool follows = clock.reference() != 0 && clock.reference() != participants.origin().participant;
    if (follows && request.due(now_ns)) (void)clock_out.send(clock.request(now_ns));
    if (metrics_due.due(now_ns)) send_metrics();
    const microseconds objects_due = keep_objects(now_ns);
    patience = std::min(objects_due, send_chunks(now_ns));
  }
  if (stop) say("asked to stop");
  leave();
  return exit_code;
}

void Host::Impl::take(const Inbox::Arrived& arrived) {
  std::visit([&](const auto& sample) { take(sample, arrived.at_ns); }, arrived.sample);
}

void Host::Impl::take(const session::RosterEntry& entry, std::int64_t at_ns) {
  if (stops.on_roster(entry)) log(Severity::kWarning, "emergency stop: " + session::text(entry) + " has it");
  for (const session::RosterEvent& event : roster.on_entry(entry, at_ns)) react(event, at_ns);
  const session::RosterEntry* const known = roster.find(entry.origin.participant);
  if (known != nullptr && known->role == session::Role::kHost)
    object_authority.on_host(known->origin.participant, known->joined_ns, at_ns);
}

void Host::Impl::react(const session::RosterEvent& event, std::int64_t now_ns) {
  using session::RosterChange;
  const session::RosterEntry& entry = event.entry;
  const std::uint64_t id = entry.origin.participant;
  const bool trouble = event.change == RosterChange::kWrongVersion || event.change == RosterChange::kNameConflict ||
                       event.change == RosterChange::kFull;
  if (event.change != RosterChange::kChanged) {
    log(trouble ? Severity::kWarning : Severity::kInfo, session::text(event));
  }
  if (event.change == RosterChange::kNameConflict && id == participants.origin().participant && event.entry_yields) {
    log(Severity::kError, "a host '" + options.address.participant + "' was in session '" + options.address.session +
                              "' before: this one ends; start it with another --name");
    exit_code = 2;
    ended = true;
  }
  metrics_due.hasten(now_ns, kMetricsSoonNs);  // whoever compares scenes need not wait long
  if (entry.role == session::Role::kHost &&
      (event.change == RosterChange::kLeft || event.change == RosterChange::kGone))
    object_authority.on_host_gone(id, now_ns);
  if (entry.role != session::Role::kHrtc) return;
  if (event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted) {
    beat.insist();  // it asks for nothing before it knows of us
    bulk.try_emplace(id, participants, entry.name);
    failure_detectors.try_emplace(id, participants, entry.name, inbox);
  } else if (event.change == RosterChange::kLeft || event.change == RosterChange::kGone) {
    server.on_hrtc_gone(id);
    object_authority.on_hrtc_gone(id);
    bulk.erase(id);
    failure_detectors.erase(id);
  }
}

void Host::Impl::take(const session::Demand& demand, std::int64_t at_ns) {
  using Result = session::DeliveryServer::DemandResult;
  const Result result = server.on_demand(demand, at_ns);
  if (result == Result::kImplausible) ++demands_implausible;
  if (result == Result::kMalformed && demands_refused++ == 0) {
    log(Severity::kWarning,
        "a demand names regions that its model does not have; such demands are dropped and counted");
  }
}

void Host::Impl::take(const session::ClockSample& sample, std::int64_t at_ns) {
  if (sample.peer != participants.origin().participant) return;
  if (sample.answer) {
    clock.on_answer(sample, at_ns);
  } else if (clock.answers()) {
    (void)clock_out.send(clock.answer(sample, at_ns, monotonic_ns()));
  }
}

void Host::Impl::take(const Question& question, std::int64_t at_ns) {
  const auto link = failure_detectors.find(question.sample.origin.participant);
  if (link == failure_detectors.end() || question.sample.answer ||
      question.sample.peer != participants.origin().participant)
    return;
  session::ClockSample answer = clock.answer(question.sample, at_ns, monotonic_ns());
  if (!clock.answers()) answer.t1_ns = answer.t2_ns = session::kClockUnknown;  // a sign of life, but no time
  (void)link->second.answers.send(answer);
}

void Host::Impl::take(const session::SessionEnd& end, std::int64_t) {
  say("the session ends" + (end.text.empty() ? std::string{} : ": " + end.text));
  ended = true;
}

void Host::Impl::keep_time(std::int64_t now_ns) {
  session::keep_time(roster, participants.origin(), session::Role::kHost, false, now_ns, clock);
  object_authority.on_host(participants.origin().participant, clock.joined_ns(), now_ns);
}

/// Moves what nobody holds, tells of it, and says how long that may wait.
microseconds Host::Impl::keep_objects(std::int64_t now_ns) {
  if (object_authority.empty()) return kPatience;
  const ObjectAuthority::Messages& messages = object_authority.tick(now_ns, clock.map().session_time(now_ns));
  for (const session::ObjectGrant& grant : messages.grants) (void)grants_out->send(grant);
  // Until this program's time is the session's, a pose would state a time that nobody can compare with another.
  if (clock.synchronised())
    for (const session::ObjectPose& pose : messages.poses) (void)poses_out->send(pose);
  return object_authority.busy() ? kStep : object_authority.held() ? kHeld : kPatience;
}

/// Sends what is due and says how long to wait for news.
microseconds Host::Impl::send_chunks(std::int64_t now_ns) {
  const bool pending = std::any_of(bulk.begin(), bulk.end(), [](const auto& link) { return !link.second.ready(); });
  const auto can_send = [&](std::uint64_t hrtc) {
    const auto link = bulk.find(hrtc);
    return link != bulk.end() && link->second.ready();
  };
  for (int i = 0; i < kChunksPerRound; ++i, now_ns = monotonic_ns()) {
    std::optional<session::Outgoing> out = server.next(now_ns, can_send);
    if (!out) {
      const microseconds due{std::max<std::int64_t>(0, server.due_ns() - now_ns) / 1000};
      return std::min<microseconds>(due, pending ? kPoll : kPatience);
    }
    BulkLink& link = bulk.at(out->hrtc);
    // What the network does not take is lost, and the demand will say so.
    if (link.send(out->chunk) == wire::SendStatus::kInvalid)
      log(Severity::kError, "a chunk for '" + link.name + "' cannot be sent: " + link.records.last_fault());
  }
  return microseconds{0};
}

void Host::Impl::send_roster(bool leaving) {
  session::RosterEntry entry;
  entry.origin = participants.origin();
  entry.role = session::Role::kHost;
  entry.name = options.address.participant;
  entry.session = options.address.session;
  entry.heartbeat = ++heartbeat;
  entry.leaving = leaving;
  entry.stops = stops.records();
  session::put_time(clock, false, monotonic_ns(), entry);
  (void)roster_out.send(entry);
}

void Host::Impl::send_catalogue(bool withdrawn) {
  for (session::CatalogueEntry& entry : catalogue) {
    entry.origin = participants.origin();
    entry.withdrawn = withdrawn;
    if (catalogue_out.send(entry) == wire::SendStatus::kSent) continue;
    log(Severity::kError, "'" + entry.object + "' cannot be announced: " + catalogue_out.last_fault());
  }
}

void Host::Impl::send_metrics() {
  namespace names = session::figures;
  const session::DeliveryCounters& all = server.counters();
  session::Metrics metrics;
  metrics.origin = participants.origin();
  metrics.scene = session::scene_hash(roster, participants.origin(), session::Role::kHost);
  const auto add = [&](const std::string& name, double value) {
    if (metrics.figures.size() < session::kMaxFigures) {
      metrics.figures.push_back({name.substr(0, session::kMaxName), value});
    }
  };
  add(names::kHostObjects, static_cast<double>(catalogue.size()));
  add(names::kHostChunks, static_cast<double>(all.chunks));
  add(names::kHostBytes, static_cast<double>(all.payload_bytes));
  add(names::kHostRegions, static_cast<double>(all.regions));
  add(names::kHostRecords, static_cast<double>(all.records));
  add(names::kHostControllers, static_cast<double>(bulk.size()));
  add(names::kHostImplausible,
      static_cast<double>(roster.implausible() + demands_implausible + object_authority.implausible()));
  if (!object_authority.empty()) add(names::kHostBodySteps, static_cast<double>(object_authority.steps()));
  for (const auto& [id, counters] : server.counters_by_hrtc()) {
    const auto link = bulk.find(id);
    if (link == bulk.end()) continue;
    add(names::kHostBytes + ("." + link->second.name), static_cast<double>(counters.payload_bytes));
    add(names::kHostRecords + ("." + link->second.name), static_cast<double>(counters.records));
  }
  (void)metrics_out.send(metrics);
}

void Host::Impl::leave() {
  send_catalogue(true);
  send_metrics();
  wire::send_leave_messages([this] { send_roster(true); });
  (void)catalogue_out.wait_acknowledged(kFarewell);
  const session::DeliveryCounters& all = server.counters();
  say("left the session after sending " + std::to_string(all.regions) + " regions with " + std::to_string(all.records) +
      " records, " + std::to_string(all.payload_bytes) + " bytes");
}

Host::Host(HostOptions options, Log log, const std::atomic<bool>& stop)
    : impl_{std::make_unique<Impl>(std::move(options), std::move(log), stop)} {}
Host::~Host() = default;
int Host::run() { return impl_->run(); }
const std::vector<session::CatalogueEntry>& Host::catalogue() const noexcept { return impl_->catalogue; }

}  // namespace tactus::host_service
