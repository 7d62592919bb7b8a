#include "bench/coded_rows.hpp"

#include <cstdio>

#include "bench/coded_link.hpp"
#include "bench/coded_run.hpp"
#include "bench/models.hpp"
#include "bench/movement.hpp"
#include "latency/cell.hpp"

namespace tactus::bench {
namespace {

constexpr std::uint32_t kFaces = 200'000;
constexpr double kLength = 0.2;  // m
constexpr std::uint32_t kSeed = 1;

States follow(double seconds) {
  const LoadedModel subject = load_model("", kFaces);
  const spm::ModelSummary& summary = subject.model.summary;
  return record(subject.model, kLength * summary.metres_per_unit / longest_side(summary), movements()[1], seconds,
                kSeed);
}

std::string titled(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

double rate(const std::vector<std::uint32_t>& sent, const States& states) {
  return 1e3 * static_cast<double>(sent.size()) / static_cast<double>(states.size());
}

}  // namespace

void add_coded_loss(Report& report, double percent, double seconds, std::uint64_t seed) {
  const States states = follow(seconds);
  session::CodingSettings coding;
  coding.loss = percent / 100;
  const std::vector<std::uint32_t> sent = encode(states, coding);
  const LinkRun run = send_deadband_coded(states, sent, "P0:loss=" + std::to_string(percent), 0, seed);
  const Fidelity received = play(states, sent, run.arrivals, {});
  const std::string name = titled("loss %g %%, coded: ", percent);
  report.figure(name + "packets", "probe states", "1/s", rate(sent, states));
  report.figure(name + "lost", "probe states", "%", run.lost);
  report.figure(name + "shown late by, p50", {"all ms", received.delay.size()}, "ms", received.delay.percentile(0.5));
  report.figure(name + "force error rms", "all ms", "JND", received.rms_jnd);
  report.figure(name + "force error above 1 JND", "all ms", "%", 100 * received.above_share);
  report.figure(name + "force error max", {"all ms", received.jnd.size()}, "JND", received.jnd.max());
  report.at_most(name + "force error p99", {"all ms", received.jnd.size()}, "JND", received.jnd.percentile(0.99), 1);
}

void add_coded_isolation(Report& report, double mbit, double seconds, double bound_ms) {
  const States states = follow(seconds);
  const std::vector<std::uint32_t> sent = encode(states, {});
  const LinkRun run = send_deadband_coded(states, sent, titled("veth:rate=%g", mbit), latency::kUnpaced);
  const Fidelity received = play(states, sent, run.arrivals, {});
  const std::string name = titled("%g Mbit/s, coded: ", mbit);
  report.figure(name + "packets", "probe states", "1/s", rate(sent, states));
  report.figure(name + "delivered", "probe states", "%", 100 - run.lost);
  report.figure(name + "mesh", "payload", "MB/s", run.mesh_mbyte);
  report.figure(name + "shown late by, p50", {"all ms", received.delay.size()}, "ms", received.delay.percentile(0.5));
  report.figure(name + "force error p99", {"all ms", received.jnd.size()}, "JND", received.jnd.percentile(0.99));
  report.row(name + "age", "one way, on arrival", "ms", run.age);
  report.at_most(name + "age p99", {"one way, on arrival", run.age.size()}, "ms", run.age.percentile(0.99), bound_ms);
}

}  // namespace tactus::bench
