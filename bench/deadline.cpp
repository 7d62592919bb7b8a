// Measures how many cycles end within a deadline of 50, 100 or 200 us. The cycle and the governor of an HRTC run along
// a surface path, while a second load on the machine is switched on and off. No setting changes with the deadline.
//
// The bound is on the cycle's own work, the CPU time of its thread, because the system interrupts a thread without
// real-time priority at any time. Wall time has rows without bounds. The first cycles, with cold caches, count.
#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <atomic>
#include <cstdio>
#include <thread>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hrtc_model.hpp"
#include "bench/models.hpp"
#include "bench/session_run.hpp"
#include "bench/stopwatch.hpp"
#include "bench/surface_path.hpp"
#include "hrtc_service/servo/governor.hpp"
#include "spm/fcl/fixed_mesh.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kPeriod = 0.001;                          // s
constexpr std::array<double, 3> kDeadlines{50, 100, 200};  // us

struct Settings {
  std::string model;
  std::uint32_t faces = 1'000'000;
  double seconds = 60;
  double radius = 0.003;  // m, of the tip
  double speed = 0.05;    // m/s, of the tip
  double depth = 0.0002;  // m, overlap of tip and surface
  double pool_share = 0.25;
  double load_seconds = 0.5;  // duration of the second load, and of each pause
  std::uint64_t seed = 1;
  bool quick = false;
};

/// A thread that, while switched on, writes to more memory than any CPU cache holds.
class SecondLoad {
 public:
  SecondLoad() : thread_{[this] { run(); }} {}
  ~SecondLoad() {
    is_ended_ = true;
    thread_.join();
  }
  void set(bool on) noexcept { is_on_.store(on, std::memory_order_relaxed); }

 private:
  void run() {
    constexpr std::size_t kBytes = 64u << 20, kCacheLine = 64;
    std::vector<std::uint8_t> memory(kBytes, 1);
    while (!is_ended_) {
      if (!is_on_.load(std::memory_order_relaxed)) {
        std::this_thread::sleep_for(std::chrono::milliseconds{1});  // uses no core, and switches on within a cycle
        continue;
      }
      for (std::size_t at = 0; at < kBytes; at += kCacheLine) ++memory[at];
    }
  }
  std::atomic<bool> is_on_{false}, is_ended_{false};
  std::thread thread_;
};

/// Computation without memory access. Only interrupts and other users of the core make a run longer than the shortest.
class ReferenceWork {
 public:
  ReferenceWork() {
    constexpr double kTargetTime = 20;  // us
    double min = 1e9;
    for (int i = 0; i < 100; ++i) min = std::min(min, run());
    steps_ = static_cast<std::uint32_t>(steps_ * kTargetTime / min);
  }
  /// Returns the CPU time of one run, us.
  double run() {
    const double before = thread_cpu_us();
    for (std::uint32_t i = 0; i < steps_; ++i) value_ = value_ * 3 + 1;
    return thread_cpu_us() - before;
  }

 private:
  volatile std::uint64_t value_ = 1;
  std::uint32_t steps_ = 10000;
};

struct Outcome {
  Samples reference, own, wall;                     // us; `own` is the CPU time of the cycle
  Samples own_alone, own_with_load;                 // us, without and with the second load
  Samples refine_refit, query, force;               // us
  Samples granted;                                  // units of spm::Budget
  Samples missed_query_force, missed_refine_refit;  // us, of cycles that missed the deadline
  std::uint64_t cycles = 0, contact_cycles = 0, exact_cycles = 0;
  std::uint64_t in_time = 0, reference_in_time = 0;  // cycles within the deadline
  std::uint64_t stopped = 0;                         // cycles whose refinement the governor stopped
  double refit_unit_ns = 0, excess_us = 0;           // final values of the governor
  // Normal equations of a least-squares fit: ns of refinement and refit, by list entries visited and records changed.
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();

  [[nodiscard]] double percent_in_time() const {
    return 100.0 * static_cast<double>(in_time) / static_cast<double>(cycles);
  }
  [[nodiscard]] double percent_exact() const {
    return contact_cycles == 0 ? 0 : 100.0 * static_cast<double>(exact_cycles) / static_cast<double>(contact_cycles);
  }
};

Outcome run_deadline(const spm::Model& model, const Settings& settings, const std::vector<Vec3d>& path, Vec3d away,
                     double deadline_us, SecondLoad& load) {
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(model.summary, settings.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  const double scale = model.summary.metres_per_unit;
  SessionRun run{model, scale, session};
  run.settle(away * scale);
  hrtc_service::Governor governor{static_cast<std::int64_t>(deadline_us * 1e3)};
  const auto load_cycles = static_cast<std::size_t>(settings.load_seconds / kPeriod);
  Outcome outcome;
  ReferenceWork reference;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const bool has_load = (i / load_cycles) % 2 == 1;
    load.set(has_load);
    const Vec3d tip = path[i] * scale;
    run.prepare(tip, i + 1 < path.size() ? Vec3d{(path[i + 1] - path[i]) * scale / kPeriod} : Vec3d{Vec3d::Zero()});
    const hrtc_service::RefineLimit limit = governor.limit();

    Stopwatch watch;
    const double cpu_before = thread_cpu_us();
    const hrtc_service::CycleResult& result = run.cycle(limit);
    const double own = thread_cpu_us() - cpu_before;
    const double wall = watch.lap();

    const hrtc_service::CycleCosts& costs = result.costs;
    const double own_ns = std::min(own * 1e3, static_cast<double>(costs.total()));
    if (costs.predicted_total > 0)
      governor.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange, costs.refit,
                       costs.total(), costs.predicted_total);
    const double reference_us = reference.run();
    outcome.reference.add(reference_us);
    if (reference_us < deadline_us) ++outcome.reference_in_time;
    outcome.own.add(own);
    outcome.wall.add(wall);
    (has_load ? outcome.own_with_load : outcome.own_alone).add(own);
    outcome.granted.add(costs.granted);
    outcome.refine_refit.add((costs.refine + costs.refit) * 1e-3);
    outcome.query.add(costs.query * 1e-3);
    outcome.force.add(costs.force * 1e-3);
    ++outcome.cycles;
    if (own < deadline_us) {
      ++outcome.in_time;
    } else {
      outcome.missed_query_force.add((costs.query + costs.force) * 1e-3);
      outcome.missed_refine_refit.add((costs.refine + costs.refit) * 1e-3);
    }
    if (result.budget_spent) ++outcome.stopped;
    if ((result.probes[0].status & session::kInContact) != 0) {
      ++outcome.contact_cycles;
      if ((result.probes[0].status & session::kExact) != 0) ++outcome.exact_cycles;
    }
    const Eigen::Vector3d row{1, double(costs.visits), double(costs.changes)};
    outcome.normal += row * row.transpose();
    outcome.right += row * std::min<double>(costs.refine + costs.refit, own_ns);
  }
  load.set(false);
  outcome.refit_unit_ns = governor.refit_ns_per_unit();
  outcome.excess_us = governor.excess_ns() * 1e-3;
  return outcome;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  if (settings.model.empty()) scale_to_edge(subject, kHandEdge);
  const spm::ModelSummary& summary = subject.model.summary;
  const double unit = summary.metres_per_unit;
  std::fprintf(stderr, "making the path\n");
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  const PathSettings path_settings{settings.radius / unit, settings.depth / unit, settings.speed * kPeriod / unit,
                                   static_cast<std::uint32_t>(settings.seconds / kPeriod), settings.seed};
  const std::vector<Vec3d> path = surface_path(subject.model.positions, subject.finest, path_settings,
                                               [&](const Vec3d& p) { return finest.distance(p); });
  const Vec3d away = Eigen::Map<const spm::Vec3f>(summary.bounds_max.data()).cast<double>() +
                     Vec3d::Constant(3 * model_length(summary) / unit);

  char text[256];
  std::snprintf(text, sizeof text,
                "radius %g mm, %g cm/s for %g s, pool %g of the model, second load %g s on and off, path seed %llu",
                settings.radius * 1e3, settings.speed * 1e2, settings.seconds, settings.pool_share,
                settings.load_seconds, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  SecondLoad load;
  for (const double deadline : kDeadlines) {
    std::fprintf(stderr, "deadline %g us\n", deadline);
    const Outcome outcome = run_deadline(subject.model, settings, path, away, deadline, load);
    char name[48];
    std::snprintf(name, sizeof name, "cycles, deadline %g us", deadline);
    const std::string cycles = name, missed = cycles + ", missed";
    report.add_percentiles("own work", cycles, "us", outcome.own);
    report.add_percentiles("own work without the second load", cycles, "us", outcome.own_alone);
    report.add_percentiles("own work with the second load", cycles, "us", outcome.own_with_load);
    report.add_percentiles("wall time", cycles, "us", outcome.wall);
    report.add_percentiles("T_R + T_B", cycles, "us", outcome.refine_refit);
    report.add_percentiles("T_Q", cycles, "us", outcome.query);
    report.add_percentiles("T_F", cycles, "us", outcome.force);
    if (outcome.missed_query_force.size() > 0) {
      report.add_percentiles("T_Q + T_F", missed, "us", outcome.missed_query_force);
      report.add_percentiles("T_R + T_B", missed, "us", outcome.missed_refine_refit);
    }
    report.add_percentiles("reference computation after each cycle", cycles, "us", outcome.reference);
    report.add_value("reference computation within the deadline", {cycles, outcome.cycles}, "%",
                     100.0 * static_cast<double>(outcome.reference_in_time) / static_cast<double>(outcome.cycles));
    report.add_percentiles("granted budget", cycles, "units", outcome.granted);
    report.add_value("refinement stopped by the governor", {cycles, outcome.cycles}, "%",
                     100.0 * static_cast<double>(outcome.stopped) / static_cast<double>(outcome.cycles));
    report.add_value("exact", {"contact " + cycles, outcome.contact_cycles}, "%", outcome.percent_exact());
    report.add_value("refit time of a unit, governor at the end", {cycles, outcome.cycles}, "ns",
                     outcome.refit_unit_ns);
    report.add_value("excess time of the governor, at the end", {cycles, outcome.cycles}, "us", outcome.excess_us);
    const Eigen::Vector3d fit = outcome.normal.ldlt().solve(outcome.right);
    report.add_value("T_R + T_B, fit: constant", {cycles, outcome.cycles}, "ns", fit[0]);
    report.add_value("T_R + T_B, fit: a list entry visited", {cycles, outcome.cycles}, "ns", fit[1]);
    report.add_value("T_R + T_B, fit: a record changed", {cycles, outcome.cycles}, "ns", fit[2]);
    report.add_at_least("own work within the deadline", {cycles, outcome.cycles}, "%", outcome.percent_in_time(), 99.9);
    report.add_at_least("in contact", {cycles, outcome.cycles}, "%",
                        100.0 * static_cast<double>(outcome.contact_cycles) / static_cast<double>(outcome.cycles), 90);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"deadline",
                         "Cycles whose own work meets a deadline of 50, 100 or 200 us, with and without a second load",
                         "5 s, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--seconds", settings.seconds, "duration of the path, s")
      ->check(tactus::wire::finite_range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "speed of the tip, m/s")->check(tactus::wire::finite_range(0.001, 2.0));
  app.add_option("--pool-share", settings.pool_share, "size of the pool, as a share of the model's records")
      ->check(tactus::wire::finite_range(0.01, 1.0));
  app.add_option("--seed", settings.seed, "seed of the path");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return tactus::bench::run(settings);
  });
}
