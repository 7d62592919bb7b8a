#include "bench/figures.hpp"

#include <sys/utsname.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
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

}  // namespace

double Samples::percentile(double percent) const {
  if (values_.empty()) return 0;
  if (!sorted_) {
    std::sort(values_.begin(), values_.end());
    sorted_ = true;
  }
  constexpr double kTolerance = 1e-6;  // 99.9 % of 1000 is 999, not a little more
  const double rank = std::ceil(percent * static_cast<double>(values_.size()) / 100 - kTolerance);
  const auto at = static_cast<std::size_t>(std::clamp(rank, 1.0, static_cast<double>(values_.size())));
  return values_[at - 1];
}

double Samples::mean() const noexcept {
  double sum = 0;
  for (const double v : values_) sum += v;
  return values_.empty() ? 0 : sum / static_cast<double>(values_.size());
}

void Report::row(const std::string& name, const std::string& population, const std::string& unit,
                 const Samples& samples) {
  rows_.push_back({name, population, unit, samples.size(), samples.percentile(50), samples.percentile(99),
                   samples.percentile(99.9), samples.max()});
}

void Report::figure(const std::string& name, const std::string& population, const std::string& unit, double value) {
  figures_.push_back({name, population, unit, value});
}

void Report::at_most(const std::string& what, const std::string& population, const std::string& unit, double value,
                     double limit) {
  bounds_.push_back({what, population, unit, value, limit, true});
}

void Report::at_least(const std::string& what, const std::string& population, const std::string& unit, double value,
                      double limit) {
  bounds_.push_back({what, population, unit, value, limit, false});
}

int Report::finish(const std::string& json) const {
  print();
  if (!json.empty()) write(json);
  return std::all_of(bounds_.begin(), bounds_.end(), [](const Bound& b) { return b.holds(); }) ? 0 : 1;
}

void Report::print() const {
  const Machine on = machine();
  std::printf("%s: %s", subject_.benchmark.c_str(), subject_.model.c_str());
  if (subject_.faces > 0) std::printf(", %u faces, digest %s", subject_.faces, hex(subject_.digest).c_str());
  std::printf("\n");
  std::printf("%s\n%u x %s, %s; %s, %s, commit %s\n\n", subject_.settings.c_str(), on.processors, on.processor.c_str(),
              on.kernel.c_str(), TACTUS_BUILD_TYPE, TACTUS_COMPILER, TACTUS_COMMIT);
  if (!rows_.empty()) {
    std::printf("%-34s %-22s %4s %8s %10s %10s %10s %10s\n", "", "population", "unit", "n", "p50", "p99", "p99.9",
                "max");
    for (const Row& r : rows_) {
      std::printf("%-34s %-22s %4s %8zu %10.3f %10.3f %10.3f %10.3f\n", r.name.c_str(), r.population.c_str(),
                  r.unit.c_str(), r.count, r.p50, r.p99, r.p999, r.max);
    }
    std::printf("\n");
  }
  for (const Figure& f : figures_) {
    std::printf("%-34s %-22s %.6g %s\n", f.name.c_str(), f.population.c_str(), f.value, f.unit.c_str());
  }
  if (!figures_.empty()) std::printf("\n");
  for (const std::string& note : notes_) std::printf("%s\n", note.c_str());
  if (!notes_.empty()) std::printf("\n");
  for (const Bound& b : bounds_) {
    std::printf("%-5s %s, %s: %.6g %s, bound %s %.6g\n", b.holds() ? "holds" : "SHORT", b.what.c_str(),
                b.population.c_str(), b.value, b.unit.c_str(), b.upper ? "<=" : ">=", b.limit);
  }
}

void Report::write(const std::string& json) const {
  const Machine on = machine();
  nlohmann::ordered_json out;
  out["benchmark"] = subject_.benchmark;
  out["model"] = {{"name", subject_.model}, {"faces", subject_.faces}, {"digest", hex(subject_.digest)}};
  out["settings"] = subject_.settings;
  out["machine"] = {{"processor", on.processor}, {"processors", on.processors}, {"kernel", on.kernel}};
  out["build"] = {{"type", TACTUS_BUILD_TYPE}, {"compiler", TACTUS_COMPILER}, {"commit", TACTUS_COMMIT}};
  out["rows"] = nlohmann::ordered_json::array();
  for (const Row& r : rows_) {
    out["rows"].push_back({{"name", r.name},
                           {"population", r.population},
                           {"unit", r.unit},
                           {"n", r.count},
                           {"p50", r.p50},
                           {"p99", r.p99},
                           {"p99.9", r.p999},
                           {"max", r.max}});
  }
  out["figures"] = nlohmann::ordered_json::array();
  for (const Figure& f : figures_) {
    out["figures"].push_back({{"name", f.name}, {"population", f.population}, {"unit", f.unit}, {"value", f.value}});
  }
  out["notes"] = notes_;
  out["bounds"] = nlohmann::ordered_json::array();
  for (const Bound& b : bounds_) {
    out["bounds"].push_back({{"what", b.what},
                             {"population", b.population},
                             {"unit", b.unit},
                             {"value", b.value},
                             {b.upper ? "at_most" : "at_least", b.limit},
                             {"holds", b.holds()}});
  }
  std::ofstream file{json};
  file << out.dump(2) << '\n';
  file.close();
  if (!file) throw std::runtime_error("cannot write '" + json + "'");
}

}  // namespace tactus::bench
