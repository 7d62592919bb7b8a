#include "bench/figures.hpp"

#include <sys/utsname.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>

#include "tactus/commit.hpp"

namespace tactus::bench {

namespace {

struct Machine {
  std::string processor, kernel;
  unsigned processors;
};

Machine machine() {
  Machine found{"unknown", "unknown", std::thread::hardware_concurrency()};
  std::ifstream info{"/proc/cpuinfo"};
  for (std::string line; std::getline(info, line);) {
    if (line.rfind("model name", 0) != 0) continue;
    if (const std::size_t colon = line.find(": "); colon != std::string::npos) found.processor = line.substr(colon + 2);
    break;
  }
  if (utsname names{}; uname(&names) == 0) found.kernel = std::string{names.sysname} + " " + names.release;
  return found;
}

std::string hex(std::uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

const char* text_of(Verdict verdict) noexcept {
  switch (verdict) {
    case Verdict::kHolds:
      return "holds";
    case Verdict::kFallsShort:
      return "falls short";
    case Verdict::kNoBound:
      break;
  }
  return "no bound";
}

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

std::string bound_of(const Row& row) {
  if (row.limit == Limit::kNone) return "";
  return (row.limit == Limit::kAtMost ? "<= " : ">= ") + number(row.bound);
}

std::string value_of(const Row& row) {
  if (row.population.n == 0) return "no samples";
  if (row.value == kUnfinished) return "not finished";
  return number(row.value) + (row.unit.empty() ? "" : " " + row.unit);
}

std::string today() {
  char text[16];
  const std::time_t now = std::time(nullptr);
  std::strftime(text, sizeof text, "%Y-%m-%d", std::gmtime(&now));
  return text;
}

}  // namespace

Verdict Row::verdict() const noexcept {
  if (limit == Limit::kNone) return Verdict::kNoBound;
  const bool holds = limit == Limit::kAtMost ? value <= bound : value >= bound;
  return holds && population.n > 0 && std::isfinite(value) ? Verdict::kHolds : Verdict::kFallsShort;
}

void Report::add_percentiles(const std::string& figure, const std::string& population, const std::string& unit,
                             const Samples& samples, std::initializer_list<PercentileBound> bounds) {
  std::map<double, const PercentileBound*> shares{{0.5, nullptr}, {1, nullptr}};
  for (const double share : {0.99, 0.999})
    if (static_cast<double>(samples.size()) * (1 - share) > 0.999) shares.emplace(share, nullptr);
  for (const PercentileBound& bound : bounds) shares[bound.share] = &bound;
  for (const auto& [share, bound] : shares) {
    const std::string name = prefix_ + figure + (share == 1 ? ", max" : ", p" + number(100 * share));
    rows_.push_back({name, {population, samples.size()}, samples.percentile(share), unit});
    rows_.back().virtual_time = virtual_time_;
    if (bound == nullptr) continue;
    rows_.back().limit = Limit::kAtMost;
    rows_.back().bound = bound->at_most;
  }
}

void Report::add_value(const std::string& figure, const Population& population, const std::string& unit, double value) {
  rows_.push_back({prefix_ + figure, population, value, unit, Limit::kNone, 0, virtual_time_});
}

void Report::add_at_most(const std::string& figure, const Population& population, const std::string& unit, double value,
                         double bound) {
  rows_.push_back({prefix_ + figure, population, value, unit, Limit::kAtMost, bound, virtual_time_});
}

void Report::add_at_least(const std::string& figure, const Population& population, const std::string& unit,
                          double value, double bound) {
  rows_.push_back({prefix_ + figure, population, value, unit, Limit::kAtLeast, bound, virtual_time_});
}

int Report::finish(const std::string& bench, const std::string& command, const std::string& json) const {
  print(bench, command);
  if (!json.empty()) write(bench, command, json);
  const auto falls_short = [](const Row& row) { return row.verdict() == Verdict::kFallsShort; };
  return !rows_.empty() && std::none_of(rows_.begin(), rows_.end(), falls_short) ? 0 : 1;
}

void Report::print(const std::string& bench, const std::string& command) const {
  const Machine computer = machine();
  std::printf("%s: %s", bench.c_str(), subject_.model.c_str());
  if (subject_.faces > 0) std::printf(", %u faces, digest %s", subject_.faces, hex(subject_.digest).c_str());
  std::printf("\n%s\n%s\n", command.c_str(), subject_.settings.c_str());
  std::printf("%u x %s, %s; %s, %s, commit %s\n\n", computer.processors, computer.processor.c_str(),
              computer.kernel.c_str(), TACTUS_BUILD_TYPE, TACTUS_COMPILER, TACTUS_COMMIT);
  std::printf("%-52s %-28s %9s %-18s %-12s %s\n", "figure", "population", "n", "value", "bound", "verdict");
  for (const Row& row : rows_) {
    std::printf("%-52s %-28s %9zu %-18s %-12s %s%s\n", row.figure.c_str(), row.population.name.c_str(),
                row.population.n, value_of(row).c_str(), bound_of(row).c_str(), text_of(row.verdict()),
                row.virtual_time ? ", virtual time" : "");
  }
  if (!notes_.empty()) std::printf("\n");
  for (const std::string& note : notes_) std::printf("%s\n", note.c_str());
}

void Report::write(const std::string& bench, const std::string& command, const std::string& json) const {
  const Machine computer = machine();
  nlohmann::ordered_json out;
  out["bench"] = bench;
  out["command"] = command;
  out["date"] = today();
  out["model"] = {{"name", subject_.model}, {"faces", subject_.faces}, {"digest", hex(subject_.digest)}};
  out["settings"] = subject_.settings;
  out["machine"] = {
      {"processor", computer.processor}, {"processors", computer.processors}, {"kernel", computer.kernel}};
  out["build"] = {{"type", TACTUS_BUILD_TYPE}, {"compiler", TACTUS_COMPILER}, {"commit", TACTUS_COMMIT}};
  out["notes"] = notes_;
  out["rows"] = nlohmann::ordered_json::array();
  for (const Row& row : rows_) {
    out["rows"].push_back({{"bench", bench},
                           {"command", command},
                           {"figure", row.figure},
                           {"population", row.population.name},
                           {"n", row.population.n},
                           {"bound", bound_of(row)},
                           {"value", row.value},  // becomes null if the value is not finite
                           {"unit", row.unit},
                           {"text", value_of(row)},
                           {"verdict", text_of(row.verdict())},
                           {"virtual_time", row.virtual_time}});
  }
  std::ofstream file{json};
  file << out.dump(2) << '\n';
  file.close();
  if (!file) throw std::runtime_error("cannot write '" + json + "'");
}

}  // namespace tactus::bench
