#include "viewer/viewer_core.hpp"

#include <algorithm>
#include <utility>

#include "session/figures.hpp"
#include "session/units.hpp"

namespace tactus::viewer {
namespace {

constexpr std::int64_t kHeartbeatNs = 100 * kMs;
constexpr std::int64_t kClockNs = 100 * kMs;
constexpr std::int64_t kStopNs = 20 * kMs;  // between repetitions of a stop
constexpr std::int64_t kMinStopNs = 1500 * kMs;
constexpr std::int64_t kTargetsNs = 10 * kMs;  // between two updates of the regions to refine
constexpr std::int64_t kMeshesNs = 50 * kMs;   // between two readings of the shown faces; pages get a mesh every 60 ms
constexpr std::int64_t kScreenNs = 200 * kMs;  // between two choices of the regions that only the screen needs
constexpr std::int64_t kMarksNs = 100 * kMs;   // between two updates of the marked regions
constexpr std::size_t kMaxFigures = 2 * session::kMaxFigures;  // of a participant; a sample need not have all
constexpr std::int64_t kMaxLossAgeNs = 2000 * kMs;             // an HRTC reports losses only while it loses states
constexpr std::int64_t kMaxShownAgeNs = 1500 * kMs;            // an HRTC sends its shown regions every 500 ms

hrtc_service::ReportedProbe reported(const SeenProbe& probe) {
  const session::ProbeState& state = probe.state;
  hrtc_service::ReportedProbe report;
  report.active = true;
  report.in_contact = (state.status & session::kInContact) != 0;
  report.time_ns = probe.received_ns;
  report.device = hrtc_service::vec(state.device.position);
  report.proxy = hrtc_service::vec(state.proxy);
  report.orientation = hrtc_service::quaternion(state.device.orientation);
  return report;
}

}  // namespace

ViewerCore::ViewerCore(const session::Origin& self, const ViewerSettings& settings, std::int64_t now_ns)
    : self_{self},
      settings_{settings},
      roster_{self, {}},
      clock_{self, {}, now_ns},
      stops_{self},
      now_ns_{now_ns},
      heartbeat_{kHeartbeatNs},
      clock_request_{kClockNs},
      stop_repeat_{kStopNs},
      targets_due_{kTargetsNs},
      meshes_due_{kMeshesNs},
      regions_due_{kMarksNs},
      screen_due_{kScreenNs},
      intake_link_{std::make_unique<hrtc_service::IntakeLink>()},
      intake_{std::make_unique<hrtc_service::Intake>(settings.pool, *intake_link_)},
      loader_{std::make_unique<hrtc_service::Loader>(
          settings.pool, self, hrtc_service::LoaderSettings{.wants_whole_directory = true}, *intake_link_)} {
  loader_->on_event = [this](session::Severity, const std::string& text) { add_event(text, now_ns_); };
  loader_->on_object_found = [this](const session::CatalogueEntry& entry) {
    SeenObject& object = objects_[entry.object_id];
    object = {};
    object.entry = entry;
    object.pose = entry.pose;
    object.number = next_number_++;
    ++scene_number_;
  };
  loader_->on_object_withdrawn = [this](const hrtc_service::ObjectDescription& object) { forget_object(object.id); };
  loader_->on_object_gone = [this](const hrtc_service::Loader::ObjectInfo& object) { forget_object(object.id); };
}

ViewerCore::~ViewerCore() = default;

void ViewerCore::forget_object(std::uint64_t object) {
  objects_.erase(object);
  std::erase_if(shown_, [object](const auto& shown) { return shown.first.second == object; });
  ++scene_number_;
}

void ViewerCore::add_event(const std::string& text, std::int64_t now_ns) { add({now_ns, text, false}); }

void ViewerCore::add_page_event(const std::string& text, std::int64_t now_ns) {
  constexpr std::int64_t kSecondNs = 1'000'000'000;
  if (now_ns - page_events_began_ns_ >= kSecondNs) {
    page_events_began_ns_ = now_ns;
    page_events_ = 0;
  }
  if (++page_events_ > kMaxPageEventsPerSecond) return;
  add({now_ns, text, true});
}

void ViewerCore::add(Event event) {
  const auto is_of_page = [](const Event& each) { return each.is_of_page; };
  if (on_event) on_event(event.text);
  events_.push_back(std::move(event));
  const auto of_pages = static_cast<std::size_t>(std::count_if(events_.begin(), events_.end(), is_of_page));
  if (of_pages > kMaxPageEvents) events_.erase(std::find_if(events_.begin(), events_.end(), is_of_page));
  if (events_.size() > kMaxEvents) events_.pop_front();
  ++scene_number_;
}

void ViewerCore::process(const session::RosterEvent& event, std::int64_t now_ns) {
  using session::RosterChange;
  const session::RosterEntry& entry = event.entry;
  const std::uint64_t participant = entry.origin.participant;
  ++scene_number_;
  if (event.change != RosterChange::kChanged) add_event(session::text(event), now_ns);
  if (event.change == RosterChange::kNameConflict && participant == self_.participant) {
    name_taken_ = name_taken_ || event.entry_must_leave;
    return;
  }
  const bool is_new = event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted;
  const bool is_gone = event.change == RosterChange::kGone || event.change == RosterChange::kLeft;
  if (is_gone || event.change == RosterChange::kRestarted) {
    metrics_.erase(participant);
    losses_.erase(participant);
    std::erase_if(shown_, [&](const auto& shown) { return shown.first.first == participant; });
    ++metrics_number_;
  }
  if (entry.role == session::Role::kHrtc && is_gone)
    std::erase_if(probes_, [&](const auto& probe) { return probe.second.state.origin.participant == participant; });
  if (entry.role != session::Role::kHost) return;
  if (is_new) heartbeat_.repeat_soon();  // the host may not have received our entry
  if (is_gone) loader_->on_host_gone(participant);
  if (event.change == RosterChange::kLeft) loader_->on_host_left(participant, entry.origin.incarnation);
}

void ViewerCore::on_roster(const session::RosterEntry& entry, std::int64_t now_ns) {
  if (stops_.on_roster(entry)) add_event("emergency stop, relayed by " + session::text(entry), now_ns);
  for (const session::RosterEvent& event : roster_.on_entry(entry, now_ns)) process(event, now_ns);
  const session::RosterEntry* const known = roster_.find(entry.origin.participant);
  if (entry.role == session::Role::kHost && !entry.leaving && known != nullptr &&
      known->origin.incarnation == entry.origin.incarnation)
    loader_->on_host_heartbeat(entry.origin.participant, entry.origin.incarnation, now_ns);
}

void ViewerCore::on_probe_state(const session::ProbeState& state, std::int64_t now_ns) {
  SeenProbe& probe = probes_[state.user_id];
  const session::ProbeState& known = probe.state;
  // An HRTC that takes over a user starts its sequence anew.
  const bool is_same_writer = probe.received_ns != 0 && known.origin.participant == state.origin.participant &&
                              known.origin.incarnation == state.origin.incarnation;
  if (is_same_writer && static_cast<std::int32_t>(state.sequence - known.sequence) <= 0) return;
  probe = {state, now_ns};
}

void ViewerCore::on_metrics(const session::Metrics& metrics, std::int64_t now_ns) {
  if (roster_.find(metrics.origin.participant) == nullptr) return;
  if (!metrics.figures.empty() && metrics.figures.front().name.find(session::figures::kLostOf) == 0) {
    double share = 0;
    for (const session::Figure& figure : metrics.figures) share = std::max(share, figure.value);
    losses_[metrics.origin.participant] = {share, now_ns};
    return;
  }
  // A sample need not have all figures; those that it lacks keep their last value.
  std::map<std::string, double>& figures = metrics_[metrics.origin.participant];
  for (const session::Figure& figure : metrics.figures)
    if (figures.size() < kMaxFigures || figures.count(figure.name) != 0) figures[figure.name] = figure.value;
  ++metrics_number_;
}

double ViewerCore::lost_share(std::uint64_t hrtc) const {
  const auto loss = losses_.find(hrtc);
  return loss == losses_.end() || now_ns_ - loss->second.received_ns > kMaxLossAgeNs ? 0 : loss->second.share;
}

Fronts ViewerCore::fronts(std::uint64_t object) const {
  const auto loaded = std::find_if(loaded_.begin(), loaded_.end(), [&](const Loaded& each) {
    return each.object->id == object && !each.withdrawn && !each.base_regions.empty();
  });
  if (loaded == loaded_.end()) return {};
  const spm::Forest& forest = *loaded->object->forest;
  const std::uint32_t regions = forest.grid().size();
  std::vector<spm::Forest::InUse> in_use(forest.copy_in_use(nullptr, 0));
  (void)forest.copy_in_use(in_use.data(), static_cast<std::uint32_t>(in_use.size()));
  const std::size_t columns = std::min<std::size_t>(Fronts::kMaxColumns, regions);
  std::vector<double> entries(columns);
  Fronts fronts{entries, entries};
  const auto column_of = [&](std::uint32_t region) { return std::size_t{region} * columns / regions; };
  for (std::uint32_t region = 0; region < regions; ++region) {
    const double count = loader_->records_of(loaded->object->index, region);
    entries[column_of(region)] += count;
    if (forest.is_loaded(spm::RegionId{region})) fronts.loaded[column_of(region)] += count;
  }
  for (const spm::Forest::InUse& each : in_use) fronts.refined[column_of(spm::index(each.region))] += each.applied;
  for (std::vector<double>* const front : {&fronts.refined, &fronts.loaded})
    for (std::size_t i = 0; i < columns; ++i) (*front)[i] /= std::max(entries[i], 1.0);
  return fronts;
}

void ViewerCore::on_shown_regions(const session::ShownRegions& shown, std::int64_t now_ns) {
  const session::RosterEntry* const hrtc = roster_.find(shown.origin.participant);
  if (hrtc == nullptr || hrtc->origin.incarnation != shown.origin.incarnation) return;
  if (objects_.count(shown.object_id) == 0) return;
  Shown& newest = shown_[{shown.origin.participant, shown.object_id}];
  if (newest.regions.origin.incarnation != shown.origin.incarnation) newest.times = {};
  const session::Admission admission = newest.times.admit(shown.origin.time_ns, now_ns);
  const bool is_older =
      admission == session::Admission::kAccepted && shown.origin.time_ns <= newest.regions.origin.time_ns;
  if (!session::accepted(admission) || is_older) return;
  if (newest.regions.mesh_hash != shown.mesh_hash || newest.received_ns == 0) ++metrics_number_;
  newest.regions = shown;
  newest.received_ns = now_ns;
}

void ViewerCore::show_meshes_of(const std::string& hrtc) {
  shown_hrtc_ = hrtc;
  ++scene_number_;
}

std::optional<std::uint64_t> ViewerCore::published_hash(std::uint64_t hrtc, std::uint64_t object) const {
  const auto shown = shown_.find({hrtc, object});
  const auto seen = objects_.find(object);
  const bool has_model = shown != shown_.end() && seen != objects_.end() &&
                         shown->second.regions.digest == seen->second.entry.summary.digest;
  if (!has_model) return std::nullopt;
  return shown->second.regions.mesh_hash;
}

/// Calls `visit` with the newest shown regions of each chosen HRTC for an object.
template <class Visit>
void ViewerCore::for_each_shown(const Loaded& loaded, Visit&& visit) const {
  roster_.for_each([&](const session::RosterEntry& entry) {
    if (entry.role != session::Role::kHrtc || (!shown_hrtc_.empty() && entry.name != shown_hrtc_)) return;
    const auto shown = shown_.find({entry.origin.participant, loaded.object->id});
    const bool is_current = shown != shown_.end() && shown->second.regions.digest == loaded.object->digest &&
                            now_ns_ - shown->second.received_ns <= kMaxShownAgeNs;
    if (is_current) visit(shown->second.regions);
  });
}

/// Returns for each region the largest number of entries in the chosen meshes of an object. None if no chosen HRTC has
/// published them, or if a list is not complete.
std::optional<ViewerCore::Entries> ViewerCore::shown_entries(const Loaded& loaded) const {
  bool are_complete = true, any = false;
  Entries entries;
  for_each_shown(loaded, [&](const session::ShownRegions& shown) {
    any = true;
    are_complete = are_complete && shown.complete;
    for (const session::ShownRegion& region : shown.regions)
      if (loaded.object->forest->grid().has(spm::RegionId{region.region}))
        entries[region.region] = std::max(entries[region.region], region.applied);
  });
  if (!are_complete || !any) return std::nullopt;
  return entries;
}

void ViewerCore::on_object_pose(const session::ObjectPose& pose, std::int64_t now_ns) {
  const auto object = objects_.find(pose.object_id);
  if (object == objects_.end() || !object->second.admission.accept(pose, now_ns)) return;
  object->second.pose = pose.pose;
  for (const Loaded& loaded : loaded_)
    if (loaded.object->id == pose.object_id && !loaded.withdrawn)
      loader_->on_moved(loaded.object->index, {pose.pose, loaded.object->placement.scale()});
}

void ViewerCore::on_stop(const session::EmergencyStop& stop, std::int64_t now_ns) {
  if (stops_.on_stop(stop.name())) add_event("emergency stop: " + stop.text, now_ns);
}

void ViewerCore::on_reset(const session::ForceReset& reset, std::int64_t now_ns) {
  if (stops_.on_reset(reset)) add_event("forces are reset: " + reset.text, now_ns);
  for (const session::StopName& stop : reset.stops)
    if (own_stop_ && stop.participant == self_.participant && stop.incarnation == self_.incarnation &&
        stop.number >= own_stop_->number)
      is_own_stop_reset_ = true;
}

void ViewerCore::on_end(const session::SessionEnd& end, std::int64_t now_ns) {
  add_event("the session ends" + (end.text.empty() ? std::string{} : ": " + end.text), now_ns);
}

void ViewerCore::on_clock(const session::ClockSample& sample, std::int64_t now_ns) {
  if (sample.answer && sample.peer == self_.participant) (void)clock_.on_answer(sample, now_ns);
}

void ViewerCore::stop_forces(const std::string& reason, std::int64_t now_ns) {
  own_stop_ = session::EmergencyStop{self_, ++own_stops_, reason};
  is_own_stop_reset_ = false;
  stop_recipients_.clear();
  stop_requested_ns_ = now_ns;
  stop_repeat_.make_due();
  (void)stops_.on_stop(own_stop_->name());
  add({now_ns, "emergency stop, sent by this viewer: " + reason, true});
}

void ViewerCore::update_stop_progress() {
  StopProgress progress;
  progress.is_requested = own_stop_.has_value();
  if (own_stop_) progress.missing = missing_of_own_stop();
  roster_.for_each([&](const session::RosterEntry& entry) {
    if (entry.role != session::Role::kHrtc) return;
    ++progress.hrtcs;
    progress.stopped += session::standing_stops(entry.stops).empty() ? 0 : 1;
  });
  if (progress == stop_progress_) return;
  stop_progress_ = progress;
  ++scene_number_;
}

/// Fills the probe numbers of the loader. A user keeps its number while it has a probe, because the prediction follows
/// the motion of each number.
void ViewerCore::choose_users() {
  refined_users_.resize(hrtc_service::kMaxProbes, 0);
  for (std::uint64_t& user : refined_users_)
    if (probes_.count(user) == 0) user = 0;
  for (const auto& [user, probe] : probes_) {
    if (std::find(refined_users_.begin(), refined_users_.end(), user) != refined_users_.end()) continue;
    const auto free = std::find(refined_users_.begin(), refined_users_.end(), 0);
    if (free == refined_users_.end()) return;
    *free = user;
  }
}

void ViewerCore::load(std::int64_t now_ns) {
  choose_users();
  std::array<hrtc_service::ReportedProbe, hrtc_service::kMaxProbes> probes{};
  for (std::size_t i = 0; i < refined_users_.size(); ++i)
    if (refined_users_[i] != 0) probes[i] = reported(probes_.at(refined_users_[i]));
  std::array<hrtc_service::NearObjects, hrtc_service::kMaxProbes> near{};
  loader_->tick(now_ns, probes, near);
  intake_->tick();
  for (int left = 256; left > 0 && !loader_->send_waiting(); --left) intake_->tick();
  intake_->tick();
}

void ViewerCore::process_arrivals() {
  using hrtc_service::Arrival;
  Arrival arrival;
  while (intake_->arrivals().pop(arrival)) {
    if (arrival.kind == Arrival::Kind::kObject) {
      loaded_.push_back({.object = arrival.object});
      continue;
    }
    const auto loaded =
        std::find_if(loaded_.begin(), loaded_.end(), [&](const Loaded& each) { return each.object == arrival.object; });
    switch (arrival.kind) {
      case Arrival::Kind::kObject:
        break;
      case Arrival::Kind::kRegion:
        loaded->object->forest->add(arrival.region, arrival.list);
        break;
      case Arrival::Kind::kDropPage:  // the viewer requests the whole directory, and drops nothing
        break;
      case Arrival::Kind::kPage:
        loaded->object->forest->add(*arrival.page);
        break;
      case Arrival::Kind::kRetire:
        loaded->object->forest->retire(arrival.region);
        break;
      case Arrival::Kind::kWithdraw:
        loaded->object->forest->withdraw();
        loaded->withdrawn = true;
        break;
    }
  }
}

void ViewerCore::set_targets(const Loaded& loaded) {
  spm::Forest& forest = *loaded.object->forest;
  const std::uint32_t number = loaded.object->index;
  const std::optional<Entries> shown = shown_entries(loaded);
  const auto screen = screen_entries_.find(number);
  const bool for_screen = screen != screen_entries_.end() && shown_hrtc_.empty();
  std::vector<std::uint32_t> wanted, wanted_later;
  if (!shown && !for_screen) {
    loader_->want(number, {}, {});
    targets_.clear();
    for (const std::uint32_t region : loader_->predicted_contacts(number)) targets_.push_back(spm::RegionId{region});
    return forest.set_targets(targets_.data(), static_cast<std::uint32_t>(targets_.size()), spm::Unrequested::kRetain);
  }
  Entries entries;
  if (shown) {
    entries = *shown;
    for (const auto& [region, count] : entries) wanted.push_back(region);
  } else {
    for (const std::uint32_t region : loader_->predicted_contacts(number)) entries[region] = ~0u;
  }
  shown_targets_.clear();  // the touched regions first
  for (const auto& [region, count] : entries) {
    const auto more = for_screen ? screen->second.find(region) : entries.end();
    const bool is_more = for_screen && more != screen->second.end() && more->second > count;
    shown_targets_.push_back({spm::RegionId{region}, is_more ? more->second : count});
  }
  if (for_screen)
    for (const auto& [region, count] : screen->second) {
      wanted_later.push_back(region);
      if (entries.count(region) == 0) shown_targets_.push_back({spm::RegionId{region}, count});
    }
  loader_->want(number, std::move(wanted), std::move(wanted_later));
  forest.set_targets(shown_targets_.data(), static_cast<std::uint32_t>(shown_targets_.size()));
}

void ViewerCore::set_base_regions(Loaded& loaded) {
  loaded.base_regions = base_regions(*loaded.object->forest);
  double entries = 0;
  for (std::uint32_t region = 0; region < loaded.base_regions.size(); ++region)
    entries += loader_->records_of(loaded.object->index, region);
  loaded.distinct = loader_->entry(loaded.object->index).summary.records / std::max(entries, 1.0);
}

void ViewerCore::choose_screen_entries() {
  ScreenRefinement refinement;
  for (const Loaded& loaded : loaded_) {
    const auto object = objects_.find(loaded.object->id);
    if (loaded.withdrawn || object == objects_.end()) continue;
    const sharing::Placement placement{object->second.pose, loaded.object->placement.scale()};
    const spm::RegionGrid& grid = loaded.object->forest->grid();
    for (std::uint32_t region = 0; region < loaded.base_regions.size(); ++region)
      if (grid.has(spm::RegionId{region}))
        refinement.add(loaded.object->index, region, loaded.base_regions[region], grid.box(spm::RegionId{region}),
                       placement, loader_->records_of(loaded.object->index, region), loaded.distinct, cameras_);
  }
  // The other slots are for the regions near probes.
  screen_entries_ = refinement.choose(settings_.faces, settings_.pool.slots / 2);
}

void ViewerCore::mark_regions(const Loaded& loaded, SeenObject& object) const {
  const spm::RegionGrid& grid = loaded.object->forest->grid();
  std::map<std::uint32_t, RegionMark> marks;  // by region
  for_each_shown(loaded, [&](const session::ShownRegions& shown) {
    for (const session::ShownRegion& region : shown.regions)
      if (region.applied > 0 && grid.has(spm::RegionId{region.region})) marks[region.region] = RegionMark::kResident;
  });
  for (const std::uint32_t region : loader_->predicted_contacts(loaded.object->index))
    marks[region] = RegionMark::kPredicted;
  std::array<hrtc_service::ReportedProbe, hrtc_service::kMaxProbes> touching{};
  for (std::size_t i = 0; i < refined_users_.size(); ++i) {
    const auto probe = probes_.find(refined_users_[i]);
    if (probe == probes_.end() || probe->second.state.object_id != loaded.object->id) continue;
    touching[i] = reported(probe->second);
    touching[i].active = touching[i].in_contact;
  }
  for (const std::uint32_t region : loader_->regions_at_probes(loaded.object->index, touching))
    marks[region] = RegionMark::kContact;

  std::vector<MarkedRegion> regions;
  for (const RegionMark mark : {RegionMark::kContact, RegionMark::kPredicted, RegionMark::kResident})
    for (const auto& [region, its_mark] : marks) {
      if (its_mark != mark || regions.size() == kMaxMarkedRegions) continue;
      const spm::CellBox box = grid.box(spm::RegionId{region});
      const spm::Vec3f low = box.low.cast<float>();
      regions.push_back({mark, {low[0], low[1], low[2]}, static_cast<float>(box.high[0] - box.low[0])});
    }
  if (regions == object.regions) return;
  object.regions = std::move(regions);
  ++object.regions_number;
}

void ViewerCore::refine() {
  spm::Budget budget{settings_.budget};
  hrtc_service::DepartureRing& departures = intake_->departures();
  const bool sets_targets = targets_due_.due(now_ns_);
  for (Loaded& loaded : loaded_) {
    spm::Forest& forest = *loaded.object->forest;
    if (!loaded.withdrawn && loaded.base_regions.empty() && forest.is_base_shown() && forest.grid().pages() > 0)
      set_base_regions(loaded);
    // Without a target, the forest shows only its base mesh.
    if (!loaded.withdrawn && !loaded.base_regions.empty() && sets_targets) set_targets(loaded);
    (void)forest.advance(budget);
    (void)forest.refit();
    while (departures.write_available() > 0) {
      const spm::RegionId region = forest.take_retired();
      if (region == spm::kNone) break;
      departures.push({loaded.object->index, region});
    }
  }
  std::erase_if(loaded_, [&departures](const Loaded& loaded) {
    if (!loaded.withdrawn || !loaded.object->forest->is_fully_hidden() || departures.write_available() == 0)
      return false;
    departures.push({loaded.object->index, spm::RegionId{spm::kNone}});
    return true;
  });
}

/// A program that has ended without a leave message never acknowledges the stop. After a reset, the stop is not
/// repeated for it, because it would apply to programs that join.
std::vector<std::string> ViewerCore::missing_of_own_stop() {
  if (is_own_stop_reset_) return session::acknowledgement(roster_, *own_stop_).missing;
  stop_recipients_.update(roster_);
  return stop_recipients_.acknowledgement(*own_stop_).missing;
}

void ViewerCore::send_stop(std::int64_t now_ns, ViewerMessages& out) {
  if (!own_stop_ || !stop_repeat_.due(now_ns)) return;
  own_stop_->origin.time_ns = now_ns;
  // Discovery reports no end, so the stop is repeated for a while even if all known programs have acknowledged it.
  if (now_ns - stop_requested_ns_ > kMinStopNs && missing_of_own_stop().empty())
    own_stop_.reset();
  else
    out.stop = own_stop_;
}

ViewerMessages ViewerCore::tick(std::int64_t now_ns) {
  now_ns_ = now_ns;
  ViewerMessages out;
  for (const session::RosterEvent& event : roster_.tick(now_ns)) process(event, now_ns);
  send_stop(now_ns, out);
  update_stop_progress();
  session::update_session_clock(roster_, self_, session::Role::kViewer, false, now_ns, clock_);
  load(now_ns);
  process_arrivals();
  if (screen_due_.due(now_ns)) choose_screen_entries();
  refine();
  if (is_watched_ && meshes_due_.due(now_ns))
    for (const Loaded& loaded : loaded_)
      if (const auto object = objects_.find(loaded.object->id); object != objects_.end() && !loaded.withdrawn)
        object->second.mesh.update(*loaded.object->forest);
  if (is_watched_ && regions_due_.due(now_ns))
    for (const Loaded& loaded : loaded_)
      if (const auto object = objects_.find(loaded.object->id); object != objects_.end() && !loaded.withdrawn)
        mark_regions(loaded, object->second);
  std::erase_if(probes_, [&](const auto& probe) { return now_ns - probe.second.received_ns > kMaxStateAgeNs; });
  while (auto demand = loader_->demand(now_ns)) out.demands.push_back(*std::move(demand));
  if (heartbeat_.due(now_ns)) out.roster = roster_entry(false, now_ns);
  if (clock_.reference() != 0 && clock_request_.due(now_ns)) out.clock_request = clock_.request(now_ns);
  return out;
}

session::RosterEntry ViewerCore::roster_entry(bool leaving, std::int64_t now_ns) {
  session::RosterEntry entry;
  entry.origin = self_;
  entry.role = session::Role::kViewer;
  entry.name = settings_.name;
  entry.session = settings_.session;
  entry.heartbeat = ++heartbeats_;
  entry.leaving = leaving;
  put_time(entry, now_ns);
  return entry;
}

}  // namespace tactus::viewer
