// Simulates a hand that strokes a model of ten million faces at 0.5 m/s over a network. Checks that nearly all
// contacts are exact, and that no error exceeds its published bound, which is 0 for exact contacts.
//
// Compares each contact cycle with a fixed tree of the finest mesh. Brute force checks this tree.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hand_motion.hpp"
#include "bench/remote_session.hpp"
#include "spm/triangle.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kRoundingTolerance = 1e-9;  // m

struct Settings {
  std::string model, strategy = "mixture";
  std::uint32_t faces = 10000000, cycles = 1000000, brute_force_cycles = 10000;
  double speed = 0.5, rate_mbit = 100, pool_mib = 16;
  double credit_kib = 0;  // 0: the default of an HRTC
  std::vector<double> round_trips_ms{0.5, 100};
  std::uint64_t seed = 1;
  bool quick = false;
};

/// Results at one round trip.
struct Outcome {
  std::uint64_t contact_cycles = 0, exact_cycles = 0;
  std::uint64_t over_bound = 0;  // number of contact cycles with an error over the published bound
  Samples bounds_mm, errors_mm;  // of inexact contact cycles
  // Numbers of inexact contact cycles by cause: a region near the tip is not predicted, predicted but not loaded, or
  // loaded but not refined.
  std::uint64_t not_predicted = 0, not_loaded = 0, not_refined = 0;
  RemoteSession::Traffic traffic;
  hrtc_service::LoaderFigures loader;
  std::uint64_t budget_spent = 0, nodes_full = 0;
};

/// Returns the distance from the tip's centre to the active mesh, m. If `exact`, only faces of the finest mesh count.
double shown_distance(const RemoteSession& session, const Vec3d& tip, bool exact) {
  const Vec3d centre = session.to_model(tip);
  if (!exact) {
    spm::NearestFace found;
    return session.forest().tree().nearest(centre, 1e12, found) ? std::sqrt(found.squared_distance) * session.scale()
                                                                : 1e300;
  }
  std::array<spm::Contact, 2048> contacts;
  const double radius = kTipRadius / session.scale();
  const std::uint32_t count =
      std::min<std::uint32_t>(session.forest().tree().find_contacts(centre, radius, contacts.data(), 2048), 2048);
  double depth = -1e300;
  for (std::uint32_t i = 0; i < count; ++i)
    if (contacts[i].is_finest()) depth = std::max(depth, contacts[i].depth(centre, radius));
  return (radius - depth) * session.scale();
}

Outcome run_one(const HandScaleModel& model, const std::vector<Vec3d>& path, const std::vector<double>& truth,
                const RemoteSettings& settings) {
  RemoteSession session{model.subject.model, settings};
  session.start();
  Outcome outcome;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const hrtc_service::ProbeOutput& output = session.step(path[i]);
    if (truth[i] > kTipRadius) continue;
    ++outcome.contact_cycles;
    const Vec3d centre = session.to_model(path[i]);
    const double radius = kTipRadius / session.scale();
    const bool inexact = (output.status & session::kExact) == 0;
    const bool tip_exact = session.forest().is_exact(centre, radius);
    outcome.exact_cycles += inexact ? 0 : 1;
    const double bound = inexact ? static_cast<double>(output.error_bound) : 0;
    const double error = std::abs(shown_distance(session, path[i], tip_exact) - truth[i]);
    outcome.over_bound += error > bound + kRoundingTolerance ? 1 : 0;
    if (!inexact) continue;
    outcome.bounds_mm.add(bound * 1e3);
    outcome.errors_mm.add(error * 1e3);
    if (tip_exact) continue;  // only the contact at the proxy's position is inexact
    const std::vector<std::uint32_t> wanted = session.loader().predicted(0);
    bool predicted = true, loaded = true;
    session.forest().grid().for_each_intersecting(centre, radius, [&](spm::RegionId region, double) {
      if (session.forest().is_loaded(region)) return;
      loaded = false;
      predicted = predicted && std::find(wanted.begin(), wanted.end(), index(region)) != wanted.end();
    });
    ++(loaded ? outcome.not_refined : predicted ? outcome.not_loaded : outcome.not_predicted);
  }
  outcome.traffic = session.traffic();
  outcome.loader = session.loader().figures();
  outcome.budget_spent = session.budget_spent();
  outcome.nodes_full = session.nodes_full();
  return outcome;
}

/// Returns the max difference between the distance by the fixed tree and the min distance to all triangles, at `count`
/// poses of the path, m.
double brute_force(const HandScaleModel& model, const std::vector<Vec3d>& path, const std::vector<double>& truth,
                   std::uint32_t count) {
  constexpr std::size_t kBlockPoses = 64;  // the mesh is read once for each block of poses
  const std::size_t every = std::max<std::size_t>(1, path.size() / count);
  double max_difference = 0;
  std::vector<std::size_t> poses;
  for (std::size_t i = 0; i < path.size() && poses.size() < count; i += every) poses.push_back(i);
  for (std::size_t first = 0; first < poses.size(); first += kBlockPoses) {
    const std::size_t last = std::min(poses.size(), first + kBlockPoses);
    std::array<Vec3d, kBlockPoses> at;
    std::array<double, kBlockPoses> nearest;  // squared
    nearest.fill(1e300);
    for (std::size_t k = first; k < last; ++k) at[k - first] = path[poses[k]] / model.unit;
    for (const std::array<std::uint32_t, 3>& face : model.subject.finest) {
      std::array<Vec3d, 3> corner;
      double max_squared_edge = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const std::array<float, 3>& p = model.subject.model.positions[face[c]];
        corner[c] = {p[0], p[1], p[2]};
      }
      for (std::size_t c = 1; c < 3; ++c)
        max_squared_edge = std::max(max_squared_edge, (corner[c] - corner[0]).squaredNorm());
      for (std::size_t k = 0; k < last - first; ++k) {
        // Let a be the first corner, e the longer edge at a, p the pose and d the nearest distance so far. If a point
        // of the triangle is within d of p, |a - p| <= d + e, so that |a - p|^2 <= 2 d^2 + 2 e^2. Skips other
        // triangles.
        if ((corner[0] - at[k]).squaredNorm() > 2 * (nearest[k] + max_squared_edge)) continue;
        nearest[k] = std::min(nearest[k], spm::closest_point(at[k], corner[0], corner[1], corner[2]).squared_distance);
      }
    }
    for (std::size_t k = first; k < last; ++k)
      max_difference = std::max(max_difference, std::abs(std::sqrt(nearest[k - first]) * model.unit - truth[poses[k]]));
  }
  return max_difference;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "building the model\n");
  const HandScaleModel model{settings.model, settings.faces};
  const spm::ModelSummary& summary = model.subject.model.summary;
  std::fprintf(stderr, "computing the path\n");
  const std::vector<Vec3d> path = surface_motion(model, settings.speed, 0, settings.cycles, settings.seed);
  std::vector<double> truth;
  truth.reserve(path.size());
  for (const Vec3d& tip : path) truth.push_back(model.distance(tip));
  double length = 0;
  for (std::size_t i = 1; i < path.size(); ++i) length += (path[i] - path[i - 1]).norm();

  char text[256];
  std::snprintf(text, sizeof text,
                "tip 3 mm, %g m/s along the surface, curvature of the path band-limited to %g Hz, pool %g MiB, %g "
                "Mbit/s, %s, seed %llu",
                settings.speed, kBand, settings.pool_mib, settings.rate_mbit, settings.strategy.c_str(),
                static_cast<unsigned long long>(settings.seed));
  Report report{{model.subject.name, summary.digest, summary.faces, text}};
  report.set_virtual_time(true);
  const Population cycles{"cycles", path.size()};
  report.add_value("mean speed of the tip", cycles, "m/s", length / (static_cast<double>(path.size()) * 1e-3));

  RemoteSettings remote;
  remote.pool = spm::PoolSettings::for_bytes(static_cast<std::uint64_t>(settings.pool_mib * (1 << 20)));
  remote.radius = kTipRadius;
  remote.rate = settings.rate_mbit * 1e6;
  if (settings.credit_kib > 0) remote.loader.delivery.credit = static_cast<std::uint32_t>(settings.credit_kib * 1024);
  const auto strategy = std::find(spm::kStrategyNames.begin(), spm::kStrategyNames.end(), settings.strategy);
  remote.loader.strategy = static_cast<spm::Strategy>(strategy - spm::kStrategyNames.begin());
  std::uint64_t audited = 0;
  for (const double round_trip_ms : settings.round_trips_ms) {
    std::fprintf(stderr, "%zu cycles, %g ms round trip\n", path.size(), round_trip_ms);
    remote.round_trip = round_trip_ms * 1e-3;
    const Outcome outcome = run_one(model, path, truth, remote);
    audited += outcome.contact_cycles;
    char at[48];
    std::snprintf(at, sizeof at, "%g ms: ", round_trip_ms);
    const auto figure = [&](const char* what, const Population& of, const char* unit, double value) {
      report.add_value(std::string{at} + what, of, unit, value);
    };
    const Population contacts{"contact cycles", outcome.contact_cycles};
    const Population arrivals{"arrivals of regions", outcome.traffic.regions};
    const double contact_cycles = static_cast<double>(outcome.contact_cycles);
    const auto share = [&](std::uint64_t part) { return 100 * static_cast<double>(part) / contact_cycles; };
    const std::string inexact = "inexact contact cycles";
    report.add_percentiles(std::string{at} + "published error bound", inexact, "mm", outcome.bounds_mm);
    report.add_percentiles(std::string{at} + "error", inexact, "mm", outcome.errors_mm);
    figure("inexact contact cycles with a region not predicted, divided by contact cycles", contacts, "%",
           share(outcome.not_predicted));
    figure("inexact contact cycles with a predicted region not loaded, divided by contact cycles", contacts, "%",
           share(outcome.not_loaded));
    figure("inexact contact cycles with a loaded region not refined, divided by contact cycles", contacts, "%",
           share(outcome.not_refined));
    figure("cycles whose refinement ended at its budget", cycles, "", static_cast<double>(outcome.budget_spent));
    figure("cycles without a free tree node", cycles, "", static_cast<double>(outcome.nodes_full));
    figure("payload of regions received", arrivals, "MB", static_cast<double>(outcome.traffic.bytes) / 1e6);
    figure("regions received", arrivals, "", static_cast<double>(outcome.traffic.regions));
    figure("payload of regions received and never touched", arrivals, "MB",
           static_cast<double>(outcome.traffic.unused_bytes) / 1e6);
    figure("regions refused by a full pool", arrivals, "", static_cast<double>(outcome.loader.refused_full));
    figure("regions refused for another reason", arrivals, "", static_cast<double>(outcome.loader.refused_other));
    figure("regions evicted", arrivals, "", static_cast<double>(outcome.loader.regions_evicted));
    figure("load latency at the end of the run", arrivals, "ms", outcome.loader.load_latency * 1e3);
    report.add_at_least(std::string{at} + "exact contact cycles divided by contact cycles", contacts, "%",
                        share(outcome.exact_cycles), round_trip_ms < 5 ? 99.9 : 95);
    report.add_at_most(std::string{at} + "contact cycles with an error over the published bound", contacts, "",
                       static_cast<double>(outcome.over_bound), 0);
  }
  std::fprintf(stderr, "brute force\n");
  const Population checked{"cycles checked", std::min<std::size_t>(path.size(), settings.brute_force_cycles)};
  report.add_value("cycles checked by brute force", checked, "", settings.brute_force_cycles);
  report.add_at_most("max difference of distances by fixed tree and by brute force", checked, "mm",
                     brute_force(model, path, truth, settings.brute_force_cycles) * 1e3, kRoundingTolerance * 1e3);
  report.add_at_least("contact cycles compared with the finest mesh",
                      {"cycles at all round trips", path.size() * settings.round_trips_ms.size()}, "",
                      static_cast<double>(audited),
                      0.9 * settings.cycles * static_cast<double>(settings.round_trips_ms.size()));
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "swift", "Strokes a large model over a network; checks that contacts are exact, or within their error bound",
      "10^5 cycles on a model of a million faces, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 50000000u));
  app.add_option("--cycles", settings.cycles, "number of cycles of 1 ms")->check(CLI::Range(1000u, 100000000u));
  app.add_option("--brute", settings.brute_force_cycles, "cycles checked by brute force")
      ->check(CLI::Range(1u, 1000000u));
  app.add_option("--speed", settings.speed, "mean speed, m/s")->check(tactus::wire::finite_range(0.001, 5.0));
  app.add_option("--round-trips", settings.round_trips_ms, "round trips, ms")
      ->check(tactus::wire::finite_range(0.0, 1000.0));
  app.add_option("--rate", settings.rate_mbit, "rate of the link, Mbit/s")->check(tactus::wire::finite_range(0.1, 1e5));
  app.add_option("--pool", settings.pool_mib, "size of the pool, MiB")->check(tactus::wire::finite_range(1.0, 1e4));
  app.add_option("--credit", settings.credit_kib, "credit of the host, KiB; 0: the default of an HRTC");
  app.add_option("--strategy", settings.strategy, "strategy of prediction")
      ->check(CLI::IsMember(
          std::vector<std::string>(tactus::spm::kStrategyNames.begin(), tactus::spm::kStrategyNames.end())));
  app.add_option("--seed", settings.seed, "seed of the path");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.cycles = std::min(settings.cycles, 100000u);
      settings.faces = std::min(settings.faces, 1000000u);
      settings.brute_force_cycles = std::min(settings.brute_force_cycles, 1000u);
    }
    return tactus::bench::run(settings);
  });
}
