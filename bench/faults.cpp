// Runs the safety tests R1 to R26: each causes one kind of fault and compares its effects with bounds. It starts other
// benchmarks and tests for some of them, and measures the others (fault_runs.hpp).
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "bench/fault_runs.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using Arguments = std::vector<std::string>;

/// A row of another benchmark, and its bound there, or a bound for a row without one.
struct BoundedRow {
  const char* figure;  ///< the exact name
  double bound;
  const char* population = "";  ///< a part of its name
  Limit limit = Limit::kAtMost;
};
/// Another benchmark, the arguments of a quick run, and its rows.
struct Benchmark {
  const char* name;
  Arguments arguments, quick;
  std::vector<BoundedRow> rows;
};
/// Test cases, all of which have to pass.
struct Cases {
  const char* program;
  const char* filter;  ///< of GoogleTest
  const char* quick;   ///< the filter of a quick run
};
using Measurement = void (*)(const FaultSettings&, Report&);
using Source = std::variant<Benchmark, Cases, Measurement>;

struct Fault {
  const char* name;
  const char* text;
  std::vector<Source> sources;
};

const std::vector<Fault>& faults() {
  const auto partition = [](std::vector<BoundedRow> rows) {
    return Source{Benchmark{"rejoin", {"--joins", "1"}, {"--joins", "1", "--rounds", "1"}, std::move(rows)}};
  };
  static const std::vector<Fault> all{
      {"R1",
       "a VE host is killed while it streams",
       {Benchmark{"takeover",
                  {},
                  {"--quick"},
                  {{"time from SIGKILL to the first demand to the other host, p99", 50},
                   {"time from SIGKILL until records arrive again, p99", 100},
                   {"max time from the start of the only host until its HRTC acknowledges a chunk", 1000},
                   {"mean overruns in a window with a kill minus those in a window without", 0},
                   {"max force step", 0.4},  // 5 % of the largest force in 1 ms
                   {"records received again by an HRTC that holds all, from the restarted only host", 0}}}}},
      {"R2", "an HRTC is killed and joins again", {measure_killed_hrtc}},
      {"R3",
       "an HRTC is frozen",
       {Benchmark{"scale",
                  {"--part", "trouble"},
                  {"--part", "trouble", "--quick"},
                  {{"median p99 of the delivery time of a region, divided by that when all HRTCs run", 1.1, "frozen"},
                   {"median p99 of the age of probe states, divided by that when all HRTCs run", 1.1, "frozen"},
                   {"longest time without a probe state in a window", 500, "frozen"},
                   {"max growth of the host's memory in a window", 1, "frozen"}}}}},
      {"R4",
       "the network is cut for 1 s",
       {partition({{"partition of 1 s: max time from its end until a probe state arrives", 100},
                   {"partition of 1 s: max number of records received again", 0},
                   {"partition of 1 s: max time from its end until all agree", 2000}})}},
      {"R5",
       "the network is cut for 5 s",
       {partition({{"partition of 5 s: max time from its end until a probe state arrives", 1000},
                   {"partition of 5 s: max number of records received again", 0},
                   {"partition of 5 s: max time from its end until all agree", 2000}}),
        Cases{"session_test", "Ownership.*", "Ownership.*"}}},
      {"R6",
       "the network is cut in one direction",
       {partition({{"partition of 3 s towards the host: max time from its end until all agree", 2000},
                   {"partition of 3 s from the host: max time from its end until all agree", 2000},
                   {"partition of 8 s towards the host: max time from its end until all agree", 2000},
                   {"partition of 8 s from the host: max time from its end until all agree", 2000},
                   {"with keys, partition of 20 s: max time from its end until all agree", 8000},
                   {"with keys, partition of 8 s towards the host: max time from its end until all agree", 8000},
                   {"with keys, partition of 8 s from the host: max time from its end until all agree", 8000}}),
        Cases{"session_test", "Ownership.ACutInOneDirection*", "Ownership.ACutInOneDirection*"}}},
      {"R7",
       "1 to 30 % of the packets with probe states are lost",
       {Benchmark{"loss",
                  {},
                  {"--quick"},
                  {{"loss 1 %: lost", 1.8},
                   {"loss 5 %: lost", 7},
                   {"loss 10 %: lost", 13.5},
                   {"loss 30 %: lost", 39.5},
                   {"loss 1 %: age of information p99", 1.5},
                   {"loss 5 %: age of information p99", 2.5},
                   {"loss 10 %: age of information p99", 3},
                   {"loss 30 %: age of information p99", 5}}},
        Benchmark{"passive",
                  {},
                  {"--quick"},
                  {{"min energy of the port of a hand on a shared object, 0 to 500 ms", -1e-6, "", Limit::kAtLeast},
                   {"runs with finite results (1: all, 0: not all)", 1, "", Limit::kAtLeast},
                   {"min energy of the tank of a copy, 0 to 500 ms", -1e-12, "", Limit::kAtLeast}}}}},
      {"R8",
       "1 to 30 % of the packets with regions are lost",
       {Benchmark{"loss",
                  {},
                  {"--quick"},
                  {{"loss 1 %: delivery of 50 kB of records, p99", 30},
                   {"loss 5 %: delivery of 50 kB of records, p99", 60},
                   {"loss 10 %: delivery of 50 kB of records, p99", 80},
                   {"loss 30 %: delivery of 50 kB of records, p99", 200},
                   {"loss 1 %: longest time without a complete burst", 500},
                   {"loss 5 %: longest time without a complete burst", 500},
                   {"loss 10 %: longest time without a complete burst", 500},
                   {"loss 30 %: longest time without a complete burst", 500},
                   {"loss 10 %: bytes sent for each byte delivered", 1.5},
                   {"loss 30 %: bytes sent for each byte delivered", 2.5}}}}},
      {"R9",
       "a link of 2 Mbit/s",
       {measure_narrow_link, Cases{"session_test", "DeliveryServerTest.SendsTheSoonestRegionFirst*",
                                   "DeliveryServerTest.SendsTheSoonestRegionFirst*"}}},
      {"R9b", "loss of 5 % and of 1 %, without a long silence", {measure_loss_of_fragments}},
      {"R10",
       "packets are reordered and arrive twice",
       {Benchmark{"simulate", {"--schedules", "10000"}, {"--quick"}, {{"schedules with a broken condition", 0}}},
        measure_repeated_frames}},
      {"R11", "bits of chunks are flipped", {Cases{"wire_test", "*BitFlips.*", "BitFlips.*"}}},
      {"R12",
       "participants without keys, or with keys of others",
       {Cases{"e2e_test", "SecuredTest.OnlyMembersTakePart", "SecuredTest.OnlyMembersTakePart"},
        Cases{"wire_dds_test", "ForgedTest.APlain*", "ForgedTest.APlain*"}}},
      {"R13",
       "a member writes what it may not",
       {Cases{"e2e_test", "SecuredTest.TheKeysOfAUser*", "SecuredTest.TheKeysOfAUser*"},
        Cases{"wire_dds_test", "ForgedTest.AMember*", "ForgedTest.AMember*"},
        Cases{"wire_test", "MembersTest.*:Rights.*", "MembersTest.*:Rights.*"}}},
      {"R14", "10,000 packets of random bytes a second", {measure_flood}},
      {"R15",
       "the gateway dies or hangs",
       {Benchmark{"gateway",
                  {},
                  {"--quick"},
                  {{"SIGKILL: time until both users are back, p99", 3000},
                   {"SIGSEGV: time until both users are back, p99", 3000},
                   {"SIGSTOP for 2 s: time until both users are back, p99", 3000},
                   {"lack of memory: time until both users are back, p99", 3000},
                   {"first kill: time until the next gateway is in the session", 1000},
                   {"largest change of a force, no gateway", 0},
                   {"smallest force, no gateway", 0.05, "", Limit::kAtLeast},
                   {"late cycles, difference of the two", 3}}},
        Cases{"e2e_test", "GatewayTest.WithoutItAFixedObject*", "GatewayTest.WithoutItAFixedObject*"}}},
      {"R16",
       "clocks are wrong, step and drift",
       {measure_wrong_clock, Cases{"wire_dds_test", "Incarnation.*", "Incarnation.*"},
        Cases{"session_test", "SessionClock.*:TimeReferenceTest.*", "SessionClock.*:TimeReferenceTest.*"}}},
      {"R17",
       "one HRTC of several is slow",
       {Benchmark{
            "scale",
            {"--part", "trouble"},
            {"--part", "trouble", "--quick"},
            {{"median p99 of the delivery time of a region, divided by that when all HRTCs run", 1.1, "throttled"},
             {"median p99 of the age of probe states, divided by that when all HRTCs run", 1.1, "throttled"},
             {"longest time without a probe state in a window", 500, "throttled"}}},
        measure_slow_link}},
      {"R18", "the disk is full while a session is recorded", {measure_full_disk}},
      {"R19",
       "malformed model files",
       {Cases{"spm_importer_test", "*", "*"}, Cases{"e2e_test", "WrongInput*", "WrongInput*"}}},
      {"R20", "programs are killed while they write files", {Cases{"e2e_test", "TwoHundredKills.*", "KillTest.*"}}},
      {"R21",
       "less memory than the model needs",
       {Benchmark{"memory",
                  {},
                  {"--quick"},
                  {{"resident memory minus idle HRTC and --memory", 8},
                   {"exit status of the HRTC", 0},
                   {"exit status of the audit", 0},
                   {"distance error above the error bound", 0}}},
        measure_small_memory}},
      {"R22",
       "numbers that are not finite, absurd poses and jumps",
       {Benchmark{"safety",
                  {},
                  {"--quick"},
                  {{"max force", 8.000001},
                   {"max torque", 0.3000001},
                   {"forces and torques over their slew limit", 0},
                   {"forces and torques that are not finite", 0},
                   {"forces and torques despite a fault", 0},
                   {"cycles with a fault without a reason", 0},
                   {"faults that ended without a reset", 0}}},
        Cases{"wire_dds_test", "Hostile.*", "Hostile.*"}}},
      {"R23",
       "the haptic thread stops",
       {Benchmark{"driver", {}, {"--quick"}, {{"time from the last command to zero force, max", 11}}},
        Cases{"driver_process_test", "*.AKilledHrtc*:*.ASuspendedServo*:*.TheForceGrowsFromZero*",
              "*.AKilledHrtc*:*.ASuspendedServo*:*.TheForceGrowsFromZero*"}}},
      {"R24",
       "32 HRTCs join at once",
       {Benchmark{
           "scale",
           {"--part", "joining"},
           {"--part", "joining", "--quick"},
           {{"time until all HRTCs are started", 1, "at rest"},
            {"time until the last exact contact", 5, "at rest"},
            {"median p99 of the delivery time of a region for an earlier HRTC, divided by that before HRTCs join", 1.1},
            {"median p99 of the age of probe states of an earlier user, divided by that before HRTCs join", 1.1},
            {"longest time without a probe state in a window", 500}}}}},
      {"R25", "a second host takes over a movable object", {measure_body_takeover}},
      {"R26", "random faults", {measure_random_faults}}};
  return all;
}

/// Reads a file that a started program has written.
nlohmann::json read_json(const std::string& path, const std::string& program) {
  std::ifstream file{path};
  if (!file) throw std::runtime_error(program + " has written no results");
  return nlohmann::json::parse(file);
}

class Runner {
 public:
  Runner(const FaultSettings& settings, bool is_quick) : settings_{settings}, is_quick_{is_quick} {}

  void add_rows(const Fault& fault, Report& report) {
    report.set_prefix(std::string{fault.name} + ", " + fault.text + ": ");
    for (const Source& source : fault.sources) {
      try {
        std::visit([&](const auto& how) { measure(how, report); }, source);
      } catch (const std::exception& error) {  // the other faults are measured nevertheless
        if (realtime::stop_signal()) throw;
        report.add_at_most("the measurement failed", {"run", 1}, "", kUnfinished, 0);
        report.add_note(std::string{fault.name} + ": " + error.what());
      }
    }
  }

 private:
  /// Faults that share a benchmark share its run.
  const nlohmann::json& results_of(const Benchmark& benchmark) {
    const Arguments& arguments = is_quick_ ? benchmark.quick : benchmark.arguments;
    Arguments command{program_path(std::string{"bench-"} + benchmark.name)};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const auto known = results_.find(command);
    if (known != results_.end()) return known->second;
    const std::string file = folder_.path() / (std::to_string(results_.size()) + ".json");
    Arguments with_json = command;
    with_json.insert(with_json.end(), {"--json", file});
    std::fprintf(stderr, "benchmark %s\n", benchmark.name);
    run(with_json, kMaxBenchmark);
    return results_[command] = read_json(file, command.front());
  }
  void measure(const Benchmark& benchmark, Report& report) {
    const nlohmann::json& rows = results_of(benchmark).at("rows");
    for (const BoundedRow& wanted : benchmark.rows) {
      // A percentile with a bound has a second row without it.
      std::set<std::pair<std::string, std::size_t>> found;
      for (const nlohmann::json& row : rows) {
        const std::string of = row.at("population");
        if (row.at("figure") != wanted.figure || of.find(wanted.population) == std::string::npos) continue;
        const Population population{of, row.at("n").get<std::size_t>()};
        if (!found.insert({population.name, population.n}).second) continue;
        const double value = row.at("value").is_null() ? kUnfinished : row.at("value").get<double>();
        if (wanted.limit == Limit::kAtLeast)
          report.add_at_least(wanted.figure, population, row.at("unit"), value, wanted.bound);
        else
          report.add_at_most(wanted.figure, population, row.at("unit"), value, wanted.bound);
      }
      if (found.empty()) throw std::runtime_error(std::string{benchmark.name} + " has no row '" + wanted.figure + "'");
    }
  }
  void measure(const Cases& cases, Report& report) {
    const std::string program =
        std::filesystem::path{program_path("host")}.parent_path().parent_path() / "tests" / cases.program;
    const char* const filter = is_quick_ ? cases.quick : cases.filter;
    const std::string file = folder_.path() / "cases.json";
    std::filesystem::remove(file);
    std::fprintf(stderr, "%s, %s\n", cases.program, filter);
    run({program, std::string{"--gtest_filter="} + filter, "--gtest_output=json:" + file}, kMaxCases);
    const nlohmann::json results = read_json(file, program);
    std::size_t passed = 0, others = 0;
    for (const nlohmann::json& suite : results.at("testsuites"))
      for (const nlohmann::json& test : suite.at("testsuite"))
        ++(test.at("result") == "COMPLETED" && !test.contains("failures") ? passed : others);
    const std::string name = std::string{cases.program} + " " + filter;
    report.add_at_most(name + ", cases failed or skipped", {"test cases", passed + others}, "",
                       static_cast<double>(others), 0);
  }
  void measure(Measurement measurement, Report& report) const {
    in_own_thread([&] { measurement(settings_, report); });
  }
  /// Waits for the end of a program. Its exit status does not matter: a benchmark may fall short of other bounds.
  static void run(Arguments command, std::chrono::seconds limit) {
    e2e::Process process{std::move(command)};
    for (auto left = limit; !process.wait(1s); left -= 1s) {
      if (realtime::stop_signal()) throw std::runtime_error("interrupted");
      if (left <= 0s) throw std::runtime_error("a program has not ended in time:\n" + process.output());
    }
  }

  static constexpr std::chrono::seconds kMaxBenchmark{7200}, kMaxCases{3600};
  FaultSettings settings_;
  bool is_quick_;
  test_support::TemporaryFolder folder_;
  std::map<Arguments, nlohmann::json> results_;  // by command
};

Report run(const FaultSettings& settings, const Arguments& only, bool is_quick) {
  char text[120];
  std::snprintf(text, sizeof text, "%d rounds, %g s of random faults, seed %llu", settings.rounds, settings.seconds,
                static_cast<unsigned long long>(settings.seed));
  Report report{{"sessions of real programs", 0, 0, text}};
  Runner runner{settings, is_quick};
  for (const Fault& fault : faults()) {
    if (!only.empty() && std::find(only.begin(), only.end(), fault.name) == only.end()) continue;
    std::fprintf(stderr, "%s: %s\n", fault.name, fault.text);
    runner.add_rows(fault, report);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  using namespace tactus::bench;
  FaultSettings settings;
  std::vector<std::string> only, names;
  std::string list = "Causes the faults R1 to R26 and compares their effects with bounds; needs root:";
  for (const Fault& fault : faults()) {
    names.emplace_back(fault.name);
    list += std::string{"\n  "} + fault.name + "  " + fault.text;
  }
  App app{"faults", list, "3 rounds and 60 s of random faults, for CI"};
  app.add_option("--only", only, "run only this fault; repeatable")->check(CLI::IsMember(names));
  app.add_option("--rounds", settings.rounds, "rounds of the faults that are measured here")
      ->check(CLI::Range(1, 1000));
  app.add_option("--seconds", settings.seconds, "time of random faults, and of runs with loss, s")
      ->check(tactus::wire::finite_range(12.0, 1e5));
  app.add_option("--seed", settings.seed, "seed of random faults and packets");
  return latency_main(app, argc, argv, [&] {
    if (app.quick) settings.rounds = std::min(settings.rounds, 3);
    return run(settings, only, app.quick);
  });
}
