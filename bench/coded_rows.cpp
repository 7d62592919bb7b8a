#include "bench/coded_rows.hpp"

#include <cstdio>

#include "bench/coded_link.hpp"
#include "bench/coded_run.hpp"
#include "bench/models.hpp"
#include "bench/movement.hpp"
#include "latency/test_case.hpp"

namespace tactus::bench {
namespace {

constexpr std::uint32_t kFaces = 200'000;
constexpr double kLength = 0.2;  // m, of the model
constexpr std::uint32_t kSeed = 1;

/// Probe states of a hand that follows the surface of an organ at 5 cm/s.
States follow(double seconds) {
  const LoadedModel subject = load_model("", kFaces);
  const spm::ModelSummary& summary = subject.model.summary;
  return simulate(subject.model, kLength * summary.metres_per_unit / model_length(summary), movements()[1], seconds,
                  kSeed);
}

std::string formatted(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

double packets_per_s(const std::vector<std::uint32_t>& sent, const States& states) {
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
  const std::string name = formatted("loss %g %%, deadband-coded: ", percent);
  report.add_value(name + "packets sent", {"states, one each ms", states.size()}, "1/s", packets_per_s(sent, states));
  report.add_value(name + "lost", {"packets sent", sent.size()}, "%", run.lost_percent);
  report.add_value(name + "playout delay, p50", {"views, one each ms", received.delay.size()}, "ms",
                   received.delay.percentile(0.5));
  report.add_value(name + "force error rms", {"views, one each ms", received.jnd.size()}, "JND", received.rms_jnd);
  report.add_value(name + "force error above 1 JND", {"views, one each ms", received.jnd.size()}, "%",
                   100 * received.above_share);
  report.add_value(name + "force error max", {"views, one each ms", received.jnd.size()}, "JND", received.jnd.max());
  report.add_at_most(name + "force error p99", {"views, one each ms", received.jnd.size()}, "JND",
                     received.jnd.percentile(0.99), 1);
}

void add_coded_isolation(Report& report, double mbit, double seconds, double bound_ms) {
  const States states = follow(seconds);
  const std::vector<std::uint32_t> sent = encode(states, {});
  const LinkRun run = send_deadband_coded(states, sent, formatted("veth:rate=%g", mbit), latency::kUnpaced);
  const Fidelity received = play(states, sent, run.arrivals, {});
  const std::string name = formatted("%g Mbit/s, deadband-coded: ", mbit);
  report.add_value(name + "packets sent", {"states, one each ms", states.size()}, "1/s", packets_per_s(sent, states));
  report.add_value(name + "delivered", {"packets sent", sent.size()}, "%", 100 - run.lost_percent);
  // States and headers need the rest of the link.
  report.add_at_least(name + "mesh payload rate", {"run", 1}, "MB/s", run.mesh_mbyte_per_s, 0.4 * mbit / 8);
  report.add_value(name + "playout delay, p50", {"views, one each ms", received.delay.size()}, "ms",
                   received.delay.percentile(0.5));
  report.add_value(name + "force error p99", {"views, one each ms", received.jnd.size()}, "JND",
                   received.jnd.percentile(0.99));
  report.add_percentiles(name + "age at arrival", "packets received", "ms", run.age);
  report.add_at_most(name + "age at arrival p99", {"packets received", run.age.size()}, "ms", run.age.percentile(0.99),
                     bound_ms);
}

}  // namespace tactus::bench
