#include "tools/top/overview.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <set>
#include <utility>

#include "session/figures.hpp"
#include "session/printable.hpp"
#include "session/status_names.hpp"
#include "session/stop_latch.hpp"
#include "session/units.hpp"
#include "tools/has_room.hpp"
#include "tools/hex.hpp"

namespace tactus::top {
namespace {

namespace figures = session::figures;
using session::Role;
using tools::has_room;

constexpr std::int64_t kShowAbsentNs = 60'000 * kMs;  // participants that left or fell silent, and events
constexpr std::int64_t kDiscoveryNs = 2'000 * kMs;    // from the start until all participants are discovered
constexpr std::size_t kMaxEvents = 8;
constexpr std::size_t kMaxStopTexts = 64;
constexpr char kUnknown[] = "-";

std::string fixed(double value, int decimals) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  return text.data();
}

std::string ms(std::int64_t ns) { return fixed(static_cast<double>(ns) / 1e6, 0); }
std::string seconds(std::int64_t ns) { return fixed(static_cast<double>(ns) / 1e9, 0) + " s"; }

std::string clock_text(std::int64_t ns) {
  const std::int64_t s = ns / (1000 * kMs);
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%lld:%02d:%02d", static_cast<long long>(s / 3600),
                static_cast<int>(s / 60 % 60), static_cast<int>(s % 60));
  return text.data();
}

std::string count_of(std::size_t count, const std::string& what) {
  return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

std::string joined(const std::vector<std::string>& all) {
  std::string text;
  for (const std::string& one : all) text += (text.empty() ? "" : " ") + one;
  return text;
}

double length(const std::array<double, 3>& vector) { return std::hypot(vector[0], vector[1], vector[2]); }

bool has_forces(const session::RosterEntry& entry) { return entry.role == Role::kHrtc || entry.role == Role::kHost; }

/// A screen is drawn every half a second or more seldom, so a long time between two ticks means nothing.
session::RosterSettings settings_of_a_screen() {
  session::RosterSettings settings;
  settings.max_tick_ns = std::numeric_limits<std::int64_t>::max() / 2;
  return settings;
}

/// Sorts the rows after the head by their first cells, which are names.
std::vector<Row> sorted(std::vector<Row> rows) {
  std::sort(rows.begin() + 1, rows.end(), [](const Row& a, const Row& b) { return a.cells.front() < b.cells.front(); });
  return rows;
}

/// Appends a table under an empty line, unless it has only its head.
void add_table(const std::vector<Row>& rows, const std::string& alignment, std::vector<Line>& lines) {
  if (rows.size() < 2) return;
  lines.push_back({});
  for (Line& line : table(rows, alignment)) lines.push_back(std::move(line));
}

}  // namespace

std::string Overview::Figures::value(const std::string& name, int decimals) const {
  const auto found = newest.find(name);
  return found == newest.end() ? kUnknown : fixed(found->second, decimals);
}

std::string Overview::Figures::rate(const std::vector<std::string>& counters, double unit) const {
  if (before_ns == 0 || newest_ns <= before_ns) return kUnknown;
  double growth = 0;
  for (const std::string& name : counters) {
    const auto now = newest.find(name), then = before.find(name);
    if (now == newest.end() || then == before.end()) return kUnknown;
    growth += now->second - then->second;
  }
  return fixed(growth / (static_cast<double>(newest_ns - before_ns) / 1e9) / unit, 0);
}

std::string Overview::Figures::percentage(const std::string& used, const std::string& limit) const {
  const auto part = newest.find(used), whole = newest.find(limit);
  if (part == newest.end() || whole == newest.end() || !(whole->second > 0)) return kUnknown;
  return fixed(100 * part->second / whole->second, 0);
}

Overview::Overview(const session::Origin& self, std::string title, std::int64_t now_ns, std::string warning)
    : title_{std::move(title)},
      warning_{std::move(warning)},
      roster_{self, settings_of_a_screen()},
      begin_ns_{now_ns},
      screen_ns_{now_ns} {}

void Overview::on_sample(const session::RosterEntry& entry, std::int64_t now_ns) {
  apply(roster_.on_entry(entry, now_ns), now_ns);
  track_stops(now_ns);
}

void Overview::on_sample(const session::CatalogueEntry& entry, std::int64_t) {
  if (has_room(objects_, entry.object_id)) objects_[entry.object_id] = entry.object;
}

void Overview::on_sample(const session::Metrics& metrics, std::int64_t) {
  if (!has_room(figures_, metrics.origin.participant)) return;
  Figures& of = figures_[metrics.origin.participant];
  if (metrics.origin.incarnation < of.incarnation) return;
  if (metrics.origin.incarnation > of.incarnation) of = Figures{metrics.origin.incarnation, {}, {}, 0, 0};
  of.before = std::exchange(of.newest, {});  // each sample has all figures of a row
  of.before_ns = of.newest_ns;
  of.newest_ns = metrics.origin.time_ns;
  for (const session::Figure& figure : metrics.figures) of.newest[figure.name] = figure.value;
}

void Overview::on_sample(const session::ProbeState& state, std::int64_t now_ns) {
  if (!has_room(states_, state.user_id)) return;
  States& of = states_[state.user_id];
  const std::string fault = session::fault_reason(state.status);
  if (of.newest_ns != 0 && fault != session::fault_reason(of.newest.status))
    add_event("user '" + name_of_user(state.user_id) + "': " + (fault.empty() ? "fault ended" : "fault: " + fault),
              now_ns);
  if (of.newest_ns == 0) of.first_ns = now_ns;
  ++of.count;
  of.newest = state;
  of.newest_ns = now_ns;
}

void Overview::on_sample(const session::EmergencyStop& stop, std::int64_t) {
  if (stop_texts_.size() >= kMaxStopTexts) stop_texts_.clear();
  stop_texts_[stop.origin.participant] = stop.text;
}

void Overview::apply(const std::vector<session::RosterEvent>& events, std::int64_t now_ns) {
  for (const session::RosterEvent& event : events) {
    using Change = session::RosterChange;
    const std::uint64_t participant = event.entry.origin.participant;
    if (event.change == Change::kJoined || event.change == Change::kRestarted) absent_.erase(participant);
    const bool is_absent = event.change == Change::kLeft || event.change == Change::kGone;
    if (is_absent && has_room(absent_, participant))
      absent_[participant] = {event.entry, event.change == Change::kLeft, now_ns};
    if (event.change != Change::kChanged) add_event(session::text(event), now_ns);
  }
}

void Overview::add_event(std::string text, std::int64_t now_ns) {
  if (now_ns - begin_ns_ < kDiscoveryNs) return;  // it happened earlier, and is only discovered now
  events_.push_back({now_ns, std::move(text)});
  if (events_.size() > kMaxEvents) events_.pop_front();
}

/// Adds an event when the first stop begins and when the last one has ended.
void Overview::track_stops(std::int64_t now_ns) {
  std::size_t stopped = 0;
  roster_.for_each([&](const session::RosterEntry& entry) {
    stopped += has_forces(entry) && !session::standing_stops(entry.stops).empty() ? 1 : 0;
  });
  if ((stopped > 0) != (stopped_ > 0)) add_event(stopped > 0 ? "emergency stop" : "all emergency stops ended", now_ns);
  stopped_ = stopped;
}

std::vector<Line> Overview::screen(std::int64_t now_ns) {
  apply(roster_.tick(now_ns), now_ns);
  track_stops(now_ns);
  std::erase_if(absent_, [&](const auto& of) { return now_ns - of.second.since_ns > kShowAbsentNs; });
  while (!events_.empty() && now_ns - events_.front().at_ns > kShowAbsentNs) events_.pop_front();
  std::vector<Line> lines{title_line()};
  if (!warning_.empty()) lines.push_back({warning_, Emphasis::kAlert});
  add_stop_lines(lines);
  add_table(sorted(user_rows(now_ns)), "llrrrrlrl", lines);
  add_table(sorted(hrtc_rows(now_ns)), "llrrrrrrrr", lines);
  add_table(sorted(host_rows(now_ns)), "llrrrrr", lines);
  add_table(sorted(observer_rows(now_ns)), "llrl", lines);
  add_table(event_rows(now_ns), "rl", lines);
  for (auto& [user, states] : states_) states.count = 0;
  screen_ns_ = now_ns;
  return lines;
}

Line Overview::title_line() const {
  std::array<std::size_t, 4> counts{};  // by role
  std::int64_t session_time_ns = 0;
  roster_.for_each([&](const session::RosterEntry& entry) {
    ++counts.at(static_cast<std::size_t>(entry.role));
    session_time_ns = std::max(session_time_ns, entry.session_time_ns);
  });
  if (!has_participants()) return {title_ + ": no participants", Emphasis::kAlert};
  return {title_ + ", session time " + clock_text(session_time_ns) + ": " + count_of(counts[0], "host") + ", " +
          count_of(counts[1], "HRTC") + ", " + count_of(counts[2], "client") + ", " + count_of(counts[3], "viewer")};
}

void Overview::add_stop_lines(std::vector<Line>& lines) const {
  std::set<std::uint64_t> issuers;
  std::vector<std::string> obeying, others;
  roster_.for_each([&](const session::RosterEntry& entry) {
    if (!has_forces(entry)) return;
    const std::vector<session::StopName> stops = session::standing_stops(entry.stops);
    for (const session::StopName& stop : stops) issuers.insert(stop.participant);
    if (entry.role == Role::kHrtc) (stops.empty() ? others : obeying).push_back(entry.name);
  });
  if (issuers.empty()) return;
  std::string text = "EMERGENCY STOP: forces are off at " + (obeying.empty() ? "no HRTC" : joined(obeying));
  if (!others.empty()) text += ", NOT at " + joined(others);
  lines.push_back({session::printable(text), Emphasis::kAlert});
  for (const std::uint64_t issuer : issuers) {
    const auto reason = stop_texts_.find(issuer);
    if (reason != stop_texts_.end() && !reason->second.empty())
      lines.push_back({"reason: " + session::printable(reason->second), Emphasis::kAlert});
  }
}

std::string Overview::state_of(const session::RosterEntry& entry) const {
  if (roster_.is_late(entry.origin.participant)) return "late";
  return has_forces(entry) && !session::standing_stops(entry.stops).empty() ? "stopped" : "ok";
}

/// Returns a row that begins with name, state and age of a participant.
Row Overview::participant_row(const session::RosterEntry& entry, std::int64_t now_ns,
                              std::vector<std::string> cells) const {
  const std::string state = state_of(entry);
  const std::int64_t age_ns = now_ns - roster_.received_ns(entry.origin.participant);
  const std::array<std::string, 3> head{entry.name, state, ms(age_ns)};
  cells.insert(cells.begin(), head.begin(), head.end());
  return {std::move(cells), state == "ok" ? Emphasis::kNone : Emphasis::kAlert};
}

void Overview::add_absent_rows(Role role, std::int64_t now_ns, std::vector<Row>& rows) const {
  for (const auto& [participant, absent] : absent_) {
    if (absent.entry.role != role) continue;
    const std::string time = seconds(now_ns - absent.since_ns);
    rows.push_back({{absent.entry.name, absent.has_left ? "left " + time + " ago" : "gone for " + time},
                    absent.has_left ? Emphasis::kNone : Emphasis::kAlert});
  }
}

std::vector<Row> Overview::host_rows(std::int64_t now_ns) const {
  std::vector<Row> rows{{{"HOST", "STATE", "AGE ms", "OBJECTS", "RECEIVERS", "SENT kB/s", "REGIONS/s"}}};
  roster_.for_each([&](const session::RosterEntry& entry) {
    if (entry.role != Role::kHost) return;
    const auto found = figures_.find(entry.origin.participant);
    const Figures of = found == figures_.end() ? Figures{} : found->second;
    rows.push_back(participant_row(entry, now_ns,
                                   {of.value(figures::kHostObjects), of.value(figures::kHostHrtcs),
                                    of.rate({figures::kHostBytes}, 1e3), of.rate({figures::kHostRegions})}));
  });
  add_absent_rows(Role::kHost, now_ns, rows);
  return rows;
}

std::vector<Row> Overview::hrtc_rows(std::int64_t now_ns) const {
  std::vector<Row> rows{
      {{"HRTC", "STATE", "AGE ms", "CYCLES/s", "p99 us", "LATE/s", "POOL %", "CACHE %", "RECV kB/s", "FAULTS"}}};
  roster_.for_each([&](const session::RosterEntry& entry) {
    if (entry.role != Role::kHrtc) return;
    const auto found = figures_.find(entry.origin.participant);
    const Figures of = found == figures_.end() ? Figures{} : found->second;
    const std::string rate = of.rate({figures::kCycles});
    rows.push_back(
        participant_row(entry, now_ns,
                        {rate == kUnknown ? of.value(figures::kRate) : rate, of.value(figures::kRecentCycleP99),
                         of.rate({figures::kOverruns, figures::kPreempted, figures::kLateUnknown}),
                         of.percentage(figures::kPoolUsed, figures::kPoolLimit),
                         of.percentage(figures::kCompressedUsed, figures::kCompressedLimit),
                         of.rate({figures::kBytesReceived}, 1e3), of.value("safety.faults")}));
  });
  add_absent_rows(Role::kHrtc, now_ns, rows);
  return rows;
}

Row Overview::user_row(const session::UserProbe& user, const std::string& hrtc, std::int64_t now_ns) const {
  const auto found = states_.find(session::id_of(user.user));
  if (found == states_.end())
    return {{user.user, hrtc, std::to_string(user.probe), kUnknown, kUnknown, kUnknown, kUnknown, kUnknown,
             "no probe state yet"},
            Emphasis::kAlert};
  const States& of = found->second;
  const session::ProbeState& state = of.newest;
  const double period = static_cast<double>(now_ns - std::max(screen_ns_, of.first_ns)) / 1e9;
  const auto object = objects_.find(state.object_id);
  const std::string object_name = object != objects_.end() ? object->second : tools::hex(state.object_id);
  const std::string fault = session::fault_reason(state.status);
  const std::string status = joined(session::status_names(state.status));
  return {
      {user.user, hrtc, std::to_string(user.probe), fixed(period > 0 ? static_cast<double>(of.count) / period : 0, 0),
       ms(now_ns - of.newest_ns + state.data_age_us * 1000LL), fixed(length(state.force), 2),
       state.object_id == 0 ? kUnknown : object_name,
       (state.status & session::kInContact) == 0 ? kUnknown : fixed(state.error_bound * 1e3, 3),
       fault.empty() ? status : "FAULT: " + fault + "; " + status},
      fault.empty() ? Emphasis::kNone : Emphasis::kAlert};
}

std::vector<Row> Overview::user_rows(std::int64_t now_ns) const {
  std::vector<Row> rows{{{"USER", "HRTC", "PROBE", "STATES/s", "AGE ms", "FORCE N", "OBJECT", "ERROR mm", "STATUS"}}};
  std::set<std::string> served;
  roster_.for_each([&](const session::RosterEntry& entry) {
    for (const session::UserProbe& user : entry.served_users) {
      rows.push_back(user_row(user, entry.name, now_ns));
      served.insert(user.user);
    }
  });
  roster_.for_each([&](const session::RosterEntry& entry) {
    for (const std::string& user : entry.users)
      if (served.count(user) == 0)
        rows.push_back({{user, entry.requested_hrtc, kUnknown, kUnknown, kUnknown, kUnknown, kUnknown, kUnknown,
                         "waits for its HRTC"},
                        Emphasis::kAlert});
  });
  return rows;
}

std::vector<Row> Overview::observer_rows(std::int64_t now_ns) const {
  std::vector<Row> rows{{{"CLIENT, VIEWER", "STATE", "AGE ms", "USERS"}}};
  for (const Role role : {Role::kClient, Role::kViewer}) {
    roster_.for_each([&](const session::RosterEntry& entry) {
      if (entry.role == role) rows.push_back(participant_row(entry, now_ns, {joined(entry.users)}));
    });
    add_absent_rows(role, now_ns, rows);
  }
  return rows;
}

std::vector<Row> Overview::event_rows(std::int64_t now_ns) const {
  std::vector<Row> rows{{{"AGO", "EVENT"}}};
  for (auto event = events_.rbegin(); event != events_.rend(); ++event)
    rows.push_back({{seconds(now_ns - event->at_ns), event->text}});
  return rows;
}

std::string Overview::name_of_user(std::uint64_t user) const {
  std::string name = tools::hex(user);
  roster_.for_each([&](const session::RosterEntry& entry) {
    for (const session::UserProbe& served : entry.served_users)
      if (session::id_of(served.user) == user) name = served.user;
  });
  return name;
}

}  // namespace tactus::top
