#include "host_service/host_core.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "session/figures.hpp"
#include "session/time_reference.hpp"
#include "session/units.hpp"
#include "sharing/body.hpp"

namespace tactus::host_service {

using session::Severity;

namespace {

constexpr std::int64_t kHeartbeatNs = 100 * kMs;
constexpr std::int64_t kClockRequestNs = 500 * kMs;
constexpr std::int64_t kMetricsNs = 1000 * kMs;
constexpr std::int64_t kMetricsSoonNs = 100 * kMs;
constexpr std::int64_t kHungNs = 5000 * kMs;  // min time between two ticks that counts as a hang
constexpr std::int64_t kStepNs = 1 * kMs;     // period while it simulates a moving object
constexpr std::int64_t kHeldNs = 5 * kMs;     // period while an HRTC holds an object
constexpr double kSpacing = 0.05;             // m, between objects without a pose

double scale_of(const ObjectConfig& config, const spm::ModelSummary& summary) {
  if (config.scale) return *config.scale;
  if (!config.size) return summary.metres_per_unit;
  return *config.size / spm::longest_side(summary);
}

}  // namespace

HostCoreSettings host_of(const std::string& object, const spm::codec::CompressedModel& model) {
  ObjectConfig config;
  config.name = object;
  config.pose.emplace();
  HostCoreSettings settings;
  settings.name = "host";
  settings.objects.push_back({config, &model});
  return settings;
}

HostCore::HostCore(const session::Origin& self, const HostCoreSettings& settings, std::int64_t now_ns)
    : self_{self},
      name_{settings.name},
      session_{settings.session},
      delivery_{self, settings.chunk_bytes},
      roster_{self, {}},
      clock_{self, {}, now_ns},
      stops_{self},
      authority_{self, settings.authority},
      heartbeat_{kHeartbeatNs},
      request_due_{kClockRequestNs},
      metrics_due_{kMetricsNs} {
  for (const HostedObject& object : settings.objects) delivery_.add(session::id_of(object.config.name), *object.model);
  make_catalogue(settings);
  for (const session::CatalogueEntry& entry : catalogue_) authority_.add(entry, now_ns);
  if (!authority_.empty()) make_scenery(settings.objects);
}

void HostCore::make_catalogue(const HostCoreSettings& settings) {
  double x = settings.at[0];  // coordinate at which the bounds of the next object without a pose begin
  bool first = true;
  for (const auto& [config, model] : settings.objects) {
    const spm::ModelSummary& summary = model->summary();
    session::CatalogueEntry entry;
    entry.origin = self_;
    entry.host = settings.name;
    entry.object = config.name;
    entry.object_id = session::id_of(entry.object);
    entry.summary = summary;
    entry.scale = scale_of(config, summary);
    entry.material = config.material;
    entry.base_bytes = delivery_.base_bytes(entry.object_id);
    entry.surface = spm::surface_points(model->base(), session::kMaxSurfacePoints);
    if (const std::optional<BodyConfig>& body = config.body)
      entry.body = {body->mass, body->inertia.value_or(sharing::inertia_of_bounds(summary, entry.scale, body->mass)),
                    body->friction, body->ground};
    if (config.pose) {
      entry.pose = *config.pose;
    } else {
      entry.pose.position = settings.at;
      if (!first) entry.pose.position[0] = x - summary.bounds_min[0] * entry.scale;
      x = entry.pose.position[0] + summary.bounds_max[0] * entry.scale + kSpacing;
      first = false;
    }
    catalogue_.push_back(entry);
  }
}

/// Makes the static objects with which movable bodies collide.
void HostCore::make_scenery(const std::vector<HostedObject>& objects) {
  std::vector<StaticObject> static_objects;
  for (std::size_t i = 0; i < objects.size(); ++i)
    if (!sharing::can_move(catalogue_[i]))
      static_objects.push_back({catalogue_[i].pose, catalogue_[i].scale, objects[i].model});
  if (static_objects.empty()) return;
  scenery_.emplace(static_objects);
  authority_.set_scenery(&*scenery_);
}

session::Origin HostCore::origin(std::int64_t now_ns) const {
  session::Origin origin = self_;
  origin.time_ns = now_ns;
  return origin;
}

void HostCore::report(Severity severity, const std::string& text) const {
  if (on_event) on_event(severity, text);
}

void HostCore::on_roster(const session::RosterEntry& entry, std::int64_t now_ns) {
  if (stops_.on_roster(entry)) report(Severity::kWarning, "emergency stop, relayed by " + session::text(entry));
  for (const session::RosterEvent& event : roster_.on_entry(entry, now_ns)) react(event, now_ns);
  const session::RosterEntry* const known = roster_.find(entry.origin.participant);
  // Entries that the roster has refused, for example delayed ones, do not end the silence of a host.
  if (known != nullptr && known->role == session::Role::kHost && known->heartbeat == entry.heartbeat)
    authority_.on_host(known->origin, known->joined_ns, now_ns);
}

void HostCore::react(const session::RosterEvent& event, std::int64_t now_ns) {
  using session::RosterChange;
  const session::RosterEntry& entry = event.entry;
  const std::uint64_t id = entry.origin.participant;
  if (event.change != RosterChange::kChanged) report(session::severity(event), session::text(event));
  if (event.change == RosterChange::kNameConflict && id == self_.participant && event.entry_must_leave) {
    report(Severity::kError, session::name_taken_text(name_, session_));
    end_ = HostEnd::kNameTaken;
  }
  metrics_due_.make_due_within(now_ns, kMetricsSoonNs);  // so that programs which compare scenes get the new one soon
  const bool gone = event.change == RosterChange::kLeft || event.change == RosterChange::kGone;
  if (entry.role == session::Role::kHost && gone) authority_.on_host_gone(id);
  const bool is_new = event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted;
  if (entry.role == session::Role::kHrtc && is_new) {
    heartbeat_.repeat_soon();  // the HRTC requests regions only after it has received this host's entry
    add_receiver(entry);
  } else if (gone && receivers_.count(id) != 0) {
    delivery_.on_hrtc_gone(id);
    authority_.on_hrtc_gone(id);
    receivers_.erase(id);
    if (on_receiver_gone) on_receiver_gone(id);
  }
}

void HostCore::add_receiver(const session::RosterEntry& entry) {
  receivers_.try_emplace(entry.origin.participant, entry.name);
  if (on_receiver) on_receiver(entry.origin.participant, entry.name);
}

void HostCore::on_demand(const session::Demand& demand, std::int64_t now_ns) {
  using Result = session::DeliveryServer::DemandResult;
  const Result result = delivery_.on_demand(demand, now_ns);
  // Many viewers only read topics, so a viewer gets endpoints for meshes when it first requests one of this host.
  if (result == Result::kApplied && receivers_.count(demand.origin.participant) == 0) {
    const session::RosterEntry* const sender = roster_.find(demand.origin.participant);
    if (sender != nullptr && sender->role == session::Role::kViewer) add_receiver(*sender);
  }
  if (result == Result::kImplausible) ++demands_implausible_;
  if (result == Result::kMalformed && demands_refused_++ == 0) {
    report(Severity::kWarning,
           "a demand lists regions that the model does not have; such demands are dropped and counted");
  }
}

std::optional<session::ClockSample> HostCore::on_clock(const session::ClockSample& sample, std::int64_t arrived_ns,
                                                       std::int64_t now_ns) {
  if (sample.peer != self_.participant) return std::nullopt;
  if (sample.answer) {
    clock_.on_answer(sample, arrived_ns);
    return std::nullopt;
  }
  if (!clock_.answers_requests()) return std::nullopt;
  return clock_.answer(sample, arrived_ns, now_ns);
}

std::optional<session::ClockSample> HostCore::on_failure_detector(const session::ClockSample& request,
                                                                  std::int64_t arrived_ns, std::int64_t now_ns) {
  if (receivers_.count(request.origin.participant) == 0 || request.answer || request.peer != self_.participant)
    return std::nullopt;
  session::ClockSample answer = clock_.answer(request, arrived_ns, now_ns);
  if (!clock_.answers_requests()) answer.t1_ns = answer.t2_ns = session::kClockUnknown;
  return answer;
}

void HostCore::on_end(const session::SessionEnd& end) {
  report(Severity::kInfo, "the session ends" + (end.text.empty() ? std::string{} : ": " + end.text));
  if (end_ == HostEnd::kNone) end_ = HostEnd::kSession;
}

const HostMessages& HostCore::tick(std::int64_t now_ns) {
  messages_ = {};
  // After a hang other programs may have dropped the catalogue, and DDS does not repeat acknowledged samples.
  messages_.catalogue = !ticked_ns_ || now_ns - *ticked_ns_ > kHungNs;
  ticked_ns_ = now_ns;
  for (const session::RosterEvent& event : roster_.tick(now_ns)) react(event, now_ns);
  session::update_session_clock(roster_, self_, session::Role::kHost, false, now_ns, clock_);
  authority_.on_host(self_, clock_.joined_ns(), now_ns);
  if (std::exchange(stops_announced_, stops_.changes()) != stops_.changes()) heartbeat_.make_due();
  heartbeat_.set_period(authority_.shares_objects() ? kSharedHeartbeatNs : kHeartbeatNs);
  if (heartbeat_.due(now_ns)) messages_.roster = roster_entry(now_ns);
  const bool follows = clock_.reference() != 0 && clock_.reference() != self_.participant;
  if (follows && request_due_.due(now_ns)) messages_.clock_request = clock_.request(now_ns);
  if (metrics_due_.due(now_ns)) messages_.metrics = metrics(now_ns);
  move_objects(now_ns);
  report_damage();
  return messages_;
}

void HostCore::report_damage() {
  for (const session::DeliveryServer::Damage& damage : delivery_.take_damage())
    for (const session::CatalogueEntry& entry : catalogue_)
      if (entry.object_id == damage.object_id)
        report(Severity::kWarning, "object '" + entry.object + "': " + damage.text +
                                       "; parts of its surface stay coarse until the host serves a sound file");
}

void HostCore::move_objects(std::int64_t now_ns) {
  objects_due_ns_ = std::numeric_limits<std::int64_t>::max();
  if (authority_.empty()) return;
  const ObjectAuthority::Messages& moved = authority_.tick(now_ns, clock_.map().session_time(now_ns));
  messages_.grants = moved.grants;
  // Before synchronisation the host does not know the session time, which each pose has to state.
  if (clock_.synchronised()) messages_.poses = moved.poses;
  if (authority_.busy())
    objects_due_ns_ = now_ns + kStepNs;
  else if (authority_.is_any_simulated_elsewhere())
    objects_due_ns_ = now_ns + kHeldNs;
}

std::int64_t HostCore::due_ns() const noexcept {
  return std::min({objects_due_ns_, delivery_.due_ns(), heartbeat_.next_ns()});
}

session::RosterEntry HostCore::roster_entry(std::int64_t now_ns) {
  session::RosterEntry entry;
  entry.origin = origin(now_ns);
  entry.role = session::Role::kHost;
  entry.name = name_;
  entry.session = session_;
  entry.heartbeat = ++beats_;
  entry.stops = stops_.records();
  session::put_time(clock_, false, now_ns, entry);
  return entry;
}

session::Metrics HostCore::metrics(std::int64_t now_ns) const {
  namespace names = session::figures;
  const session::DeliveryCounters& all = delivery_.counters();
  session::Metrics metrics;
  metrics.origin = origin(now_ns);
  metrics.scene = session::scene_hash(roster_, self_, session::Role::kHost);
  const auto add = [&](const std::string& name, double value) {
    if (metrics.figures.size() < session::kMaxFigures) {
      metrics.figures.push_back({name.substr(0, session::kMaxName), value});
    }
  };
  add(names::kHostObjects, static_cast<double>(catalogue_.size()));
  add(names::kHostChunks, static_cast<double>(all.chunks));
  add(names::kHostBytes, static_cast<double>(all.payload_bytes));
  add(names::kHostRegions, static_cast<double>(all.regions));
  add(names::kHostRecords, static_cast<double>(all.records));
  add(names::kHostHrtcs, static_cast<double>(receivers_.size()));
  add(names::kHostImplausible, static_cast<double>(roster_.implausible() + clock_.implausible() + demands_implausible_ +
                                                   authority_.implausible()));
  add(names::kHostDemandsRefused, static_cast<double>(demands_refused_));
  if (!authority_.empty()) {
    add(names::kHostBodySteps, static_cast<double>(authority_.steps()));
    add(names::kHostClaimsRefused, static_cast<double>(authority_.claims_refused()));
  }
  for (const auto& [id, counters] : delivery_.counters_by_hrtc()) {
    const auto hrtc = receivers_.find(id);
    if (hrtc == receivers_.end()) continue;
    add(names::kHostBytes + ("." + hrtc->second), static_cast<double>(counters.payload_bytes));
    add(names::kHostRecords + ("." + hrtc->second), static_cast<double>(counters.records));
  }
  return metrics;
}

}  // namespace tactus::host_service
