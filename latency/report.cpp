#include "latency/report.hpp"

#include <sys/utsname.h>

#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <ostream>
#include <set>
#include <thread>

namespace tactus::latency {
namespace {

std::string number(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string in_column(double us) { return number(us < 10'000 ? "%8.1f" : "%8.0f", us); }

nlohmann::ordered_json to_json(const Summary& summary) {
  return {{"n", summary.count}, {"mean", summary.mean},  {"p50", summary.p50}, {"p90", summary.p90},
          {"p99", summary.p99}, {"p99.9", summary.p999}, {"max", summary.max}};
}

}  // namespace

RunInfo run_info(int argc, const char* const* argv) {
  RunInfo info;
  for (int i = 0; i < argc; ++i) info.command += std::string{i == 0 ? "" : " "} + argv[i];
  std::ifstream cpuinfo{"/proc/cpuinfo"};
  std::string processor = "unknown";
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.rfind("model name", 0) != 0) continue;
    if (const std::size_t colon = line.find(": "); colon != std::string::npos) processor = line.substr(colon + 2);
    break;
  }
  info.machine = std::to_string(std::thread::hardware_concurrency()) + " x " + processor;
  if (utsname names{}; uname(&names) == 0) info.machine += std::string{", "} + names.sysname + " " + names.release;
  info.build = TACTUS_VERSION;
  return info;
}

void print_table(std::ostream& out, const RunInfo& info, const std::vector<Result>& results) {
  out << info.machine << "\n\nTimes in us, from the intended time of a ping.\n\n"
      << "             half round trip                             age one way                jitter   lost  re-    "
         "dup- echoes    "
         "mesh\n"
      << "     p50     p90     p99   p99.9     max       p50     p99   p99.9     max      +-               % order  "
         "lic.   lost    "
         "MB/s\n";
  for (const Result& r : results) {
    const Summary& half = r.half_round_trip;
    const double share = r.expected > 0 ? 100.0 * static_cast<double>(r.lost) / static_cast<double>(r.expected) : 0;
    out << describe(r.test) << '\n';
    for (const double us : {half.p50, half.p90, half.p99, half.p999, half.max}) out << in_column(us);
    out << "  ";
    for (const double us : {r.age.p50, r.age.p99, r.age.p999, r.age.max, r.clock_bound_us}) out << in_column(us);
    char line[128];
    std::snprintf(line, sizeof line, " %s%7.2f%6llu%6llu%7llu%8s\n", in_column(r.jitter_us).c_str(), share,
                  static_cast<unsigned long long>(r.reordered), static_cast<unsigned long long>(r.duplicates),
                  static_cast<unsigned long long>(r.echoes_lost),
                  r.test.load_mbit != 0 ? number("%.2f", r.load_mbyte_per_s).c_str() : "-");
    out << line;
  }
  out << '\n';
  std::set<std::string> notes;
  for (const Result& r : results) {
    notes.insert(r.notes.begin(), r.notes.end());
    if (r.refused > 0)
      notes.insert(describe(r.test) + ": " + std::to_string(r.refused) +
                   " pings were refused or blocked until the end");
  }
  for (const std::string& note : notes) out << note << '\n';
  double late_p50 = 0, late_p99 = 0;
  for (const Result& r : results) {
    late_p50 = std::max(late_p50, r.timer.p50);
    late_p99 = std::max(late_p99, r.timer.p99);
  }
  char line[160];
  std::snprintf(line, sizeof line,
                "lateness of the pinger's wake-ups in the worst test: p50 %.0f, p99 %.0f us; the half round trips "
                "contain half of "
                "it\n",
                late_p50, late_p99);
  out << line;
}

void write_json(const std::string& file, const RunInfo& info, const std::vector<Result>& results) {
  nlohmann::ordered_json out;
  out["program"] = "tactus-latency " + info.build;
  out["command"] = info.command;
  out["machine"] = info.machine;
  out["unit"] = "us";
  out["quantile_shares"] = quantile_shares();
  out["tests"] = nlohmann::ordered_json::array();
  for (const Result& r : results) {
    nlohmann::ordered_json test = latency::to_json(r.test);
    test["half_round_trip"] = to_json(r.half_round_trip);
    test["half_round_trip_from_send"] = to_json(r.half_round_trip_sent);
    test["age"] = to_json(r.age);
    test["age_of_information"] = to_json(r.age_of_information);
    test["clock_bound"] = r.clock_bound_us;
    test["wake_up_lateness"] = to_json(r.timer);
    test["jitter_rfc3550"] = r.jitter_us;
    test["expected"] = r.expected;
    test["lost"] = r.lost;
    test["echoes_lost"] = r.echoes_lost;
    test["reordered"] = r.reordered;
    test["duplicates"] = r.duplicates;
    test["refused"] = r.refused;
    test["mesh_mbyte_per_s"] = r.load_mbyte_per_s;
    test["curve"] = r.curve;
    test["notes"] = r.notes;
    out["tests"].push_back(std::move(test));
  }
  std::ofstream to{file};
  to << out.dump(2) << '\n';
  to.close();
  if (!to) throw LatencyError(file + ": cannot be written");
}

}  // namespace tactus::latency
