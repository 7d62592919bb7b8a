// Measures the time from the publishing of an emergency stop at one machine to zero force at an HRTC on the other side
// of the link.
//
//     namespace a: operator, host    ----- link ----->    namespace b: HRTC, whose user rests on an object
//
// A sample begins just before the operator's first write of the stop. It ends at the beginning of the first cycle of
// the haptic thread in which the force is zero because of a stop. Both times are of CLOCK_MONOTONIC, which the
// namespaces share. The times and forces of the cycles come from the flight recording of the HRTC.
//
// So a sample contains the write, the link, the receiving thread of the gateway, and up to 1 ms until the next cycle
// begins. It contains neither the part of this cycle before the force is written to the device
// (docs/explanation/cycle.md), nor a driver. The operator repeats the stop every 20 ms until host and HRTC have
// acknowledged it. The host receives the stop too, and forwards it in its roster entry. The HRTC obeys the sample that
// arrives first.
//
// Conditions:
//   - the idle LAN;
//   - mesh fills the LAN: a second pair of host and HRTC, in a session of their own, sends records in the direction of
//     the stops as fast as the pacer permits (latency/load.hpp);
//   - the gateway decodes a base mesh: a second host of the session offers large base meshes, one after another
//     (bench/base_mesh_host.hpp). Only during a decode does the service thread of the gateway work so long without
//     waiting. So a stop counts only if this thread is busy before it and for 3 ms after it, and in total at least 0.9
//     times as long as the fastest decode in this process (bench/busy_thread.hpp);
//   - a link that loses 10 % of the frames in each direction.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "bench/base_mesh_host.hpp"
#include "bench/busy_thread.hpp"
#include "bench/figures.hpp"
#include "bench/in_namespace.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "bench/stop_issuer.hpp"
#include "bench/touched_session.hpp"
#include "latency/load.hpp"
#include "realtime/realtime.hpp"
#include "session/units.hpp"
#include "spm/codec/base_codec.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "trace/flight_file.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::Side;
using realtime::monotonic_ns;

struct Settings {
  std::string link = "veth:rate=100";  // the LAN
  int stops = 300;                     // that count, for each condition
  std::uint64_t seed = 1;
};

constexpr char kLossyLink[] = "P0:loss=10";
// Bounds of the p99 of the time from publishing to zero force, ms.
constexpr double kLanBound = 3, kLossBound = 60;
constexpr double kMinForce = 0.05;     // N, in the cycle before a stop that counts
constexpr double kMinMeshRate = 10.5;  // MB/s, on a link of 100 Mbit/s that is full
constexpr double kMinLossPercent = 7;  // of the frames, with kLossyLink
constexpr int kFlightFiles = 20;       // hrtc_service::FlightSaver::kMaxFiles

/// A stop that was published, and the end of the time in which the force has to be zero at last.
struct Stop {
  std::int64_t published_ns = 0;
  std::int64_t end_ns = 0;  // just before its reset
  bool was_repeated = false;
};

// ---- cycles of the HRTC

struct ServoCycle {
  std::int64_t time_ns = 0;  // beginning
  double force = 0;          // N
  bool is_stopped = false;   // the force is off because of an emergency stop
  bool is_reset = false;     // a reset has ended the faults at the beginning of this cycle
};

struct Recording {
  std::vector<ServoCycle> cycles;
  std::size_t missing = 0;  // cycles between the first and the last that are not recorded
};

/// Throws trace::FlightError.
Recording read_recording(const std::string& file) {
  std::map<std::uint64_t, ServoCycle> by_number;
  trace::FlightFileReader reader{file};
  for (trace::FlightMessage message; reader.next(message);) {
    if (const auto* touch = std::get_if<trace::FlightTouch>(&message)) by_number[touch->cycle].time_ns = touch->time_ns;
    if (const auto* event = std::get_if<trace::FlightEvent>(&message);
        event != nullptr && event->kind == trace::FlightEvent::Kind::kReset)
      by_number[event->cycle].is_reset = true;
    const auto* probe = std::get_if<trace::FlightProbe>(&message);
    if (probe == nullptr || probe->probe != 0) continue;
    ServoCycle& cycle = by_number[probe->cycle];
    cycle.force = std::hypot(probe->force[0], probe->force[1], probe->force[2]);
    cycle.is_stopped = std::string_view{session::fault_reason(probe->status)} == "emergency stop";
  }
  std::erase_if(by_number, [](const auto& cycle) { return cycle.second.time_ns == 0; });
  Recording recording;
  for (const auto& [number, cycle] : by_number) recording.cycles.push_back(cycle);
  if (!by_number.empty())
    recording.missing = by_number.rbegin()->first - by_number.begin()->first + 1 - by_number.size();
  return recording;
}

/// Figures of the stops of one condition.
struct StopFigures {
  Samples ms;                         // from publishing to zero force; kUnfinished if the force was on until the reset
  std::size_t without_force = 0;      // stops that do not count, because there was no force in the cycle before
  std::size_t stopped_cycles = 0;     // from the first cycle with zero force to the reset
  std::size_t cycles_with_force = 0;  // of these
  std::size_t repeated = 0;           // stops that were published more than once

  void add(const std::vector<ServoCycle>& cycles, const Stop& stop) {
    auto cycle = std::upper_bound(cycles.begin(), cycles.end(), stop.published_ns,
                                  [](std::int64_t time_ns, const ServoCycle& each) { return time_ns < each.time_ns; });
    if (cycle == cycles.begin() || std::prev(cycle)->force < kMinForce) {
      ++without_force;
      return;
    }
    repeated += stop.was_repeated ? 1 : 0;
    const auto is_over = [&] { return cycle == cycles.end() || cycle->time_ns >= stop.end_ns; };
    while (!is_over() && !(cycle->force == 0 && cycle->is_stopped)) ++cycle;
    ms.add(is_over() ? kUnfinished : static_cast<double>(cycle->time_ns - stop.published_ns) * 1e-6);
    for (; cycle != cycles.end() && !cycle->is_reset; ++cycle) {
      ++stopped_cycles;
      cycles_with_force += cycle->force == 0 ? 0 : 1;
    }
  }
};

// ---- the session

/// A host, an HRTC with one user who rests on an object, and an operator on the other side of the link.
class StoppedSession {
 public:
  StoppedSession(const std::string& link, std::uint64_t seed) : random_{seed}, touched_{20'000, link} {
    touched_.start_host(Side::kA);
    hrtc_ = touched_.start_hrtc(
        Side::kB, kHrtc, {"ann"},
        {"--users", "1", "--pool", std::to_string(kPool), "--flight-recorder", "3600", "--flight-file",
         touched_.path("flight.mcap"), "--flight-folder", touched_.path("flights")});
    touched_.wait_for_touch("ann");
    operator_ = make<StopIssuer>(Side::kA, address("operator"), std::vector<std::string>{kHrtc, "museum"});
    operator_->wait_for_receivers();
    use_up_flight_files();
  }

  /// Waits until there is a force, calls `wait_for_moment`, publishes a stop, and resets it when it is acknowledged.
  Stop stop_once(const std::function<void()>& wait_for_moment) {
    LiveSession& session = touched_.session();
    session.forget_states();
    session.wait_until("a force", [](const ObservedSession& observed) {
      if (observed.states.empty()) return false;
      const std::array<double, 3>& force = observed.states.back().force;
      return std::hypot(force[0], force[1], force[2]) > kMinForce;
    });
    wait_for_moment();
    Stop stop;
    stop.published_ns = operator_->stop();
    stop.was_repeated = operator_->was_repeated();
    stop.end_ns = monotonic_ns();
    operator_->reset();
    return stop;
  }
  /// Waits for a random time, so that a stop arrives at any time of a cycle and of the period of the roster entries.
  void wait_at_random() {
    std::uniform_int_distribution<std::int64_t> wait_ns{0, 100 * kMs};
    realtime::sleep_until(monotonic_ns() + wait_ns(random_));
  }

  /// Ends the HRTC, and returns its cycles.
  Recording recording() {
    hrtc_->signal(SIGTERM);
    if (hrtc_->wait(60s) != 0) throw std::runtime_error{"the HRTC failed:\n" + hrtc_->output()};
    return read_recording(touched_.path("flight.mcap"));
  }

  template <class T, class... Arguments>
  [[nodiscard]] std::unique_ptr<T> make(Side side, Arguments&&... arguments) {
    return make_in_namespace<T>(touched_.session().pair(), side, std::forward<Arguments>(arguments)...);
  }
  [[nodiscard]] wire::SessionAddress address(const std::string& participant) {
    return touched_.session().address(participant);
  }
  /// Returns the process id of the HRTC's gateway.
  [[nodiscard]] pid_t gateway() const {
    const pid_t gateway = hrtc_->child("tactus-gateway");
    if (gateway == 0) throw std::runtime_error{"no gateway runs:\n" + hrtc_->output()};
    return gateway;
  }
  [[nodiscard]] netem::RelayFigures link_figures() { return touched_.session().pair().figures(); }
  [[nodiscard]] const std::string& priority_note() const { return operator_->priority_note(); }

  static constexpr char kHrtc[] = "desk";
  /// Slots of the HRTC. The touched object has some 10,000 vertices.
  static constexpr std::uint32_t kPool = 16'384;

 private:
  /// Half a second after a stop, the HRTC writes a file, until it has written kFlightFiles. These stops are not
  /// measured, because the next stop would arrive while it writes.
  void use_up_flight_files() {
    for (int i = 0; i < kFlightFiles + 2; ++i) {
      std::fprintf(stderr, "\rstop %d of %d before the measurement ", i + 1, kFlightFiles + 2);
      (void)stop_once([] {});
      pause(700ms);
    }
    std::fprintf(stderr, "\n");
  }

  std::mt19937_64 random_;
  TouchedSession touched_;
  std::unique_ptr<e2e::Process> hrtc_;
  std::unique_ptr<StopIssuer> operator_;
};

/// Some stops can turn out not to count, so there are a tenth more.
int attempts(const Settings& settings) { return settings.stops + settings.stops / 10; }

std::vector<Stop> stop_at_random(StoppedSession& session, const Settings& settings, const char* condition) {
  std::vector<Stop> stops;
  for (int i = 0; i < attempts(settings); ++i) {
    std::fprintf(stderr, "\r%s: stop %d of %d ", condition, i + 1, attempts(settings));
    stops.push_back(session.stop_once([&] { session.wait_at_random(); }));
  }
  std::fprintf(stderr, "\n");
  return stops;
}

// ---- a link that mesh fills

struct MeshLoad {
  std::vector<Stop> stops;
  double mbyte_per_s = 0;
};

MeshLoad stop_with_mesh(StoppedSession& session, const Settings& settings) {
  wire::SessionAddress address = session.address("source");
  address.session += ".load";
  latency::TestCase load;
  load.load_mbit = latency::kUnpaced;
  const auto sink = session.make<latency::MeshSink>(Side::kB, load, address);
  const auto source = session.make<latency::MeshSource>(Side::kA, load, address);
  for (int i = 0; i < 2000 && !source->matched(); ++i) pause(10ms);
  if (!source->matched()) throw std::runtime_error{"source and sink of the mesh have not discovered each other"};
  source->start();
  pause(2s);
  MeshLoad result;
  const std::uint64_t before = sink->bytes();
  const std::int64_t began_ns = monotonic_ns();
  result.stops = stop_at_random(session, settings, "mesh");
  result.mbyte_per_s =
      static_cast<double>(sink->bytes() - before) * 1e3 / static_cast<double>(monotonic_ns() - began_ns);
  return result;
}

// ---- a gateway that decodes a base mesh

/// A model whose base mesh does not fit into the pool of the HRTC.
class LargeBase {
 public:
  LargeBase() {
    spm::offline::BuildOptions options;
    options.simplify.base_faces = kBaseFaces;
    const spm::offline::BuiltModel built =
        spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kOrgan, kFaces), options);
    model_.emplace(built.model());
    const spm::ModelSummary& summary = model().summary();
    if (summary.base_vertices <= StoppedSession::kPool)
      throw std::runtime_error{"the base mesh has " + std::to_string(summary.base_vertices) +
                               " vertices, expected more than the pool of the HRTC has slots"};
  }
  [[nodiscard]] const spm::codec::CompressedModel& model() const { return model_->compressed(); }
  /// Returns the min time of ten decodes in this process, ns.
  [[nodiscard]] std::int64_t min_decode_ns() const {
    std::int64_t min_ns = INT64_MAX;
    for (int i = 0; i < 10; ++i) {
      const std::int64_t began_ns = monotonic_ns();
      if (!spm::codec::decode_base(model().spans().base)) throw std::runtime_error{"the base mesh cannot be decoded"};
      min_ns = std::min(min_ns, monotonic_ns() - began_ns);
    }
    return min_ns;
  }

 private:
  static constexpr std::uint32_t kFaces = 550'000, kBaseFaces = 500'000;
  std::optional<spm::codec::EncodedModel> model_;
};

struct DecodeLoad {
  std::vector<Stop> stops;  // during a decode
  std::size_t published = 0;
  double decode_ms = 0;
  std::uint32_t base_faces = 0;
};

/// Lets the HRTC decode one base mesh after another, and finds times at which a decode runs.
class Decodes {
 public:
  Decodes(BaseMeshHost& host, pid_t gateway, std::int64_t min_decode_ns, std::uint64_t seed)
      : host_{host}, gateway_{gateway}, min_decode_ns_{min_decode_ns}, random_{seed} {}

  /// Offers a base mesh, and waits for a random time in the first part of its decode.
  void begin() {
    gateway_.forget();
    host_.offer();
    wait_for("the transfer of a base mesh", [this] { return host_.sent_ns() != 0; });
    wait_for("the decode of a base mesh", [this] {
      const auto busy = gateway_.now();
      const bool has_begun = busy && busy->end_ns - std::max(busy->begin_ns, host_.sent_ns()) >= kBusyBeforeNs;
      return has_begun || host_.decoded_ns() != 0;  // the stop does not count if the decode was not found
    });
    std::uniform_int_distribution<std::int64_t> wait_ns{0, min_decode_ns_ / 3};
    realtime::sleep_until(monotonic_ns() + wait_ns(random_));
  }
  /// Waits for the end of the decode.
  void end() {
    wait_for("the end of the decode of a base mesh", [this] { return host_.decoded_ns() != 0; });
    host_.withdraw();  // otherwise the HRTC would try again when it forgets another object
  }
  /// Whether the decode that has ended ran at this time and for the next 3 ms.
  [[nodiscard]] bool ran_at(std::int64_t time_ns) const {
    const auto busy = gateway_.at(time_ns);
    if (!busy) return false;
    constexpr double kShare = 0.9;  // the samples do not find the beginning and the end of the decode
    const auto busy_ns = static_cast<double>(busy->end_ns - busy->begin_ns);
    return busy_ns >= kShare * static_cast<double>(min_decode_ns_) && busy->end_ns >= time_ns + kBusyAfterNs &&
           time_ns > host_.sent_ns();
  }

 private:
  static constexpr std::int64_t kBusyBeforeNs = 2 * kMs;
  static constexpr std::int64_t kBusyAfterNs = 3 * kMs;  // kLanBound

  template <class Condition>
  static void wait_for(const char* what, const Condition& condition) {
    const std::int64_t end_ns = monotonic_ns() + 10'000 * kMs;
    while (!condition()) {
      if (realtime::stop_signal() || monotonic_ns() > end_ns)
        throw std::runtime_error{std::string{"timed out while waiting for "} + what};
      realtime::sleep_until(monotonic_ns() + 200 * kUs);
    }
  }

  BaseMeshHost& host_;
  BusyThread gateway_;
  std::int64_t min_decode_ns_;
  std::mt19937_64 random_;
};

DecodeLoad stop_during_decodes(StoppedSession& session, const LargeBase& base, const Settings& settings) {
  DecodeLoad result;
  const std::int64_t min_decode_ns = base.min_decode_ns();
  result.decode_ms = static_cast<double>(min_decode_ns) * 1e-6;
  result.base_faces = base.model().summary().base_faces;
  const auto host =
      session.make<BaseMeshHost>(Side::kA, session.address("depot"), std::string{StoppedSession::kHrtc}, base.model());
  for (int i = 0; i < 2000 && !host->matched(); ++i) pause(10ms);
  if (!host->matched()) throw std::runtime_error{"the HRTC has not discovered the host of the base meshes"};
  pause(1s);  // until the HRTC has a roster entry of the host
  Decodes decodes{*host, session.gateway(), min_decode_ns, settings.seed};
  const auto wanted = static_cast<std::size_t>(attempts(settings));
  while (result.stops.size() < wanted && result.published < 2 * wanted) {
    std::fprintf(stderr, "\rdecode: stop %zu of %zu ", result.stops.size() + 1, wanted);
    const Stop stop = session.stop_once([&] { decodes.begin(); });
    decodes.end();
    ++result.published;
    if (decodes.ran_at(stop.published_ns)) result.stops.push_back(stop);
  }
  std::fprintf(stderr, "\n");
  return result;
}

// ---- report

void add_rows(Report& report, const std::string& condition, const Recording& recording, const std::vector<Stop>& stops,
              double bound_ms, const Settings& settings) {
  StopFigures figures;
  for (const Stop& stop : stops) figures.add(recording.cycles, stop);
  report.set_prefix(condition + ": ");
  report.add_percentiles("time from publishing to zero force", "stops", "ms", figures.ms, {{0.99, bound_ms}});
  report.add_at_least("stops that count", {"stops published", stops.size()}, "", static_cast<double>(figures.ms.size()),
                      settings.stops);
  report.add_value("stops without a force before them", {"stops published", stops.size()}, "",
                   static_cast<double>(figures.without_force));
  report.add_value("stops that were published again", {"stops", figures.ms.size()}, "",
                   static_cast<double>(figures.repeated));
  report.add_at_most("cycles with a force between zero force and the reset", {"cycles", figures.stopped_cycles}, "",
                     static_cast<double>(figures.cycles_with_force), 0);
}

void add_missing(Report& report, const std::string& link, const Recording& recording, const std::string& note) {
  report.set_prefix(link + ": ");
  report.add_at_most("cycles that are not recorded", {"cycles", recording.cycles.size()}, "",
                     static_cast<double>(recording.missing), 0);
  report.add_note(link + ": " + note);
}

void measure_lan(const Settings& settings, Report& report) {
  std::fprintf(stderr, "making a model with a large base mesh\n");
  const LargeBase base;
  StoppedSession session{settings.link, settings.seed};
  const std::vector<Stop> idle = stop_at_random(session, settings, "idle");
  const MeshLoad mesh = stop_with_mesh(session, settings);
  const DecodeLoad decode = stop_during_decodes(session, base, settings);
  const Recording recording = session.recording();
  add_rows(report, "idle LAN", recording, idle, kLanBound, settings);
  const std::string with_mesh = "mesh fills the LAN";
  add_rows(report, with_mesh, recording, mesh.stops, kLanBound, settings);
  report.add_at_least("mesh payload rate", {"run", 1}, "MB/s", mesh.mbyte_per_s, kMinMeshRate);
  add_rows(report, "the gateway decodes a base mesh", recording, decode.stops, kLanBound, settings);
  report.add_value("stops during a decode, share of all", {"stops published", decode.published}, "%",
                   100 * static_cast<double>(decode.stops.size()) / static_cast<double>(decode.published));
  report.add_value("min time of a decode in the benchmark", {"decodes", 10}, "ms", decode.decode_ms);
  report.add_value("faces of the base mesh", {"model", 1}, "", decode.base_faces);
  add_missing(report, "LAN", recording, session.priority_note());
}

void measure_loss(const Settings& settings, Report& report) {
  StoppedSession session{kLossyLink, settings.seed};
  const std::vector<Stop> stops = stop_at_random(session, settings, "loss");
  const netem::RelayFigures link = session.link_figures();
  const Recording recording = session.recording();
  add_rows(report, "10 % loss", recording, stops, kLossBound, settings);
  const netem::LinkCounts& to_hrtc = link.a_to_b;
  report.add_at_least("frames to the HRTC that are lost (check of the link)", {"frames", to_hrtc.arrived}, "%",
                      100 * static_cast<double>(to_hrtc.lost) / static_cast<double>(to_hrtc.arrived), kMinLossPercent);
  add_missing(report, "link with 10 % loss", recording, session.priority_note());
}

Report run(const Settings& settings) {
  char text[200];
  std::snprintf(
      text, sizeof text,
      "LAN: %s, loss: %s; at least %d stops that count, for each condition; a replayed user at rest, seed %llu",
      settings.link.c_str(), kLossyLink, settings.stops, static_cast<unsigned long long>(settings.seed));
  Report report{{"an operator and a host, and an HRTC on the other side of the link", 0, 0, text}};
  in_own_thread([&] { measure_lan(settings, report); });
  in_own_thread([&] { measure_loss(settings, report); });
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"stop",
                         "Time from the publishing of an emergency stop to zero force: LAN idle, filled with mesh, and "
                         "during decodes of a base mesh; 10 % loss; needs root",
                         "100 stops for each condition, for CI"};
  app.add_option("--stops", settings.stops, "stops that count, for each condition")->check(CLI::Range(100, 10'000));
  app.add_option("--link", settings.link, "the LAN, as in `tactus-link list`");
  app.add_option("--seed", settings.seed, "seed of the times of the stops");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.stops = 100;
    return tactus::bench::run(settings);
  });
}
