#include "client_sim/sim_core.hpp"

#include <algorithm>
#include <utility>

namespace tactus::client_sim {

namespace {

constexpr std::size_t kMaxEvents = 1000;
constexpr std::size_t kMaxFigures = 2 * session::kMaxFigures;  // of a participant; a sample need not have all
constexpr double kUsualWait = 3;  // s, for HRTCs and objects while the programs of a session start

double seconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

/// Lists the references to which nothing corresponds. A name needs an entry in `names`. "#n" needs `counted` >= n; if
/// `wraps`, n is taken modulo `counted`, so 1 is enough.
std::string missing_references(const std::set<std::string>& references, const std::vector<std::string>& names,
                               std::size_t counted, bool wraps) {
  std::string missing;
  for (const std::string& reference : references) {
    const std::uint32_t ordinal = ordinal_of(reference);
    const bool found = ordinal == 0 ? std::find(names.begin(), names.end(), reference) != names.end()
                                    : counted >= ordinal || (wraps && counted > 0);
    if (!found) missing += (missing.empty() ? "" : ", ") + reference;
  }
  return missing;
}

std::set<std::string> hrtc_references(const Scenario& scenario) {
  std::set<std::string> references;
  for (const User& user : scenario.users) references.insert(user.hrtc);
  return references;
}

std::set<std::string> object_references(const Scenario& scenario) {
  std::set<std::string> references;
  for (const User& user : scenario.users) {
    for (const Action& action : user.script) {
      if (!action.object.empty()) references.insert(action.object);
    }
  }
  return references;
}

/// For example "HRTC left, right" or "no HRTC".
std::string list_of(const std::string& kind, const std::vector<std::string>& names) {
  if (names.empty()) return "no " + kind;
  std::string text = kind;
  for (const std::string& name : names) text += (&name == &names.front() ? " " : ", ") + name;
  return text;
}

}  // namespace

SimCore::SimCore(const Scenario& scenario, const SimSettings& settings)
    : scenario_{scenario},
      settings_{settings},
      self_{session::id_of(settings.session), session::id_of(settings.name), settings.incarnation, 0},
      roster_{self_, settings.roster},
      stops_{self_} {
  Presence first;
  first.entry.origin = self_;
  first.entry.role = session::Role::kClient;
  first.entry.name = settings.name;
  first.entry.session = settings.session;
  first.sent_ns = INT64_MIN / 2;
  presences_.push_back(first);
}

void SimCore::log_event(const std::string& text) {
  if (events_.size() < kMaxEvents) events_.emplace_back(now_ns_, text);
}

void SimCore::on_catalogue(const session::CatalogueEntry& entry) {
  if (entry.origin.session != self_.session) return;
  if (entry.withdrawn) return;  // another host may serve the object, and users may touch its loaded regions
  // Does not replace a movable object, because it may have moved since this entry was published.
  if (movables_.count(entry.object_id) == 0) objects_[entry.object] = view_of(entry);
  if (entry.body.mass > 0) movables_.try_emplace(entry.object_id, Movable{entry, {}, {}});
  record_counts_[entry.object] = entry.summary.records;
}

void SimCore::on_roster(const session::RosterEntry& entry, std::int64_t now_ns) {
  if (entry.origin.session != self_.session) return;
  now_ns_ = std::max(now_ns_, now_ns);
  if (first_peer_ns_ < 0 && !is_own(entry.origin.participant)) first_peer_ns_ = now_ns;
  if (stops_.on_roster(entry)) log_event("emergency stop, relayed by " + session::text(entry));
  process_events(roster_.on_entry(entry, now_ns));
}

bool SimCore::is_own(std::uint64_t participant) const {
  return std::any_of(presences_.begin(), presences_.end(),
                     [&](const Presence& presence) { return presence.entry.origin.participant == participant; });
}

void SimCore::on_name_conflict(const session::RosterEvent& event) {
  log_event(session::text(event));
  const bool is_second = event.other == self_.incarnation;
  if (event.entry_must_leave != is_second) taken_name_ = event.entry.name;
}

void SimCore::process_events(const std::vector<session::RosterEvent>& events) {
  for (const session::RosterEvent& event : events) {
    const session::RosterEntry& entry = event.entry;
    if (is_own(entry.origin.participant)) {  // each participant of this program receives the entries of the others
      if (event.change == session::RosterChange::kNameConflict) on_name_conflict(event);
      continue;
    }
    if (entry.role == session::Role::kHost || entry.role == session::Role::kHrtc) {
      if (event.change != session::RosterChange::kWrongVersion && event.change != session::RosterChange::kFull) {
        Peer& peer = peers_[entry.origin.participant];
        peer.name = entry.name;
        peer.role = entry.role;
        peer.is_present = event.change != session::RosterChange::kGone && event.change != session::RosterChange::kLeft;
        peer.present_at_end = peer.is_present || (peer.present_at_end && end_ns_ >= 0);
      }
    }
    if (event.change != session::RosterChange::kChanged) log_event(session::text(event));
  }
}

void SimCore::on_probe_state(const session::ProbeState& state, std::int64_t session_now_ns) {
  if (state.origin.session != self_.session) return;
  for (SimUser& sim_user : users_) sim_user.script_operator.on_other_probe_state(state);
  for (SimUser& sim_user : users_) {
    if (state.user_id != session::id_of(sim_user.script_operator.user().name)) continue;
    if (state.origin.participant != session::id_of(sim_user.hrtc)) return;
    const session::Admission admission =
        sim_user.probe.on_state(state, session::StateStream::kDeadbandCoded, session_now_ns);
    if (admission == session::Admission::kImplausible) ++implausible_;
    if (!session::accepted(admission) || state_ != SimState::kRunning) return;
    const std::uint32_t faults = sim_user.touch.faults;
    sim_user.touch.add(state, session_start_ns_, session_now_ns);
    if (sim_user.touch.faults > faults)
      log_event("the force of " + sim_user.script_operator.user().name + " is off: " + sim_user.touch.fault_reason);
    return;
  }
}

void SimCore::on_object_pose(const session::ObjectPose& pose) {
  const auto at = movables_.find(pose.object_id);
  if (pose.origin.session != self_.session || at == movables_.end() || !at->second.pose_admission.accept(pose, now_ns_))
    return;
  at->second.entry.pose = pose.pose;
  const ObjectView view = view_of(at->second.entry);
  objects_[at->second.entry.object] = view;
  at->second.tally.add(pose, view.centre.z());
}

void SimCore::on_metrics(const session::Metrics& metrics, std::int64_t now_ns) {
  if (metrics.origin.session != self_.session) return;
  const auto found = peers_.find(metrics.origin.participant);
  if (found == peers_.end()) return;
  std::map<std::string, double>& figures = found->second.figures;
  for (const session::Figure& figure : metrics.figures)
    if (figures.size() < kMaxFigures || figures.count(figure.name) != 0) figures[figure.name] = figure.value;
  found->second.figures_ns = now_ns;
}

void SimCore::on_stop(const session::EmergencyStop& stop) {
  if (stop.origin.session == self_.session && stops_.on_stop(stop.name())) log_event("emergency stop: " + stop.text);
}

void SimCore::on_reset(const session::ForceReset& reset) {
  if (reset.origin.session == self_.session) (void)stops_.on_reset(reset);
}

void SimCore::on_end(const session::SessionEnd& end) {
  if (end.origin.session != self_.session || end.origin.participant == self_.participant) return;
  stop("ended by another participant: " + end.text);
}

void SimCore::stop(const std::string& reason) {
  if (requested_stop_.empty()) requested_stop_ = reason;
}

void SimCore::assign_users(const std::vector<std::string>& hrtcs) {
  std::map<std::string, std::size_t> by_hrtc;
  for (const User& user : scenario_.users) {
    const std::uint32_t ordinal = ordinal_of(user.hrtc);
    const std::string& hrtc = ordinal == 0 ? user.hrtc : hrtcs[(ordinal - 1) % hrtcs.size()];
    const auto [found, is_new] = by_hrtc.try_emplace(hrtc, by_hrtc.size());
    if (is_new && found->second > 0) {
      Presence additional = presences_.front();
      additional.entry.name = settings_.name + "." + std::to_string(found->second + 1);
      additional.entry.origin.participant = session::id_of(additional.entry.name);
      if (roster_.find(additional.entry.origin.participant) != nullptr) taken_name_ = additional.entry.name;
      additional.entry.users.clear();
      presences_.push_back(additional);
    }
    Presence& presence = presences_[found->second];
    presence.entry.requested_hrtc = hrtc;
    presence.entry.users.push_back(user.name);
    users_.push_back({Operator{user, settings_.hand}, {}, session::RemoteProbe{{0, 0}}, hrtc, found->second});
  }
  for (Presence& presence : presences_) presence.sent_ns = INT64_MIN / 2;  // publish at once
}

void SimCore::gather(std::int64_t now_ns) {
  std::vector<std::string> hrtcs;
  for (const session::RosterEntry& entry : roster_.entries()) {
    if (entry.role == session::Role::kHrtc) hrtcs.push_back(entry.name);
  }
  std::sort(hrtcs.begin(), hrtcs.end());
  std::vector<std::string> objects;
  std::size_t fixed = 0;
  for (const auto& [name, view] : objects_) {
    objects.push_back(name);
    fixed += view.is_movable ? 0 : 1;
  }
  if (found_ns_ < 0 && !hrtcs.empty() && !objects.empty()) found_ns_ = now_ns;
  const bool settled = found_ns_ >= 0 && seconds(now_ns - found_ns_) >= settings_.settle;
  const std::string no_hrtc = missing_references(hrtc_references(scenario_), hrtcs, hrtcs.size(), settled);
  const std::string no_object = missing_references(object_references(scenario_), objects, fixed, settled);
  stop_reason_.clear();
  if (!no_hrtc.empty()) stop_reason_ = "no HRTC " + no_hrtc + " in session '" + settings_.session + "'";
  if (!no_object.empty()) stop_reason_ += (stop_reason_.empty() ? "" : "; ") + ("no host serves object " + no_object);
  if (!stop_reason_.empty()) {
    stop_reason_ += "; found " + list_of("HRTC", hrtcs) + " and " + list_of("object", objects);
    const bool waits_long = seconds(now_ns - first_tick_ns_) > kUsualWait;
    if (waits_long && (hrtcs.empty() || objects.empty()))
      stop_reason_ += " (do all programs have the same --session and --domain, and keys of one authority or none?)";
    return;
  }
  if (seconds(now_ns - first_peer_ns_) < settings_.name_check) return;
  assign_users(hrtcs);
  state_ = SimState::kJoining;
}

std::string SimCore::missing_probes() const {
  std::string missing;
  for (const SimUser& sim_user : users_) {
    const session::RosterEntry* const hrtc = roster_.find(session::id_of(sim_user.hrtc));
    const std::string& user = sim_user.script_operator.user().name;
    const bool served =
        hrtc != nullptr && std::any_of(hrtc->served_users.begin(), hrtc->served_users.end(),
                                       [&](const session::UserProbe& probe) { return probe.user == user; });
    if (!served) missing += (missing.empty() ? "" : ", ") + user + " by " + sim_user.hrtc;
  }
  return missing.empty() ? "" : "not served: " + missing + "; the log of the HRTC says why";
}

session::Origin SimCore::origin_of(std::size_t presence, std::int64_t now_ns) const {
  session::Origin origin = presences_[presence].entry.origin;
  origin.time_ns = now_ns;
  return origin;
}

session::Control SimCore::control(session::ControlKind kind, std::int64_t now_ns, const std::string& text) {
  session::Control control;
  control.origin = origin_of(0, now_ns);
  control.sequence = ++control_sequence_;
  control.kind = kind;
  control.text = text.substr(0, session::kMaxText);
  return control;
}

void SimCore::send_heartbeats(std::int64_t now_ns, bool leaving, SimMessages& out) {
  for (std::size_t i = 0; i < presences_.size(); ++i) {
    Presence& presence = presences_[i];
    if (!leaving && now_ns - presence.sent_ns < settings_.heartbeat_ns) continue;
    presence.sent_ns = now_ns;
    presence.entry.origin = origin_of(i, now_ns);
    presence.entry.leaving = leaving;
    ++presence.entry.heartbeat;
    out.roster.push_back(presence.entry);
  }
}

void SimCore::log_unfinished_scripts() {
  for (const SimUser& sim_user : users_) {
    const User& user = sim_user.script_operator.user();
    if (const std::size_t action = sim_user.script_operator.unfinished_action(); action != 0)
      log_event("the duration ended during action " + std::to_string(action) + " of " +
                std::to_string(user.script.size()) + " of the script of " + user.name);
  }
}

void SimCore::begin_ending(std::int64_t now_ns, SimMessages& out) {
  state_ = SimState::kEnding;
  end_ns_ = now_ns;
  const std::string reason = requested_stop_.empty() ? "scenario done" : requested_stop_;
  out.ends.push_back({origin_of(0, now_ns), reason.substr(0, session::kMaxText)});
}

bool SimCore::last_figures_are_in() const {
  return std::all_of(peers_.begin(), peers_.end(),
                     [&](const auto& peer) { return !peer.second.is_present || peer.second.figures_ns > end_ns_; });
}

SimMessages SimCore::tick(std::int64_t now_ns, std::int64_t session_now_ns) {
  SimMessages out;
  if (finished()) return out;
  now_ns_ = now_ns;
  if (first_tick_ns_ < 0) first_tick_ns_ = now_ns;
  process_events(roster_.tick(now_ns));

  if (state_ == SimState::kGathering && taken_name_.empty()) gather(now_ns);
  if (!taken_name_.empty()) {
    stop_reason_ = session::name_taken_text(taken_name_, settings_.session);
    state_ = SimState::kFailed;
    send_heartbeats(now_ns, true, out);
    return out;
  }
  if (state_ == SimState::kJoining) {
    stop_reason_ = missing_probes();
    if (stop_reason_.empty()) {
      state_ = SimState::kRunning;
      start_ns_ = now_ns;
      session_start_ns_ = session_now_ns;
      out.control.push_back(control(session::ControlKind::kStart, now_ns, scenario_.name));
      if (!settings_.mode.empty()) out.control.push_back(control(session::ControlKind::kMode, now_ns, settings_.mode));
    }
  }
  if (state_ == SimState::kGathering || state_ == SimState::kJoining) {
    if (!requested_stop_.empty()) stop_reason_ = requested_stop_;
    if (!requested_stop_.empty() || seconds(now_ns - first_tick_ns_) > settings_.patience) {
      if (requested_stop_.empty())
        stop_reason_ += ", waited " + std::to_string(static_cast<int>(settings_.patience)) + " s";
      state_ = SimState::kFailed;
      send_heartbeats(now_ns, true, out);
      return out;
    }
  }
  if (state_ == SimState::kRunning) {
    for (SimUser& sim_user : users_) {
      if (const session::ShownProbe shown = sim_user.probe.view_at(session_now_ns); shown.state.sequence != 0) {
        session::ProbeState felt = shown.state;
        felt.session_time_ns = shown.at_ns;
        felt.device.position = shown.view.device;
        felt.proxy = shown.view.proxy;
        felt.force = shown.view.force;
        sim_user.script_operator.on_probe_state(felt);
      }
      if (auto intent = sim_user.script_operator.tick(session_now_ns, objects_)) {
        intent->origin = origin_of(sim_user.presence, now_ns);
        out.intents.push_back(std::move(*intent));
      }
    }
    const bool all_done = std::all_of(users_.begin(), users_.end(),
                                      [](const SimUser& sim_user) { return sim_user.script_operator.done(); });
    if (!requested_stop_.empty()) stop_reason_ = requested_stop_;
    const bool is_time_over = seconds(now_ns - start_ns_) >= scenario_.duration;
    if (is_time_over && requested_stop_.empty()) log_unfinished_scripts();
    if (all_done || !requested_stop_.empty() || is_time_over) begin_ending(now_ns, out);
  } else if (state_ == SimState::kEnding && (last_figures_are_in() || seconds(now_ns - end_ns_) >= settings_.linger)) {
    state_ = SimState::kEnded;
    send_heartbeats(now_ns, true, out);
    return out;
  }
  send_heartbeats(now_ns, false, out);
  return out;
}

Report SimCore::report() const {
  Report report;
  report.session = settings_.session;
  report.scenario = scenario_.name;
  report.stop_reason = stop_reason_;
  if (start_ns_ >= 0) report.duration = seconds((end_ns_ >= 0 ? end_ns_ : now_ns_) - start_ns_);
  for (const auto& [object, records] : record_counts_) report.records_total += records;
  for (const SimUser& sim_user : users_) {
    const OperatorTally& tally = sim_user.script_operator.tally();
    report.users.push_back({sim_user.script_operator.user().name, sim_user.hrtc, sim_user.touch, tally.taps,
                            tally.approaches_missed, tally.contacts_lost, tally.following, tally.lifts,
                            tally.lifts_lost, tally.grabs, tally.grabs_refused, tally.grabs_lost});
  }
  report.implausible = implausible_ + roster_.implausible();
  for (const auto& [id, movable] : movables_) report.implausible += movable.pose_admission.implausible();
  for (const auto& [id, movable] : movables_)
    if (movable.tally.poses > 0) report.objects.push_back({movable.entry.object, movable.tally});
  for (const auto& [id, peer] : peers_)
    report.participants.push_back({peer.name, peer.role, peer.present_at_end, peer.figures});
  std::sort(report.participants.begin(), report.participants.end(),
            [](const ParticipantReport& a, const ParticipantReport& b) { return a.name < b.name; });
  const std::int64_t origin_ns = start_ns_ >= 0 ? start_ns_ : first_tick_ns_;
  for (const auto& [at_ns, text] : events_) report.events.push_back({seconds(at_ns - origin_ns), text});
  return report;
}

}  // namespace tactus::client_sim
