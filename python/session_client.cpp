#include "python/session_client.hpp"

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <utility>

#include "realtime/process.hpp"
#include "session/check.hpp"
#include "session/time_reference.hpp"

namespace tactus::python {
namespace {

using realtime::monotonic_ns;

constexpr std::int64_t kBeatNs = 100'000'000;
constexpr std::int64_t kClockRequestNs = 100'000'000;  // between two clock requests, once the clock is synchronised
constexpr std::int64_t kIntentNs = 20'000'000;
constexpr std::int64_t kWaypointNs = 10'000'000;  // between two waypoints, so an intent covers 150 ms
constexpr std::int64_t kRepeatNs = 200'000'000;  // for which the end of a path is repeated, because samples may be lost
constexpr std::size_t kMaxFigures = 2 * session::kMaxFigures;  // of a participant; a sample need not have all
constexpr auto kTick = std::chrono::milliseconds{2};

StateRow row_of(const session::ProbeState& state) {
  return {state.session_time_ns,
          state.device.position,
          state.device.orientation,
          state.velocity,
          state.force,
          state.proxy,
          state.radius,
          double{state.stiffness},
          double{state.error_bound},
          1e-6 * state.data_age_us,
          state.object_id,
          state.status,
          (state.status & session::kInContact) != 0,
          (state.status & session::kExact) != 0};
}

}  // namespace

std::array<double, 3> HandMotion::at(std::int64_t session_ns) const noexcept {
  if (session_ns <= begin_ns) return path.front();
  if (session_ns >= end_ns()) return path.back();
  const std::int64_t i = (session_ns - begin_ns) / interval_ns;
  const double share = static_cast<double>(session_ns - begin_ns - i * interval_ns) / static_cast<double>(interval_ns);
  const std::array<double, 3>&from = path[static_cast<std::size_t>(i)], &to = path[static_cast<std::size_t>(i) + 1];
  return {from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1]),
          from[2] + share * (to[2] - from[2])};
}

SessionClient::SessionClient(const wire::SessionAddress& address)
    : participants_{address},
      roster_out_{participants_, wire::topics::kRoster},
      clock_out_{participants_, wire::topics::kClock},
      clock_{participants_.origin(), {}, monotonic_ns()},
      roster_{participants_.origin(), {}} {
  self_.role = participants_.may_write(wire::topics::kIntent.name) ? session::Role::kClient : session::Role::kViewer;
  self_.name = participants_.address().participant;
  self_.session = address.session;
  listen(wire::topics::kRoster);
  listen(wire::topics::kCatalogue);
  listen(wire::topics::kProbeState);
  listen(wire::topics::kMetrics);
  listen(wire::topics::kEnd);
  listen(wire::topics::kClock);
  thread_ = std::thread{[this] { run(); }};
}

SessionClient::~SessionClient() {
  stops_ = true;
  thread_.join();
  wire::send_leave_messages([this] { send_roster_entry(true); });
}

template <class Typed>
void SessionClient::listen(const wire::TopicSpec<Typed>& topic) {
  readers_.push_back(std::make_shared<wire::Reader<Typed>>(participants_, topic, [this](Typed&& sample) {
    inbox_.put(std::move(sample), wire::kIsSentOnce<Typed> ? wire::Urgency::kMustArrive : wire::Urgency::kWakes);
  }));
}

void SessionClient::run() try {
  while (!stops_) {
    const std::vector<wire::Inbox<Sample>::Arrived> arrived = inbox_.take(kTick);
    const std::int64_t now_ns = monotonic_ns();
    {
      const std::lock_guard lock{mutex_};
      for (const auto& one : arrived) std::visit([&](const auto& sample) { on_sample(sample, one.at_ns); }, one.sample);
      on_events(roster_.tick(now_ns));
      if (found_ns_ == 0) {
        roster_.for_each([&](const session::RosterEntry& entry) {
          if (session::lists_stops(entry)) found_ns_ = now_ns;
        });
      }
      session::update_session_clock(roster_, participants_.origin(), session::Role::kClient, false, now_ns, clock_);
    }
    if (now_ns - beat_ns_ >= kBeatNs) {
      beat_ns_ = now_ns;
      send_roster_entry(false);
    }
    request_clock(now_ns);
    send_intents(now_ns);
  }
} catch (const std::exception& error) {  // it must not end the process of the script
  const std::lock_guard lock{mutex_};
  end_reason_ = std::string{"this participant has failed: "} + error.what();
}

void SessionClient::on_sample(const session::RosterEntry& entry, std::int64_t now_ns) {
  on_events(roster_.on_entry(entry, now_ns));
}

void SessionClient::on_events(const std::vector<session::RosterEvent>& events) {
  const session::Origin self = participants_.origin();
  for (const session::RosterEvent& event : events) {
    if (event.change == session::RosterChange::kLeft || event.change == session::RosterChange::kGone)
      figures_.erase(event.entry.origin.participant);
    if (event.change == session::RosterChange::kLeft) objects_.remove(event.entry.origin);
    if (event.change == session::RosterChange::kRestarted) objects_.remove_earlier(event.entry.origin);
    if (event.change != session::RosterChange::kNameConflict || event.entry.origin.participant != self.participant)
      continue;
    // As in client_sim::SimCore: the program that joined later leaves.
    const bool is_second = event.other == self.incarnation;
    if (event.entry_must_leave != is_second)
      end_reason_ = "another program named '" + self_.name + "' is already in session '" + self_.session + "'";
  }
}

void SessionClient::on_sample(const session::CatalogueEntry& entry, std::int64_t now_ns) {
  objects_.add(entry, roster_, now_ns);
}

void SessionClient::on_sample(const session::ProbeState& state, std::int64_t now_ns) {
  states_.add(state.user_id, row_of(state), now_ns);
}

void SessionClient::on_sample(const session::Metrics& metrics, std::int64_t) {
  if (roster_.find(metrics.origin.participant) == nullptr) return;
  std::map<std::string, double>& figures = figures_[metrics.origin.participant];
  for (const session::Figure& figure : metrics.figures)
    if (figures.size() < kMaxFigures || figures.count(figure.name) != 0) figures[figure.name] = figure.value;
}

void SessionClient::on_sample(const session::SessionEnd& end, std::int64_t) {
  if (end_reason_.empty()) end_reason_ = "the session has ended: " + end.text;
}

void SessionClient::on_sample(const session::ClockSample& sample, std::int64_t now_ns) {
  if (sample.answer && sample.peer == participants_.origin().participant) clock_.on_answer(sample, now_ns);
}

void SessionClient::send_roster_entry(bool leaving) {
  session::RosterEntry entry;
  {
    const std::lock_guard lock{mutex_};
    ++self_.heartbeat;
    self_.leaving = leaving;
    self_.origin = participants_.origin();
    session::put_time(clock_, false, monotonic_ns(), self_);
    entry = self_;
  }
  (void)roster_out_.send(entry);
}

void SessionClient::request_clock(std::int64_t now_ns) {
  session::ClockSample request;
  {
    const std::lock_guard lock{mutex_};
    const std::int64_t period = clock_.synchronised() ? kClockRequestNs : kClockRequestNs / 5;
    if (clock_.reference() == 0 || now_ns - clock_requested_ns_ < period) return;
    clock_requested_ns_ = now_ns;
    request = clock_.request(monotonic_ns());
  }
  request.origin = participants_.origin();
  (void)clock_out_.send(request);
}

void SessionClient::send_intents(std::int64_t now_ns) {
  std::vector<std::pair<wire::Writer<session::Intent>*, session::Intent>> intents;
  {
    const std::lock_guard lock{mutex_};
    const std::int64_t session_ns = session_now();
    for (auto& [name, user] : users_) {
      if (user.motion.path.empty() || now_ns - user.sent_ns < kIntentNs) continue;
      if (session_ns > user.motion.end_ns() + kRepeatNs) continue;
      user.sent_ns = now_ns;
      session::Intent intent;
      intent.user_id = session::id_of(name);
      intent.sequence = ++user.intents;
      for (std::size_t i = 0; i < session::kMaxWaypoints; ++i) {
        const std::int64_t at = session_ns + static_cast<std::int64_t>(i) * kWaypointNs;
        session::Waypoint& waypoint = intent.path.emplace_back();
        waypoint.session_time_ns = at;
        waypoint.pose.position = user.motion.at(at);
      }
      intents.emplace_back(user.writer.get(), std::move(intent));
    }
  }
  for (auto& [writer, intent] : intents) {
    intent.origin = participants_.origin();
    (void)writer->send(intent);
  }
}

std::int64_t SessionClient::session_now() const { return clock_.map().session_time(monotonic_ns()); }

std::map<std::string, SessionClient::Member> SessionClient::members() const {
  const std::lock_guard lock{mutex_};
  std::map<std::string, Member> members;
  for (const session::RosterEntry& entry : roster_.entries()) {
    const auto figures = figures_.find(entry.origin.participant);
    members[entry.name] = {entry, roster_.is_late(entry.origin.participant),
                           figures == figures_.end() ? std::map<std::string, double>{} : figures->second};
  }
  return members;
}

std::map<std::string, session::CatalogueEntry> SessionClient::objects() const {
  const std::lock_guard lock{mutex_};
  return objects_.newest();
}

std::optional<StateRow> SessionClient::newest_state(const std::string& user) const {
  const std::lock_guard lock{mutex_};
  return states_.newest(session::id_of(user));
}

std::vector<StateRow> SessionClient::take_states(const std::string& user) {
  const std::lock_guard lock{mutex_};
  return states_.take(session::id_of(user));
}

std::optional<std::int64_t> SessionClient::session_time() const {
  const std::lock_guard lock{mutex_};
  if (!clock_.synchronised()) return std::nullopt;
  return session_now();
}

std::string SessionClient::end_reason() const {
  const std::lock_guard lock{mutex_};
  return end_reason_;
}

void SessionClient::add_user(const std::string& user, const std::string& hrtc) {
  participants_.expect_permitted(user);
  session::RosterEntry entry;
  {
    const std::lock_guard lock{mutex_};
    if (!self_.requested_hrtc.empty() && self_.requested_hrtc != hrtc)
      throw std::invalid_argument("hrtc: found '" + hrtc + "', expected '" + self_.requested_hrtc +
                                  "', to which this participant has brought its other users");
    if (users_.count(user) != 0) return;
    entry = self_;
  }
  entry.origin = participants_.origin();
  entry.requested_hrtc = hrtc;
  entry.users.push_back(user);
  // An invalid entry is not sent, so this participant would leave the session with all its users.
  if (const char* const wrong = session::invalid_field(entry))
    throw std::invalid_argument(std::string{wrong} + "; found user '" + user + "', HRTC '" + hrtc + "'");
  // Without the lock, because this takes milliseconds.
  auto writer = std::make_unique<wire::Writer<session::Intent>>(participants_, wire::topics::kIntent,
                                                                wire::EndpointOptions{wire::user_partition(user)});
  const std::lock_guard lock{mutex_};
  users_[user].writer = std::move(writer);
  self_.requested_hrtc = hrtc;
  self_.users.push_back(user);
  beat_ns_ = 0;  // publishes the new user at once
}

bool SessionClient::is_served(const std::string& user) const {
  const std::lock_guard lock{mutex_};
  const session::RosterEntry* const hrtc = roster_.find(session::id_of(self_.requested_hrtc));
  return hrtc != nullptr && std::any_of(hrtc->served_users.begin(), hrtc->served_users.end(),
                                        [&](const session::UserProbe& probe) { return probe.user == user; });
}

template <class Typed>
void SessionClient::publish(std::unique_ptr<wire::Writer<Typed>>& writer, const wire::TopicSpec<Typed>& topic,
                            Typed& sample) {
  if (!writer) writer = std::make_unique<wire::Writer<Typed>>(participants_, topic);
  sample.origin = participants_.origin();
  if (writer->send(sample) == wire::SendStatus::kInvalid) throw std::invalid_argument(writer->invalid_reason());
}
void SessionClient::publish(session::EmergencyStop& stop) { publish(stop_out_, wire::topics::kStop, stop); }
void SessionClient::publish(session::ForceReset& reset) { publish(reset_out_, wire::topics::kReset, reset); }
void SessionClient::publish(session::Control& control) { publish(control_out_, wire::topics::kControl, control); }
void SessionClient::publish(session::SessionEnd& end) { publish(end_out_, wire::topics::kEnd, end); }

std::vector<session::StopName> SessionClient::standing_stops() const {
  const std::lock_guard lock{mutex_};
  return session::standing_stops(roster_);
}

bool SessionClient::has_discovered() const {
  const std::lock_guard lock{mutex_};
  return found_ns_ != 0 && monotonic_ns() - found_ns_ >= kDiscoveryNs;
}

std::pair<std::int64_t, std::int64_t> SessionClient::move(const std::string& user,
                                                          std::vector<std::array<double, 3>> path,
                                                          std::int64_t interval_ns, std::int64_t lead_ns) {
  const std::lock_guard lock{mutex_};
  const auto found = users_.find(user);
  if (found == users_.end())
    throw std::invalid_argument("user: found '" + user + "', expected a user that this participant has brought");
  found->second.motion = {std::move(path), session_now() + lead_ns, interval_ns};
  return {found->second.motion.begin_ns, found->second.motion.end_ns()};
}

}  // namespace tactus::python
