// Measures T_R, T_B and T_Q of the cycle along a surface path, compared with FCL on the finest mesh and on the base
// mesh (the paper's Table 2), and the whole cycle of an HRTC with one tip and with two tips.
//
// Refined mesh: the pool has slots for a share of the model. Regions arrive through the codec as from a host, which is
// not timed. FCL then gets the same poses. In exact cycles both must find the same triangles; this detects a fast but
// wrong query.
//
// HRTC: the cores of host and HRTC run in one thread. The time is that of the haptic thread in a cycle: forces,
// selection of targets, refinement until the governor stops it, refit.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hrtc_model.hpp"
#include "bench/models.hpp"
#include "bench/priority.hpp"
#include "bench/refined_run.hpp"
#include "bench/session_run.hpp"
#include "bench/stopwatch.hpp"
#include "bench/surface_path.hpp"
#include "hrtc_service/servo/governor.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/triangle.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr std::uint32_t kMaxContacts = 8192;
constexpr std::uint32_t kSmallModel = 100000;  // faces; max size with the bounds of small models
constexpr std::uint32_t kHugeModel = 3000000;  // faces; min size with the bounds of huge models
constexpr double kTangentTolerance = 1e-6;     // m; rounding decides about triangles this close to tangency

struct Settings {
  std::string model;
  std::uint32_t faces = 70000;
  double seconds = 60;
  double radius = 0.003;  // m, of the tip
  double speed = 0.05;    // m/s, of the tip
  double depth = 0.0002;  // m, overlap of tip and surface
  double pool_share = 0.25;
  std::uint32_t budget = 1000;  // of a cycle, units of spm::Budget
  std::uint64_t seed = 1;
  std::uint32_t compare_every = 1;  // cycles between comparisons with FCL
  bool curve = false, large = false;
  bool quick = false;
};

/// Faces that one cycle touched: `[first, first + count)` of Run::faces. Empty if the cycle was not exact.
struct TouchedFaces {
  bool is_exact = false;
  std::size_t first = 0, count = 0;
};

struct Run {
  Samples refine, refit, query, sum;                                  // us, all cycles
  Samples changed_refine, changed_refit, changed_query, changed_sum;  // us, cycles with changes
  std::vector<TouchedFaces> touched;                                  // by pose
  std::vector<std::uint32_t> faces;                                   // sorted within each cycle
  std::uint64_t evictions = 0, splits = 0, collapses = 0, visits = 0;
  std::uint32_t settled_cycles = 0;  // cycles after the first regions had time to arrive
  std::uint32_t exact_cycles = 0;    // of the settled ones
  std::uint32_t truncated_cycles = 0;
  std::uint32_t overruns = 0;      // cycles longer than a period in which the thread computed for over half a period
  std::vector<std::string> notes;  // on cycles of more than a period
  const char* priority = "";

  [[nodiscard]] double percent_exact() const { return 100.0 * exact_cycles / settled_cycles; }
};

/// Notes where the time went in a cycle that took more than a period.
void note_long_cycle(std::size_t cycle, const RefinedStep& step, double query, Run& run) {
  const ThreadUse after = thread_use();
  const double own = after.cpu_us - step.before.cpu_us;
  if (own > kPeriod * 1e6 / 2) ++run.overruns;
  char text[256];
  std::snprintf(
      text, sizeof text,
      "cycle %zu: T_R %.0f, T_B %.0f, T_Q %.0f us for %llu list entries and %llu changes, %.0f us computed, %ld "
      "page faults, preempted %ld times",
      cycle, step.refine, step.refit, query, static_cast<unsigned long long>(step.visits),
      static_cast<unsigned long long>(step.changes), own, after.faults - step.before.faults,
      after.preemptions - step.before.preemptions);
  run.notes.emplace_back(text);
}

Run run_cycles(const spm::Model& model, const Settings& settings, double unit, const std::vector<Vec3d>& path) {
  const double radius = settings.radius / unit;
  RefinedRun refined{model, spm::ProbeShape{radius}, {settings.speed / unit, settings.pool_share, settings.budget}};
  const spm::Forest& forest = refined.forest();
  std::vector<spm::Contact> contacts(kMaxContacts);
  Run run;
  run.touched.resize(path.size());
  bool in_contact = false;
  const Priority priority;
  run.priority = priority.text();
  for (std::size_t i = 0; i < path.size(); ++i) {
    const RefinedStep step = refined.step(path[i], in_contact);
    Stopwatch stopwatch;
    const std::uint32_t count = forest.tree().find_contacts(path[i], radius, contacts.data(), kMaxContacts);
    const double query = stopwatch.lap();

    const double sum = step.refine + step.refit + query;
    run.refine.add(step.refine);
    run.refit.add(step.refit);
    run.query.add(query);
    run.sum.add(sum);
    if (sum > kPeriod * 1e6) note_long_cycle(i, step, query, run);
    if (step.changes > 0) {
      run.changed_refine.add(step.refine);
      run.changed_refit.add(step.refit);
      run.changed_query.add(query);
      run.changed_sum.add(sum);
    }
    in_contact = count > 0;
    if (count > kMaxContacts) ++run.truncated_cycles;
    if (!refined.settled()) continue;
    ++run.settled_cycles;
    if (!forest.is_exact(path[i], radius)) continue;
    TouchedFaces& touched = run.touched[i];
    touched.is_exact = true;
    touched.first = run.faces.size();
    for (std::uint32_t c = 0; c < std::min(count, kMaxContacts); ++c) {
      if (contacts[c].is_finest()) run.faces.push_back(index(contacts[c].face));
    }
    touched.count = run.faces.size() - touched.first;
    std::sort(run.faces.begin() + static_cast<std::ptrdiff_t>(touched.first), run.faces.end());
    ++run.exact_cycles;
  }
  run.evictions = refined.evictions();
  run.splits = forest.counters().splits;
  run.visits = forest.counters().visits;
  run.collapses = forest.counters().collapses;
  return run;
}

struct Comparison {
  Samples finest_query, base_query, finest_refit;     // us, of FCL
  std::uint64_t compared_cycles = 0, mismatches = 0;  // cycles
  std::uint64_t tangent_faces = 0;                    // differences that rounding explains
};

/// Returns the number of faces that only one of `theirs` and `ours` contains. Faces within `tangent` of tangency count
/// in `excepted` instead.
std::uint64_t differences(const std::vector<std::uint32_t>& theirs, const std::uint32_t* ours, std::size_t count,
                          const LoadedModel& subject, const Vec3d& centre, double radius, double tangent,
                          std::uint64_t& excepted) {
  std::vector<std::uint32_t> unmatched;
  std::set_symmetric_difference(theirs.begin(), theirs.end(), ours, ours + count, std::back_inserter(unmatched));
  std::uint64_t wrong = 0;
  for (const std::uint32_t face : unmatched) {
    const auto corner = [&](std::size_t i) {
      const std::array<float, 3>& p = subject.model.positions[subject.finest[face][i]];
      return Vec3d{p[0], p[1], p[2]};
    };
    const double distance = std::sqrt(spm::closest_point(centre, corner(0), corner(1), corner(2)).squared_distance);
    ++(std::abs(distance - radius) < tangent ? excepted : wrong);
  }
  return wrong;
}

Comparison run_fcl(const LoadedModel& subject, spm::fcl::FixedMesh& finest, const std::vector<Vec3d>& path,
                   double radius, double tangent, const Run& run, std::uint32_t compare_every, int refits) {
  const std::vector<std::array<std::uint32_t, 3>> base_faces = spm::base_triangles(subject.model);
  const spm::fcl::FixedMesh base{subject.model.positions.subspan(0, subject.model.summary.base_vertices), base_faces};

  Comparison result;
  std::vector<std::uint32_t> touching;
  for (std::size_t i = 0; i < path.size(); i += compare_every) {
    Stopwatch stopwatch;
    finest.find_touched_faces(path[i], radius, touching);
    result.finest_query.add(stopwatch.lap());
    if (run.touched[i].is_exact) {
      std::sort(touching.begin(), touching.end());
      ++result.compared_cycles;
      const std::uint64_t wrong = differences(touching, run.faces.data() + run.touched[i].first, run.touched[i].count,
                                              subject, path[i], radius, tangent, result.tangent_faces);
      result.mismatches += wrong > 0 ? 1 : 0;
    }
    stopwatch.lap();
    base.find_touched_faces(path[i], radius, touching);
    result.base_query.add(stopwatch.lap());
  }
  for (int i = 0; i < refits; ++i) {
    Stopwatch stopwatch;
    finest.refit();
    result.finest_refit.add(stopwatch.lap());
  }
  return result;
}

struct HrtcRun {
  Samples cpu, wall;                                   // us, of a cycle with all probes
  std::uint64_t contact_cycles = 0, exact_cycles = 0;  // sum over all probes
};

/// Runs the cycle of an HRTC with the governor at the default deadline of an HRTC. `paths`: one for each probe.
HrtcRun run_hrtc(const LoadedModel& subject, const Settings& settings, const std::vector<std::vector<Vec3d>>& paths) {
  constexpr std::int64_t kDeadlineNs = 250'000;
  const spm::ModelSummary& summary = subject.model.summary;
  const double scale = summary.metres_per_unit;
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(summary, settings.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  SessionRun run{subject.model, scale, session};
  run.settle(spm::Vec3d{Eigen::Map<const spm::Vec3f>(summary.bounds_max.data()).cast<double>() * scale} +
             spm::Vec3d::Constant(3 * model_length(summary)));
  hrtc_service::Governor governor{kDeadlineNs};
  HrtcRun outcome;
  const Priority priority;
  for (std::size_t i = 0; i + 1 < paths.front().size(); ++i) {
    const auto velocity = [&](std::size_t p) -> Vec3d { return (paths[p][i + 1] - paths[p][i]) * scale / kPeriod; };
    run.prepare(paths[0][i] * scale, velocity(0));
    if (paths.size() > 1) run.prepare_second(paths[1][i] * scale, velocity(1));
    const hrtc_service::RefineLimit limit = governor.limit();
    Stopwatch stopwatch;
    const double before = thread_cpu_us();
    const hrtc_service::CycleResult& result = run.cycle(limit);
    const double cpu = thread_cpu_us() - before;
    const double wall = stopwatch.lap();
    const hrtc_service::CycleCosts& costs = result.costs;
    if (costs.predicted_total > 0)
      governor.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange, costs.refit,
                       costs.total(), costs.predicted_total);
    outcome.cpu.add(cpu);
    outcome.wall.add(wall);
    for (std::size_t p = 0; p < paths.size(); ++p) {
      if ((result.probes[p].status & session::kInContact) == 0) continue;
      ++outcome.contact_cycles;
      outcome.exact_cycles += (result.probes[p].status & session::kExact) != 0 ? 1 : 0;
    }
  }
  return outcome;
}

struct Outcome {
  Run ours;
  Comparison theirs;
  std::size_t cycles = 0;
};

std::vector<Vec3d> path_of(const LoadedModel& subject, const Settings& settings, const spm::fcl::FixedMesh& finest,
                           std::uint64_t seed) {
  const double unit = subject.model.summary.metres_per_unit;
  const PathSettings path{settings.radius / unit, settings.depth / unit, settings.speed * kPeriod / unit,
                          static_cast<std::uint32_t>(settings.seconds / kPeriod), seed};
  return surface_path(subject.model.positions, subject.finest, path,
                      [&](const Vec3d& p) { return finest.distance(p); });
}

Outcome measure(const LoadedModel& subject, const Settings& settings, int refits) {
  const double unit = subject.model.summary.metres_per_unit;
  std::fprintf(stderr, "making the path\n");
  spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  const std::vector<Vec3d> path = path_of(subject, settings, finest, settings.seed);

  std::fprintf(stderr, "%zu cycles\n", path.size());
  Outcome outcome{run_cycles(subject.model, settings, unit, path), {}, path.size()};
  std::fprintf(stderr, "FCL on the same poses\n");
  outcome.theirs = run_fcl(subject, finest, path, settings.radius / unit, kTangentTolerance / unit, outcome.ours,
                           settings.compare_every, refits);
  return outcome;
}

/// Adds the rows of an HRTC. One tip has the bounds of T_R + T_B + T_Q on a medium model. The bound of two tips is
/// 200 us at p99.9, a tenth of the period of 1 ms for each tip. The rest of the period is for wake-up, devices and a
/// slower processor (decision 37).
void report_hrtc(const LoadedModel& subject, const Settings& settings, Report& report) {
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  std::vector<std::vector<Vec3d>> paths{path_of(subject, settings, finest, settings.seed)};
  for (const char* tips : {"HRTC, one tip", "HRTC, two tips"}) {
    std::fprintf(stderr, "%s\n", tips);
    const HrtcRun run = run_hrtc(subject, settings, paths);
    if (paths.size() == 1)
      report.add_percentiles("cycle, CPU time", tips, "us", run.cpu, {{0.5, 10}, {0.99, 60}, {0.999, 100}});
    else
      report.add_percentiles("cycle, CPU time", tips, "us", run.cpu, {{0.999, 200}});
    report.add_percentiles("cycle, wall time", tips, "us", run.wall);
    report.add_at_least("exact, of contact cycles", {tips, run.contact_cycles}, "%",
                        100 * static_cast<double>(run.exact_cycles) / static_cast<double>(run.contact_cycles), 99);
    paths.push_back(path_of(subject, settings, finest, settings.seed + 1));
  }
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  // Models of the paper's sizes stay 10 cm long. Larger organs get edges as fine as a hand resolves.
  if (settings.model.empty() && settings.faces > kSmallModel) scale_to_edge(subject, kHandEdge);
  const spm::ModelSummary& summary = subject.model.summary;
  constexpr int kRefits = 21;
  const auto [ours, theirs, path_size] = measure(subject, settings, kRefits);

  char text[256];
  std::snprintf(
      text, sizeof text,
      "radius %g mm, %g cm/s, %g mm deep, %g s, pool %g of the model, budget %u, path seed %llu, %.3g m long, %s",
      settings.radius * 1e3, settings.speed * 1e2, settings.depth * 1e3, settings.seconds, settings.pool_share,
      settings.budget, static_cast<unsigned long long>(settings.seed), model_length(summary), ours.priority);
  Report report{{subject.name, summary.digest, summary.faces, text}};
  const bool is_small = summary.faces <= kSmallModel, is_huge = summary.faces >= kHugeModel;
  const Population all{"all cycles", path_size}, compared{"cycles compared", theirs.compared_cycles};
  const Population changed{"cycles with changes", ours.changed_sum.size()},
      settled{"cycles after 0.2 s", ours.settled_cycles};
  report.add_percentiles("T_R refine", all.name, "us", ours.refine);
  report.add_percentiles("T_B refit", all.name, "us", ours.refit);
  report.add_percentiles("T_Q query", all.name, "us", ours.query);
  if (is_small)
    report.add_percentiles("T_R + T_B + T_Q", all.name, "us", ours.sum, {{0.5, 5}, {0.99, 60}});
  else if (!is_huge)
    report.add_percentiles("T_R + T_B + T_Q", all.name, "us", ours.sum, {{0.5, 10}, {0.99, 60}, {0.999, 100}});
  else
    report.add_percentiles("T_R + T_B + T_Q", all.name, "us", ours.sum, {{0.99, 100}, {0.999, 200}});
  report.add_percentiles("T_R refine", changed.name, "us", ours.changed_refine);
  report.add_percentiles("T_B refit", changed.name, "us", ours.changed_refit);
  report.add_percentiles("T_Q query", changed.name, "us", ours.changed_query);
  report.add_percentiles("T_R + T_B + T_Q", changed.name, "us", ours.changed_sum);
  report.add_percentiles("FCL query, finest mesh", all.name, "us", theirs.finest_query);
  report.add_percentiles("FCL query, base mesh", all.name, "us", theirs.base_query);
  report.add_percentiles("FCL refit, finest mesh", "repeats", "us", theirs.finest_refit);
  const double changes = static_cast<double>(ours.splits + ours.collapses);
  const double cycles = static_cast<double>(path_size);
  report.add_value("T_R of a change, mean", all, "ns", 1e3 * ours.refine.mean() * cycles / changes);
  report.add_value("T_B of a change, mean", all, "ns", 1e3 * ours.refit.mean() * cycles / changes);
  report.add_value("list entries visited", all, "", static_cast<double>(ours.visits));
  report.add_value("splits", all, "", static_cast<double>(ours.splits));
  report.add_value("collapses", all, "", static_cast<double>(ours.collapses));
  report.add_value("regions evicted", all, "", static_cast<double>(ours.evictions));
  report.add_value("triangles excepted, near tangency", compared, "", static_cast<double>(theirs.tangent_faces));
  for (const std::string& note : ours.notes) report.add_note(note);
  report.add_value("cycles of more than 1 ms wall time", all, "", static_cast<double>(ours.notes.size()));

  report.add_at_most("cycles whose triangles differ from FCL's", compared, "", static_cast<double>(theirs.mismatches),
                     0);
  report.add_at_most("truncated queries", all, "", ours.truncated_cycles, 0);
  report.add_at_least("exact", settled, "%", ours.percent_exact(), is_small ? 99 : 99.9);
  report.add_at_most("overruns: over 1 ms wall, over 0.5 ms CPU time", all, "", ours.overruns, 0);
  constexpr std::uint32_t kRefitSize = 60000;  // faces; a full refit of a smaller mesh is too short for a ratio
  if (summary.faces >= kRefitSize) {
    report.add_at_least("median FCL refit / median T_B", changed, "times",
                        theirs.finest_refit.percentile(0.5) / ours.changed_refit.percentile(0.5), 300);
  }
  report_hrtc(subject, settings, report);
  return report;
}

/// One point of the curve over model sizes.
struct CurvePoint {
  std::string name;
  std::uint32_t faces = 0;
  std::uint64_t digest = 0;
  Outcome outcome;
};

/// Max growth of the median cycle for each decade of faces, us. The median should grow as log n does. It may be
/// 5 us at 10^4 faces and 10 us at 2.8x10^7 faces, and 3.45 decades lie between these sizes.
constexpr double kMaxGrowth = (10.0 - 5.0) / 3.45;

/// Measures organs of the same mean edge and of increasing size.
Report run_curve(const Settings& settings) {
  std::vector<std::uint32_t> sizes{10000, 100000, 1000000};
  if (settings.large) sizes.insert(sizes.end(), {10000000, 28000000});
  char text[256];
  std::snprintf(
      text, sizeof text,
      "mean edge %g mm, radius %g mm, %g cm/s, %g mm deep, %g s, pool %g of the model, budget %u, path seed %llu",
      kHandEdge * 1e3, settings.radius * 1e3, settings.speed * 1e2, settings.depth * 1e3, settings.seconds,
      settings.pool_share, settings.budget, static_cast<unsigned long long>(settings.seed));
  std::vector<CurvePoint> curve;
  for (const std::uint32_t faces : sizes) {
    std::fprintf(stderr, "making an organ of %u faces\n", faces);
    LoadedModel subject = load_model("", faces);
    scale_to_edge(subject, kHandEdge);
    char name[64];
    std::snprintf(name, sizeof name, "cycles, %.2g faces, %.2g cm", static_cast<double>(faces),
                  100 * model_length(subject.model.summary));
    curve.push_back({name, faces, subject.model.summary.digest, measure(subject, settings, 0)});
  }

  Report report{{"organs, seed 1", curve.back().digest, sizes.back(), text}};
  for (const CurvePoint& point : curve)
    report.add_percentiles("T_R + T_B + T_Q", point.name, "us", point.outcome.ours.sum);
  for (const CurvePoint& point : curve)
    report.add_percentiles("T_R + T_B + T_Q", point.name + ", changes", "us", point.outcome.ours.changed_sum);
  for (const CurvePoint& point : curve) report.add_percentiles("T_Q query", point.name, "us", point.outcome.ours.query);
  for (const auto& [name, faces, digest, outcome] : curve) {
    const Run& ours = outcome.ours;
    const auto cycles = static_cast<double>(outcome.cycles),
               changes = static_cast<double>(ours.splits + ours.collapses);
    report.add_value("changes in a cycle, mean", {name, outcome.cycles}, "", changes / cycles);
    report.add_value("T_R of a change, mean", {name, outcome.cycles}, "ns",
                     1e3 * ours.refine.mean() * cycles / changes);
    report.add_value("T_B of a change, mean", {name, outcome.cycles}, "ns", 1e3 * ours.refit.mean() * cycles / changes);
    report.add_value("median T_R + T_B + T_Q / log2 of faces", {name, ours.sum.size()}, "us",
                     ours.sum.percentile(0.5) / std::log2(faces));
    for (const std::string& note : ours.notes) report.add_note(name + ", " + note);
  }
  const auto median = [&curve](std::size_t i) { return curve[i].outcome.ours.sum.percentile(0.5); };
  for (std::size_t i = 0; i < curve.size(); ++i) {
    const auto& [name, faces, digest, outcome] = curve[i];
    report.add_at_most("cycles whose triangles differ from FCL's", {name, outcome.theirs.compared_cycles}, "",
                       static_cast<double>(outcome.theirs.mismatches), 0);
    report.add_at_least("exact", {name, outcome.ours.settled_cycles}, "%", outcome.ours.percent_exact(), 99.9);
    report.add_at_most("overruns: over 1 ms wall, over 0.5 ms CPU time", {name, outcome.cycles}, "",
                       outcome.ours.overruns, 0);
    if (i < 1) continue;
    report.add_at_most("growth of the median since the smallest size", {name, outcome.cycles}, "us/decade",
                       (median(i) - median(0)) / std::log10(static_cast<double>(faces) / sizes[0]), kMaxGrowth);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"cycle",
                         "T_R, T_B and T_Q along a surface path, compared with FCL on the finest and the base mesh",
                         "5 s, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 40000000u));
  app.add_option("--seconds", settings.seconds, "duration of the path, s")
      ->check(tactus::wire::finite_range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "speed of the tip, m/s")->check(tactus::wire::finite_range(0.001, 2.0));
  app.add_option("--pool-share", settings.pool_share, "size of the pool, as a share of the model's records")
      ->check(tactus::wire::finite_range(0.01, 1.0));
  app.add_option("--budget", settings.budget, "budget of a cycle, units of spm::Budget")
      ->check(CLI::Range(100u, 1000000u));
  app.add_option("--seed", settings.seed, "seed of the path");
  app.add_option("--compare-every", settings.compare_every, "compare with FCL in one of so many cycles")
      ->check(CLI::Range(1u, 1000u));
  CLI::Option* curve =
      app.add_flag("--curve", settings.curve, "measure organs of 10^4 to 10^6 faces with a mean edge of 0.2 mm");
  app.add_flag("--large", settings.large, "extend the curve to 2.8x10^7 faces")->needs(curve);
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return settings.curve ? tactus::bench::run_curve(settings) : tactus::bench::run(settings);
  });
}
