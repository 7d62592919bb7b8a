// T_R, T_B and T_Q of the cycle along a surface path, beside FCL on the finest and on the base mesh (the paper's
// Table 2), and the whole cycle of an HRTC with one tip and with two.
//
// Refined mesh: the pool holds a share of the model. Regions come through the codec as they would from a host, outside
// the timed part. FCL then gets the same poses. In exact cycles both must find the same triangles, so that fast and
// wrong fails.
//
// HRTC: the cores of host and HRTC in one thread. Timed is the haptic thread's part of a cycle: forces, selection of
// targets, refinement until the governor stops it, refit.
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
#include "hrtc_service/governor.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/triangle.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr std::uint32_t kContacts = 8192;
constexpr std::uint32_t kSmall = 100000;  // faces
constexpr std::uint32_t kHuge = 3000000;
constexpr double kTangent = 1e-6;  // m: nearer to tangency than this, rounding decides

struct Settings {
  std::string model;
  std::uint32_t faces = 70000;
  double seconds = 60;
  double radius = 0.003;  // m
  double speed = 0.05;    // m/s
  double depth = 0.0002;  // m
  double pool_share = 0.25;
  std::uint32_t budget = 1000;
  std::uint64_t seed = 1;
  std::uint32_t compare_every = 1;  // cycles
  bool curve = false, large = false;
  bool quick = false;
};

/// What one cycle found; its faces are `[first, first + count)` of Run::faces when it was exact.
struct Found {
  bool exact = false;
  std::size_t first = 0, count = 0;
};

struct Run {
  Samples refine, refit, query, sum;                                  // all cycles
  Samples changed_refine, changed_refit, changed_query, changed_sum;  // cycles with changes
  std::vector<Found> found;                                           // by pose
  std::vector<std::uint32_t> faces;
  std::uint64_t evictions = 0, splits = 0, collapses = 0, visits = 0;
  std::uint32_t settled = 0;  // cycles after the first regions had time to come
  std::uint32_t exact = 0;    // of these
  std::uint32_t truncated = 0;
  std::uint32_t late = 0;          // cycles of more than a period, of which at least half were this thread's computing
  std::vector<std::string> notes;  // on cycles of more than a period
  const char* priority = "";

  [[nodiscard]] double percent_exact() const { return 100.0 * exact / settled; }
};

/// Says of a cycle of more than a period what took the time.
void note_late(std::size_t cycle, const RefinedStep& step, double query, Run& run) {
  const ThreadUse after = thread_use();
  const double own = after.cpu_us - step.before.cpu_us;
  if (own > kPeriod * 1e6 / 2) ++run.late;
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
  std::vector<spm::Contact> contacts(kContacts);
  Run run;
  run.found.resize(path.size());
  bool in_contact = false;
  const Priority priority;
  run.priority = priority.text();
  for (std::size_t i = 0; i < path.size(); ++i) {
    const RefinedStep step = refined.step(path[i], in_contact);
    Stopwatch watch;
    const std::uint32_t count = forest.tree().touching(path[i], radius, contacts.data(), kContacts);
    const double query = watch.lap();

    const double sum = step.refine + step.refit + query;
    run.refine.add(step.refine);
    run.refit.add(step.refit);
    run.query.add(query);
    run.sum.add(sum);
    if (sum > kPeriod * 1e6) note_late(i, step, query, run);
    if (step.changes > 0) {
      run.changed_refine.add(step.refine);
      run.changed_refit.add(step.refit);
      run.changed_query.add(query);
      run.changed_sum.add(sum);
    }
    in_contact = count > 0;
    if (count > kContacts) ++run.truncated;
    if (!refined.settled()) continue;
    ++run.settled;
    if (!forest.exact(path[i], radius)) continue;
    Found& found = run.found[i];
    found.exact = true;
    found.first = run.faces.size();
    for (std::uint32_t c = 0; c < std::min(count, kContacts); ++c) {
      if (contacts[c].last()) run.faces.push_back(index(contacts[c].face));
    }
    found.count = run.faces.size() - found.first;
    std::sort(run.faces.begin() + static_cast<std::ptrdiff_t>(found.first), run.faces.end());
    ++run.exact;
  }
  run.evictions = refined.evictions();
  run.splits = forest.counters().splits;
  run.visits = forest.counters().visits;
  run.collapses = forest.counters().collapses;
  return run;
}

struct Comparison {
  Samples finest_query, base_query, finest_refit;
  std::uint64_t compared = 0, mismatches = 0, tangent = 0;
};

/// Faces that only one side has found and that are not within kTangent of touching.
std::uint64_t differences(const std::vector<std::uint32_t>& theirs, const std::uint32_t* ours, std::size_t count,
                          const LoadedModel& subject, const Vec3d& centre, double radius, double tangent,
                          std::uint64_t& excepted) {
  std::vector<std::uint32_t> odd;
  std::set_symmetric_difference(theirs.begin(), theirs.end(), ours, ours + count, std::back_inserter(odd));
  std::uint64_t wrong = 0;
  for (const std::uint32_t face : odd) {
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
                   double radius, double tangent, const Run& run, std::uint32_t every, int refits) {
  const std::vector<std::array<std::uint32_t, 3>> base_faces = spm::base_triangles(subject.model);
  const spm::fcl::FixedMesh base{subject.model.positions.subspan(0, subject.model.summary.base_vertices), base_faces};

  Comparison result;
  std::vector<std::uint32_t> touching;
  for (std::size_t i = 0; i < path.size(); i += every) {
    Stopwatch watch;
    finest.touching(path[i], radius, touching);
    result.finest_query.add(watch.lap());
    if (run.found[i].exact) {
      std::sort(touching.begin(), touching.end());
      ++result.compared;
      const std::uint64_t wrong = differences(touching, run.faces.data() + run.found[i].first, run.found[i].count,
                                              subject, path[i], radius, tangent, result.tangent);
      result.mismatches += wrong > 0 ? 1 : 0;
    }
    watch.lap();
    base.touching(path[i], radius, touching);
    result.base_query.add(watch.lap());
  }
  for (int i = 0; i < refits; ++i) {
    Stopwatch watch;
    finest.refit();
    result.finest_refit.add(watch.lap());
  }
  return result;
}

/// The cycle of an HRTC, with the governor at the deadline that is an HRTC's default.
struct HrtcRun {
  Samples own, wall;                     // us, all probes together
  std::uint64_t contact = 0, exact = 0;  // contact cycles, of all probes
};

HrtcRun run_hrtc(const LoadedModel& subject, const Settings& settings, const std::vector<std::vector<Vec3d>>& paths) {
  constexpr std::int64_t kDeadlineNs = 250'000;
  const spm::ModelSummary& summary = subject.model.summary;
  const double scale = summary.metres_per_unit;
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(summary, settings.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  SessionRun run{subject.model, scale, session};
  run.settle(spm::Vec3d{Eigen::Map<const spm::Vec3f>(summary.bounds_max.data()).cast<double>() * scale} +
             spm::Vec3d::Constant(3 * longest_side(summary)));
  hrtc_service::Governor governor{kDeadlineNs};
  HrtcRun outcome;
  const Priority priority;
  for (std::size_t i = 0; i + 1 < paths.front().size(); ++i) {
    const auto velocity = [&](std::size_t p) -> Vec3d { return (paths[p][i + 1] - paths[p][i]) * scale / kPeriod; };
    run.prepare(paths[0][i] * scale, velocity(0));
    if (paths.size() > 1) run.prepare_second(paths[1][i] * scale, velocity(1));
    const hrtc_service::RefineLimit limit = governor.limit();
    Stopwatch watch;
    const double before = thread_cpu_us();
    const hrtc_service::CycleResult& result = run.cycle(limit);
    const double own = thread_cpu_us() - before;
    const double wall = watch.lap();
    const hrtc_service::CycleCosts& costs = result.costs;
    if (costs.foreseen > 0)
      governor.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange, costs.refit,
                       costs.total(), costs.foreseen);
    outcome.own.add(own);
    outcome.wall.add(wall);
    for (std::size_t p = 0; p < paths.size(); ++p) {
      if ((result.probes[p].status & session::kInContact) == 0) continue;
      ++outcome.contact;
      outcome.exact += (result.probes[p].status & session::kExact) != 0 ? 1 : 0;
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
  outcome.theirs = run_fcl(subject, finest, path, settings.radius / unit, kTangent / unit, outcome.ours,
                           settings.compare_every, refits);
  return outcome;
}

/// One tip has the bounds of the dragon's cycle. Two tips have the need of the 1 kHz period: at p99.9 a tenth of it for
/// each tip, which leaves the rest for wake-up, devices and a slower processor (decision 37).
void report_hrtc(const LoadedModel& subject, const Settings& settings, Report& report) {
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  std::vector<std::vector<Vec3d>> paths{path_of(subject, settings, finest, settings.seed)};
  for (const char* tips : {"HRTC, one tip", "HRTC, two tips"}) {
    std::fprintf(stderr, "%s\n", tips);
    const HrtcRun run = run_hrtc(subject, settings, paths);
    if (paths.size() == 1)
      report.row("cycle, CPU time", tips, "us", run.own, {{0.5, 10}, {0.99, 60}, {0.999, 100}});
    else
      report.row("cycle, CPU time", tips, "us", run.own, {{0.999, 200}});
    report.row("cycle, wall", tips, "us", run.wall);
    report.at_least("exact", {std::string{tips} + ", contact cycles", run.contact}, "%",
                    100 * static_cast<double>(run.exact) / static_cast<double>(run.contact), 99);
    paths.push_back(path_of(subject, settings, finest, settings.seed + 1));
  }
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  // The paper's sizes stay 10 cm long; what is larger is generated as fine as a hand resolves.
  if (settings.model.empty() && settings.faces > kSmall) scale_to_edge(subject, kHandEdge);
  const spm::ModelSummary& summary = subject.model.summary;
  constexpr int kRefits = 21;
  const auto [ours, theirs, path_size] = measure(subject, settings, kRefits);

  char text[256];
  std::snprintf(
      text, sizeof text,
      "radius %g mm, %g cm/s, %g mm deep, %g s, pool %g of the model, budget %u, path seed %llu, %.3g m long, %s",
      settings.radius * 1e3, settings.speed * 1e2, settings.depth * 1e3, settings.seconds, settings.pool_share,
      settings.budget, static_cast<unsigned long long>(settings.seed), longest_side(summary), ours.priority);
  Report report{{subject.name, summary.digest, summary.faces, text}};
  const bool small = summary.faces <= kSmall, huge = summary.faces >= kHuge;
  const Population all{"all cycles", path_size}, compared{"cycles compared", theirs.compared};
  const Population changed{"cycles with changes", ours.changed_sum.size()}, settled{"after 0.2 s", ours.settled};
  report.row("T_R refine", all, "us", ours.refine);
  report.row("T_B refit", all, "us", ours.refit);
  report.row("T_Q query", all, "us", ours.query);
  if (small)
    report.row("T_R + T_B + T_Q", all, "us", ours.sum, {{0.5, 5}, {0.99, 60}});
  else if (!huge)
    report.row("T_R + T_B + T_Q", all, "us", ours.sum, {{0.5, 10}, {0.99, 60}, {0.999, 100}});
  else
    report.row("T_R + T_B + T_Q", all, "us", ours.sum, {{0.99, 100}, {0.999, 200}});
  report.row("T_R refine", changed, "us", ours.changed_refine);
  report.row("T_B refit", changed, "us", ours.changed_refit);
  report.row("T_Q query", changed, "us", ours.changed_query);
  report.row("T_R + T_B + T_Q", changed, "us", ours.changed_sum);
  report.row("FCL query, finest mesh", all, "us", theirs.finest_query);
  report.row("FCL query, base mesh", all, "us", theirs.base_query);
  report.row("FCL refit, finest mesh", "repeats", "us", theirs.finest_refit);
  const double changes = static_cast<double>(ours.splits + ours.collapses);
  const double cycles = static_cast<double>(path_size);
  report.figure("refining, mean of a change", all, "ns", 1e3 * ours.refine.mean() * cycles / changes);
  report.figure("refitting, mean of a change", all, "ns", 1e3 * ours.refit.mean() * cycles / changes);
  report.figure("list entries visited", all, "", static_cast<double>(ours.visits));
  report.figure("splits", all, "", static_cast<double>(ours.splits));
  report.figure("collapses", all, "", static_cast<double>(ours.collapses));
  report.figure("regions evicted", all, "", static_cast<double>(ours.evictions));
  report.figure("triangles excepted near tangency", compared, "", static_cast<double>(theirs.tangent));
  for (const std::string& note : ours.notes) report.note(note);
  report.figure("cycles over 1 ms on the wall", all, "", static_cast<double>(ours.notes.size()));

  report.at_most("cycles with other triangles than FCL", compared, "", static_cast<double>(theirs.mismatches), 0);
  report.at_most("queries truncated", all, "", ours.truncated, 0);
  report.at_least("exact", settled, "%", ours.percent_exact(), small ? 99 : 99.9);
  report.at_most("cycles over 1 ms of our own work", all, "", ours.late, 0);
  constexpr std::uint32_t kRefitSize = 60000;  // faces: below, a full refit is too short to compare with
  if (summary.faces >= kRefitSize) {
    report.at_least("median FCL full refit / median T_B", changed, "times",
                    theirs.finest_refit.percentile(0.5) / ours.changed_refit.percentile(0.5), 300);
  }
  report_hrtc(subject, settings, report);
  return report;
}

/// One point of a curve.
struct Size {
  std::string name;
  std::uint32_t faces = 0;
  std::uint64_t digest = 0;
  Outcome outcome;
};

/// The same tip on organs of one mean edge and of more and more faces. A cycle's median may grow as log n does. Small
/// models are bounded by 5 us and large ones by 10; from 10^4 to 2.8x10^7 faces that leaves so much for each decade.
constexpr double kGrowth = (10.0 - 5.0) / 3.45;  // us

Report run_curve(const Settings& settings) {
  std::vector<std::uint32_t> sizes{10000, 100000, 1000000};
  if (settings.large) sizes.insert(sizes.end(), {10000000, 28000000});
  char text[256];
  std::snprintf(
      text, sizeof text,
      "mean edge %g mm, radius %g mm, %g cm/s, %g mm deep, %g s, pool %g of the model, budget %u, path seed %llu",
      kHandEdge * 1e3, settings.radius * 1e3, settings.speed * 1e2, settings.depth * 1e3, settings.seconds,
      settings.pool_share, settings.budget, static_cast<unsigned long long>(settings.seed));
  std::vector<Size> curve;
  for (const std::uint32_t faces : sizes) {
    std::fprintf(stderr, "making an organ of %u faces\n", faces);
    LoadedModel subject = load_model("", faces);
    scale_to_edge(subject, kHandEdge);
    char name[64];
    std::snprintf(name, sizeof name, "%.2g faces, %.2g cm", static_cast<double>(faces),
                  100 * longest_side(subject.model.summary));
    curve.push_back({name, faces, subject.model.summary.digest, measure(subject, settings, 0)});
  }

  Report report{{"organs, seed 1", curve.back().digest, sizes.back(), text}};
  for (const Size& size : curve) report.row("T_R + T_B + T_Q", size.name, "us", size.outcome.ours.sum);
  for (const Size& size : curve) report.row("with changes", size.name, "us", size.outcome.ours.changed_sum);
  for (const Size& size : curve) report.row("T_Q query", size.name, "us", size.outcome.ours.query);
  for (const auto& [name, faces, digest, outcome] : curve) {
    const Run& ours = outcome.ours;
    const auto cycles = static_cast<double>(outcome.cycles),
               changes = static_cast<double>(ours.splits + ours.collapses);
    report.figure("changes a cycle, mean", name, "", changes / cycles);
    report.figure("refining, mean of a change", name, "ns", 1e3 * ours.refine.mean() * cycles / changes);
    report.figure("refitting, mean of a change", name, "ns", 1e3 * ours.refit.mean() * cycles / changes);
    report.figure("median / log2 faces", {name, ours.sum.size()}, "us", ours.sum.percentile(0.5) / std::log2(faces));
    for (const std::string& note : ours.notes) report.note(name + ", " + note);
  }
  const auto median = [&curve](std::size_t i) { return curve[i].outcome.ours.sum.percentile(0.5); };
  for (std::size_t i = 0; i < curve.size(); ++i) {
    const auto& [name, faces, digest, outcome] = curve[i];
    report.at_most("cycles with other triangles than FCL", {name, outcome.theirs.compared}, "",
                   static_cast<double>(outcome.theirs.mismatches), 0);
    report.at_least("exact", {name, outcome.ours.settled}, "%", outcome.ours.percent_exact(), 99.9);
    report.at_most("cycles over 1 ms of our own work", {name, outcome.cycles}, "", outcome.ours.late, 0);
    if (i < 1) continue;
    report.at_most("median, growth a decade since the smallest", {name, outcome.cycles}, "us",
                   (median(i) - median(0)) / std::log10(static_cast<double>(faces) / sizes[0]), kGrowth);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"cycle", "T_R, T_B and T_Q along a surface path, beside FCL on the finest and the base mesh",
                         "5 s, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 40000000u));
  app.add_option("--seconds", settings.seconds, "length of the path")->check(CLI::Range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "of the tip, m/s")->check(CLI::Range(0.001, 2.0));
  app.add_option("--pool-share", settings.pool_share, "pool, as a share of the model's records")
      ->check(CLI::Range(0.01, 1.0));
  app.add_option("--budget", settings.budget, "of a cycle, units of spm::Budget")->check(CLI::Range(100u, 1000000u));
  app.add_option("--seed", settings.seed, "of the path");
  app.add_option("--compare-every", settings.compare_every, "with FCL, so many cycles")->check(CLI::Range(1u, 1000u));
  CLI::Option* curve = app.add_flag("--curve", settings.curve, "organs of 10^4 to 10^6 faces of a mean edge of 0.2 mm");
  app.add_flag("--large", settings.large, "the curve to 2.8x10^7 faces")->needs(curve);
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return settings.curve ? tactus::bench::run_curve(settings) : tactus::bench::run(settings);
  });
}
