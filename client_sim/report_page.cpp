#include "client_sim/report_page.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>
#include <vector>

#include "page/page.hpp"
#include "page/plot.hpp"
#include "session/figures.hpp"

namespace tactus::client_sim {
namespace {

namespace figures = session::figures;
using TableRows = std::vector<std::vector<std::string>>;

constexpr char kRed[] = "#e53e3e";

std::string fixed_text(double value, int decimals) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  return text.data();
}

/// A time since the start; "-" for a negative one, which means never.
std::string moment_text(double seconds) { return seconds < 0 ? "-" : fixed_text(seconds, 2); }

std::string time_with_unit(double us) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g %s",
                us >= 1e6   ? us * 1e-6
                : us >= 1e3 ? us * 1e-3
                            : us,
                us >= 1e6   ? "s"
                : us >= 1e3 ? "ms"
                            : "us");
  return text.data();
}

/// A figure of a participant; "-" if it was not published.
std::string figure_text(const ParticipantReport& participant, const std::string& name, int decimals = 0) {
  const auto found = participant.figures.find(name);
  return found == participant.figures.end() ? "-" : fixed_text(found->second, decimals);
}

std::string share_text(const ParticipantReport& participant, const char* part, const char* whole) {
  const auto numerator = participant.figures.find(part), denominator = participant.figures.find(whole);
  if (numerator == participant.figures.end() || denominator == participant.figures.end() || !(denominator->second > 0))
    return "-";
  return fixed_text(100 * numerator->second / denominator->second, 2);
}

std::string name_text(const ParticipantReport& participant) {
  return participant.name + (participant.present_at_end ? "" : " (gone before the end)");
}

std::string user_table(const Report& report) {
  TableRows rows{{"user", "HRTC", "first touch s", "first exact s", "contact s", "exact %", "mean N", "max N",
                  "touches", "taps", "faults", "states", "lost %", "age p50 us", "p99 us", "max us"}};
  for (const UserReport& user : report.users) {
    const TouchTally& touch = user.touch;
    const double sent = static_cast<double>(touch.states + touch.states_lost);
    const auto age = [&](double share) {
      return touch.states > 0 ? fixed_text(touch.age_us.percentile(share), 0) : "-";
    };
    rows.push_back({user.name, user.hrtc, moment_text(touch.first_touch), moment_text(touch.first_exact),
                    fixed_text(touch.contact, 2), fixed_text(100 * touch.exact_share(), 2),
                    fixed_text(touch.force_mean(), 2), fixed_text(touch.force_max, 2), std::to_string(touch.touches),
                    std::to_string(user.taps), std::to_string(touch.faults), std::to_string(touch.states),
                    sent > 0 ? fixed_text(100 * static_cast<double>(touch.states_lost) / sent, 2) : "-", age(0.5),
                    age(0.99), age(1)});
  }
  return page::table(rows);
}

std::string hrtc_table(const Report& report) {
  TableRows rows{{"HRTC", "cycles", "Hz", "overruns", "preempted", "unknown", "work p50 us", "p99 us", "max us",
                  "exact %", "pool %", "cache %", "records", "bytes", "evicted", "faults"}};
  const std::string work = figures::kCycleTime;
  for (const ParticipantReport& hrtc : report.participants) {
    if (hrtc.role != session::Role::kHrtc) continue;
    rows.push_back({name_text(hrtc), figure_text(hrtc, figures::kCycles), figure_text(hrtc, figures::kRate, 1),
                    figure_text(hrtc, figures::kOverruns), figure_text(hrtc, figures::kPreempted),
                    figure_text(hrtc, figures::kLateUnknown), figure_text(hrtc, work + ".p50", 1),
                    figure_text(hrtc, work + ".p99", 1), figure_text(hrtc, work + ".max", 1),
                    share_text(hrtc, figures::kExactCycles, figures::kContactCycles),
                    share_text(hrtc, figures::kPoolPeak, figures::kPoolLimit),
                    share_text(hrtc, figures::kCompressedPeak, figures::kCompressedLimit),
                    figure_text(hrtc, figures::kRecordsReceived), figure_text(hrtc, figures::kBytesReceived),
                    figure_text(hrtc, figures::kEvictions), figure_text(hrtc, "safety.faults")});
  }
  return page::table(rows);
}

std::string host_table(const Report& report) {
  TableRows rows{{"host", "objects", "HRTCs", "bytes sent", "records", "regions"}};
  for (const ParticipantReport& host : report.participants)
    if (host.role == session::Role::kHost)
      rows.push_back({name_text(host), figure_text(host, figures::kHostObjects), figure_text(host, figures::kHostHrtcs),
                      figure_text(host, figures::kHostBytes), figure_text(host, figures::kHostRecords),
                      figure_text(host, figures::kHostRegions)});
  return page::table(rows);
}

/// Returns a table of the objects that moved, with its title; empty without such objects.
std::string object_section(const Report& report) {
  if (report.objects.empty()) return {};
  TableRows rows{{"object", "raised mm", "held s", "final mm", "poses", "takeovers"}};
  for (const ObjectReport& object : report.objects) {
    const MoveTally& moved = object.movement;
    rows.push_back({object.name, fixed_text(1e3 * moved.max_raised, 1), fixed_text(moved.held_time(), 2),
                    fixed_text(1e3 * moved.last_raised, 1), std::to_string(moved.poses),
                    std::to_string(moved.takeovers)});
  }
  return "<h2>Objects that moved</h2>\n" + page::table(rows) +
         "<p>Energy injected between copies: " + fixed_text(1e3 * injected_energy(report), 4) + " mJ</p>\n";
}

/// Returns the time that the plots cover, s.
double covered_time(const Report& report) {
  double end = std::max(report.duration, 0.1);
  for (const UserReport& user : report.users) {
    const TouchCourse& course = user.touch.course;
    end = std::max(end, static_cast<double>(course.intervals().size()) * course.interval_length());
  }
  return end;
}

/// Calls `visit` with the position on the time axis and the interval, for each interval with states.
template <class Visit>
void for_each_interval(const TouchCourse& course, double end, Visit&& visit) {
  for (std::size_t i = 0; i < course.intervals().size(); ++i)
    if (course.intervals()[i].states > 0)
      visit((static_cast<double>(i) + 0.5) * course.interval_length() / end, course.intervals()[i]);
}

void add_time_axis(page::Plot& plot, double end, const char* caption) {
  for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) plot.tick(share, fixed_text(share * end, 1) + " s");
  plot.caption(caption);
}

/// Plots the force of one user over time.
std::string force_plot(const TouchCourse& course, double max_force, double end, const char* colour) {
  page::Plot plot{{0, std::max(max_force, 0.1)}};
  add_time_axis(plot, end, "max force in N over time; red: force off by a fault, or contact that was not exact");
  std::vector<std::pair<double, double>> points;
  for_each_interval(course, end, [&](double share, const TouchInterval& interval) {
    points.emplace_back(share, interval.force_max);
    if (interval.fault || interval.coarse_contact) plot.mark(share, kRed);
  });
  plot.curve(points, colour, 1.2);
  return plot.svg();
}

/// Plots the ages of the probe states of all users over time.
std::string age_plot(const Report& report, double end) {
  double low = 1e9, high = 1;
  for (const UserReport& user : report.users)
    for_each_interval(user.touch.course, end, [&](double, const TouchInterval& interval) {
      low = std::min(low, std::max<double>(interval.age_max_us, 1));
      high = std::max<double>(high, interval.age_max_us);
    });
  page::Plot plot{{std::min(low, high), high, true, time_with_unit}};
  add_time_axis(plot, end, "max age of probe states at their arrival");
  for (std::size_t i = 0; i < report.users.size(); ++i) {
    std::vector<std::pair<double, double>> points;
    for_each_interval(report.users[i].touch.course, end, [&](double share, const TouchInterval& interval) {
      points.emplace_back(share, std::max<double>(interval.age_max_us, 1));
    });
    plot.curve(points, page::colour(i), 1.2);
  }
  return plot.svg();
}

std::string event_table(const Report& report) {
  if (report.events.empty()) return "<p>none</p>\n";
  TableRows rows{{"time s", "event"}};
  for (const ReportEvent& event : report.events) rows.push_back({fixed_text(event.time, 2), event.text});
  return page::table(rows);
}

}  // namespace

std::string html(const Report& report) {
  const std::string title = "Session " + report.session + ", scenario " + report.scenario;
  std::string body = "<h1>" + page::escaped(title) + "</h1>\n<p>" + fixed_text(report.duration, 1) + " s";
  if (!report.stop_reason.empty()) body += ". Stopped early: " + page::escaped(report.stop_reason);
  body += "</p>\n<h2>Users</h2>\n" + user_table(report);
  const double end = covered_time(report);
  double max_force = 0;
  std::vector<std::string> names;
  for (const UserReport& user : report.users) {
    max_force = std::max(max_force, user.touch.force_max);
    names.push_back(user.name);
  }
  for (std::size_t i = 0; i < report.users.size(); ++i)
    body += "<h2>Force on " + page::escaped(names[i]) + "</h2>\n" +
            force_plot(report.users[i].touch.course, max_force, end, page::colour(i));
  body += "<h2>Age of probe states</h2>\n" + age_plot(report, end) + page::legend(names) + object_section(report);
  body += "<h2>HRTCs</h2>\n" + hrtc_table(report) + "<h2>Hosts</h2>\n" + host_table(report);
  body += "<h2>Events</h2>\n" + event_table(report);
  return page::page(title, body);
}

}  // namespace tactus::client_sim
