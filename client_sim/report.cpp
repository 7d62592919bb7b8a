#include "client_sim/report.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "session/figures.hpp"
#include "session/printable.hpp"

namespace tactus::client_sim {

namespace figures = session::figures;
using session::printable;

namespace {

/// Formats like printf and returns a string.
template <class... Values>
std::string line(const char* format, Values... values) {
  std::array<char, 512> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, values...);
  return buffer.data();
}

double value_of(const ParticipantReport& participant, const std::string& name) {
  const auto found = participant.figures.find(name);
  return found == participant.figures.end() ? 0 : found->second;
}

bool has(const ParticipantReport& participant, const std::string& name) { return participant.figures.count(name) != 0; }

constexpr std::size_t kColumns = 100;

/// Breaks lines that are longer than kColumns, at spaces where possible. Continuation lines have 4 columns more indent.
std::string wrapped(const std::string& text) {
  std::string out;
  std::size_t begin = 0;
  while (begin < text.size()) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    std::string remaining = text.substr(begin, end - begin);
    const std::string indent(std::min(remaining.find_first_not_of(' '), kColumns / 2) + 4, ' ');
    while (remaining.size() > kColumns) {
      std::size_t at = remaining.rfind(' ', kColumns);
      if (at == std::string::npos || at < indent.size()) at = kColumns;
      out += remaining.substr(0, at) + "\n";
      remaining = indent + remaining.substr(remaining[at] == ' ' ? at + 1 : at);
    }
    out += remaining + "\n";
    begin = end + 1;
  }
  return out;
}

/// A time in seconds; "-" for a negative one, which means never.
std::string time_or_dash(double seconds) { return seconds < 0 ? "-" : line("%.2f", seconds); }

void write_users(const Report& report, std::string& out) {
  out +=
      "\nUsers; touch and exact: first touch and first exact contact, from the start\n"
      "  name            hrtc          touch s  exact s  contact s  exact %  mean N   max N  touches  taps\n";
  for (const UserReport& user : report.users) {
    const TouchTally& touch = user.touch;
    out += line("  %-14s  %-12s  %7s  %7s  %9.2f  %7.2f  %6.2f  %6.2f  %7u  %4u\n",
                printable(user.name.substr(0, 14)).c_str(), printable(user.hrtc.substr(0, 12)).c_str(),
                time_or_dash(touch.first_touch).c_str(), time_or_dash(touch.first_exact).c_str(), touch.contact,
                100 * touch.exact_share(), touch.force_mean(), touch.force_max, touch.touches, user.taps);
    if (touch.states == 0) out += "    no probe state was received\n";
    if (user.lifts + user.lifts_lost > 0)
      out += line("    lifts %u, lost during the lift %u\n", user.lifts, user.lifts_lost);
    if (user.grabs + user.grabs_refused > 0)
      out += line("    grabs %u, refused %u, lost while held %u\n", user.grabs, user.grabs_refused, user.grabs_lost);
    if (user.approaches_missed + user.contacts_lost + touch.faults > 0) {
      out += line("    approaches without contact %u, contacts lost while following %u, faults %u",
                  user.approaches_missed, user.contacts_lost, touch.faults);
      out += touch.faults > 0 ? " (the last: " + touch.fault_reason + ")\n" : "\n";
    }
  }
}

void write_objects(const Report& report, std::string& out) {
  if (report.objects.empty()) return;
  out += "\nObjects that move      raised mm  held s    final mm    poses  takeovers\n";
  for (const ObjectReport& object : report.objects) {
    const MoveTally& moved = object.movement;
    out += line("  %-18s  %10.1f  %6.2f  %10.1f  %7llu  %9u\n", printable(object.name.substr(0, 18)).c_str(),
                1e3 * moved.max_raised, moved.held_time(), 1e3 * moved.last_raised,
                static_cast<unsigned long long>(moved.poses), moved.takeovers);
  }
  out += line("  energy injected between copies: %.4f mJ\n", 1e3 * injected_energy(report));
}

constexpr std::pair<const char*, const char*> kInterventions[] = {
    {figures::kInterventions[0], "limit"},        {figures::kInterventions[1], "slew"},
    {figures::kInterventions[2], "soft start"},   {figures::kInterventions[3], "stale pose"},
    {figures::kInterventions[4], "surface ramp"}, {figures::kInterventions[5], "stiffness cut"},
    {figures::kInterventions[6], "FAULT"}};

void write_hrtc(const ParticipantReport& hrtc, std::uint64_t records_total, std::string& out) {
  const auto value = [&](const std::string& name) { return value_of(hrtc, name); };
  out += "\nHRTC " + printable(hrtc.name) + (hrtc.present_at_end ? "\n" : " (gone before the end)\n");
  if (hrtc.figures.empty()) {
    out += "  published no figures\n";
    return;
  }
  out += line("  cycles %.0f", value(figures::kCycles));
  if (has(hrtc, figures::kRate)) out += line(" at %.1f Hz", value(figures::kRate));
  out += line(", %.0f skipped\n  late cycles: %.0f overruns", value(figures::kSkipped), value(figures::kOverruns));
  out += line(", %.0f preempted, %.0f unknown\n", value(figures::kPreempted), value(figures::kLateUnknown));
  if (has(hrtc, figures::kTimerOverruns))
    out += line("    (overruns of a reference timer with 30 us of work: %.0f)\n", value(figures::kTimerOverruns));
  if (has(hrtc, figures::kWakeP50)) {
    out += line("  late wake-up, us: p50 %.0f, p99 %.0f, max %.0f\n", value(figures::kWakeP50),
                value(figures::kWakeP99), value(figures::kWakeMax));
    if (has(hrtc, figures::kTimerP50))
      out += line("    reference timer without work: p50 %.0f, p99 %.0f, max %.0f\n", value(figures::kTimerP50),
                  value(figures::kTimerP99), value(figures::kTimerMax));
  }
  constexpr std::pair<const char*, const char*> kTimes[] = {
      {figures::kRefineTime, "T_R refine"}, {figures::kRefitTime, "T_B refit"}, {figures::kQueryTime, "T_Q query"},
      {figures::kLoadTime, "T_L load"},     {figures::kForceTime, "T_F force"}, {figures::kCycleTime, "cycle's work"}};
  if (has(hrtc, std::string{figures::kCycleTime} + ".p50")) {
    out += "  us                   p50        p99      p99.9        max\n";
    for (const auto& [name, label] : kTimes) {
      const std::string base = name;
      out += line("    %-14s  %9.1f  %9.1f  %9.1f  %9.1f\n", label, value(base + ".p50"), value(base + ".p99"),
                  value(base + ".p999"), value(base + ".max"));
    }
  }
  const double contact = value(figures::kContactCycles);
  out += line("  contact cycles %.0f, exact %.2f %%\n", contact,
              contact > 0 ? 100 * value(figures::kExactCycles) / contact : 0.0);
  out +=
      line("  pool %.0f of %.0f slots (peak %.0f), %.0f regions coarsened to free slots\n", value(figures::kPoolUsed),
           value(figures::kPoolLimit), value(figures::kPoolPeak), value(figures::kRegionsCoarsened));
  out += line(
      "  compressed cache %.0f of %.0f blocks (peak %.0f)\n"
      "    regions evicted %.0f, reloaded %.0f, refused for lack of memory %.0f\n",
      value(figures::kCompressedUsed), value(figures::kCompressedLimit), value(figures::kCompressedPeak),
      value(figures::kEvictions), value(figures::kReloads), value(figures::kRegionsRefused));
  if (value(figures::kRemoteDevices) > 0)
    out += line("  remote devices %.0f, max round trip %.1f ms\n", value(figures::kRemoteDevices),
                value(figures::kDeviceRoundTrip) * 1e-3);
  if (value(figures::kPortEnergy) != 0 || value(figures::kCopyGroups) > 0)
    out += line(
        "  objects moved: max distance between copies %.2f mm, couplings gave %.3f mJ and received %.3f mJ\n"
        "    energy at the ports of hands %.2f mJ, lowest at one port %.6f mJ; withheld %.3f mJ\n",
        value(figures::kCopiesApart) * 1e-3, value(figures::kCopyGiven) * 1e-3, value(figures::kCopyReceived) * 1e-3,
        value(figures::kPortEnergy) * 1e-3, value(figures::kPortLowest) * 1e-3, value(figures::kPortWithheld) * 1e-3);
  if (value(figures::kStaleCycles) > 0)
    out += line("  cycles with a stale pose, summed over probes: %.0f\n", value(figures::kStaleCycles));
  std::string interventions;
  for (const auto& [name, label] : kInterventions)
    if (value(name) > 0) interventions += line("%s%s %.0f", interventions.empty() ? "" : ", ", label, value(name));
  if (!interventions.empty()) out += "  limits on forces, number of times each began: " + interventions + "\n";
  const double records = value(figures::kRecordsReceived);
  out += line("  records received %.0f", records);
  if (records_total > 0) {
    out += line(" (%.2f %% of %llu)", 100 * records / static_cast<double>(records_total),
                static_cast<unsigned long long>(records_total));
  }
  out += line(", %.0f bytes, regions held %.0f\n", value(figures::kBytesReceived), value(figures::kRegionsHeld));
}

void write_topics(const Report& report, std::string& out) {
  out += "\nTopics                                     samples  lost %    rate/s   age us p50      p99      max\n";
  for (const UserReport& user : report.users) {
    const TouchTally& touch = user.touch;
    const double sent = static_cast<double>(touch.states + touch.states_lost);
    out += line("  %-38s  %8llu  %6.2f  %8.0f  %11.0f  %7.0f  %7.0f\n",
                printable(("probe_state of " + user.name).substr(0, 38)).c_str(),
                static_cast<unsigned long long>(touch.states),
                sent > 0 ? 100 * static_cast<double>(touch.states_lost) / sent : 0.0,
                touch.served > 0 ? static_cast<double>(touch.states) / touch.served : 0.0, touch.age_us.percentile(0.5),
                touch.age_us.percentile(0.99), touch.age_us.percentile(1));
  }
}

}  // namespace

void TouchTally::add(const session::ProbeState& state, std::int64_t start_ns, std::int64_t received_ns) {
  constexpr std::int64_t kMaxBounceNs = 20'000'000;  // a contact after a shorter interruption is no new touch
  constexpr double kMaxCovered = 0.05;               // s, max time that one state covers
  const session::Admission admission = window_.admit(state.origin, state.sequence, received_ns);
  if (!session::accepted(admission)) return;
  ++states;
  const double age = static_cast<double>(received_ns - state.session_time_ns) * 1e-3;
  age_us.add(static_cast<float>(age));
  course.add(static_cast<double>(state.session_time_ns - start_ns) * 1e-9, state, age);
  const bool contact_now = (state.status & session::kInContact) != 0;
  const bool exact_now = contact_now && (state.status & session::kExact) != 0;
  const double force = std::hypot(state.force[0], state.force[1], state.force[2]);
  if (admission == session::Admission::kAccepted) {
    states_lost += state.sequence - last_.sequence - 1;
    const double dt =
        std::clamp(static_cast<double>(state.session_time_ns - last_.session_time_ns) * 1e-9, 0.0, kMaxCovered);
    served += dt;
    if ((last_.status & session::kInContact) != 0) {
      contact += dt;
      force_seconds_ += dt * std::hypot(last_.force[0], last_.force[1], last_.force[2]);
      if ((last_.status & session::kExact) != 0) exact += dt;
    }
  }
  const bool fault_before = started_ && (last_.status & session::kFault) != 0;
  if ((state.status & session::kFault) != 0 && !fault_before) {
    ++faults;
    fault_reason = session::fault_reason(state.status);
  }
  if (contact_now) {
    const bool was_in_contact = started_ && (last_.status & session::kInContact) != 0;
    if (contact_ns_ == INT64_MIN || (!was_in_contact && state.session_time_ns - contact_ns_ >= kMaxBounceNs)) ++touches;
    contact_ns_ = state.session_time_ns;
    const double since_start = static_cast<double>(state.session_time_ns - start_ns) * 1e-9;
    if (first_touch < 0) first_touch = std::max(0.0, since_start);
    if (first_exact < 0 && exact_now) first_exact = std::max(0.0, since_start);
  }
  force_max = std::max(force_max, force);
  last_ = state;
  started_ = true;
}

void MoveTally::add(const session::ObjectPose& pose, double height) {
  constexpr std::int64_t kSamplePeriodNs = 10'000'000;
  constexpr std::size_t kMax = 1'000'000;
  if (poses++ == 0) first_height_ = height;
  if (poses > 1 && pose.origin.participant != last_.origin.participant) ++takeovers;
  last_raised = height - first_height_;
  max_raised = std::max(max_raised, last_raised);
  last_ = pose;
  if (heights_.size() < kMax && (heights_.empty() || pose.session_time_ns - heights_.back().ns >= kSamplePeriodNs))
    heights_.push_back({pose.session_time_ns, last_raised});
}

double MoveTally::held_time() const {
  constexpr double kMinLift = 0.005;  // m; a smaller max height does not count as a lift
  if (max_raised < kMinLift) return 0;
  std::int64_t longest = 0, since = -1;
  for (const Sample& sample : heights_) {
    if (sample.raised < 0.9 * max_raised)
      since = -1;
    else if (since < 0)
      since = sample.ns;
    else
      longest = std::max(longest, sample.ns - since);
  }
  return 1e-9 * static_cast<double>(longest);
}

double injected_energy(const Report& report) {
  double given = 0;
  for (const ParticipantReport& participant : report.participants) given += value_of(participant, figures::kCopyGiven);
  return 1e-6 * std::max(0.0, given);
}

std::string text(const Report& report) {
  std::string out = line("Session %s, scenario %s: %.1f s\n", printable(report.session).c_str(),
                         printable(report.scenario).c_str(), report.duration);
  if (!report.stop_reason.empty()) out += "Stopped early: " + printable(report.stop_reason) + "\n";
  write_users(report, out);
  write_objects(report, out);
  for (const ParticipantReport& participant : report.participants) {
    if (participant.role == session::Role::kHrtc) write_hrtc(participant, report.records_total, out);
  }
  for (const ParticipantReport& participant : report.participants) {
    if (participant.role != session::Role::kHost) continue;
    out += line("\nHost %s%s\n  sent %.0f bytes, %.0f records in %.0f regions, to %.0f HRTCs\n",
                printable(participant.name).c_str(), participant.present_at_end ? "" : " (gone before the end)",
                value_of(participant, figures::kHostBytes), value_of(participant, figures::kHostRecords),
                value_of(participant, figures::kHostRegions), value_of(participant, figures::kHostHrtcs));
  }
  write_topics(report, out);
  if (!report.events.empty()) out += "\nEvents, from the start\n";
  for (const ReportEvent& event : report.events) out += line("  %8.2f s  ", event.time) + printable(event.text) + "\n";
  return wrapped(out);
}

std::string json(const Report& report) {
  using nlohmann::json;
  json users = json::array();
  for (const UserReport& user : report.users) {
    const TouchTally& touch = user.touch;
    const auto moment_or_null = [](double seconds) { return seconds < 0 ? json{} : json(seconds); };
    users.push_back({{"name", user.name},
                     {"hrtc", user.hrtc},
                     {"first_touch_s", moment_or_null(touch.first_touch)},
                     {"first_exact_contact_s", moment_or_null(touch.first_exact)},
                     {"contact_s", touch.contact},
                     {"exact_share", touch.exact_share()},
                     {"force_mean_n", touch.force_mean()},
                     {"force_max_n", touch.force_max},
                     {"touches", touch.touches},
                     {"taps", user.taps},
                     {"approaches_missed", user.approaches_missed},
                     {"contacts_lost", user.contacts_lost},
                     {"following_s", user.following},
                     {"lifts", user.lifts},
                     {"lifts_lost", user.lifts_lost},
                     {"grabs", user.grabs},
                     {"grabs_refused", user.grabs_refused},
                     {"grabs_lost", user.grabs_lost},
                     {"faults", touch.faults},
                     {"fault_reason", touch.fault_reason},
                     {"probe_states",
                      {{"received", touch.states},
                       {"lost", touch.states_lost},
                       {"served_s", touch.served},
                       {"age_us",
                        {{"p50", touch.age_us.percentile(0.5)},
                         {"p99", touch.age_us.percentile(0.99)},
                         {"p999", touch.age_us.percentile(0.999)},
                         {"max", touch.age_us.percentile(1)}}}}}});
  }
  json objects = json::array();
  for (const ObjectReport& object : report.objects) {
    objects.push_back({{"name", object.name},
                       {"max_raised_m", object.movement.max_raised},
                       {"held_s", object.movement.held_time()},
                       {"last_raised_m", object.movement.last_raised},
                       {"poses", object.movement.poses},
                       {"takeovers", object.movement.takeovers}});
  }
  json participants = json::array();
  for (const ParticipantReport& participant : report.participants) {
    participants.push_back({{"name", participant.name},
                            {"role", session::role_name(participant.role)},
                            {"present_at_end", participant.present_at_end},
                            {"figures", participant.figures}});
  }
  json events = json::array();
  for (const ReportEvent& event : report.events) events.push_back({{"time_s", event.time}, {"text", event.text}});
  const json all{{"session", report.session},
                 {"scenario", report.scenario},
                 {"duration_s", report.duration},
                 {"stop_reason", report.stop_reason},
                 {"records_total", report.records_total},
                 {"users", users},
                 {"objects", objects},
                 {"injected_j", injected_energy(report)},
                 {"participants", participants},
                 {"implausible", report.implausible},
                 {"events", events}};
  // Names come from the network: invalid UTF-8 is replaced.
  return all.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace tactus::client_sim
