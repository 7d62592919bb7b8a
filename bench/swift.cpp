// A hand that strokes a model of ten million faces at half a metre a second, over a network: is what it touches exact,
// and is it never wrong beyond what was said?
//
// Every contact cycle is audited against a static tree of the finest mesh, which is itself checked by brute force.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/remote_session.hpp"
#include "bench/strokes.hpp"
#include "spm/triangle.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kSame = 1e-9;  // m: what rounding may differ by

struct Settings {
  std::string model, strategy = "mixture";
  std::uint32_t faces = 10000000, cycles = 1000000, brute = 10000;
  double speed = 0.5, rate = 100, pool = 16, credit = 0;
  std::vector<double> round_trips{0.5, 100};
  std::uint64_t seed = 1;
  bool quick = false;
};

struct Outcome {
  std::uint64_t contacts = 0, exact = 0;
  std::uint64_t unflagged = 0;                                      // contact cycles beyond their bound
  double max_beyond = -1;                                           // m, beyond the bound
  Samples bounds, errors;                                           // m, of contact cycles that are not exact
  std::uint64_t not_predicted = 0, under_way = 0, not_refined = 0;  // what kept a contact cycle from being exact
  RemoteSession::Traffic traffic;
  hrtc_service::LoaderFigures loader;
  std::uint64_t budget_spent = 0, nodes_full = 0;
};

/// Distance from the tip's centre to the surface that the cycle touched; m. Of an exact query only finest faces count.
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
      std::min<std::uint32_t>(session.forest().tree().touching(centre, radius, contacts.data(), 2048), 2048);
  double depth = -1e300;
  for (std::uint32_t i = 0; i < count; ++i)
    if (contacts[i].last()) depth = std::max(depth, contacts[i].depth(centre, radius));
  return (radius - depth) * session.scale();
}

Outcome run_one(const StrokedModel& model, const std::vector<Vec3d>& path, const std::vector<double>& truth,
                const RemoteSettings& settings) {
  RemoteSession session{model.subject.model, settings};
  session.start();
  Outcome outcome;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const hrtc_service::ProbeOutput& output = session.step(path[i]);
    if (truth[i] > kTipRadius) continue;
    ++outcome.contacts;
    const Vec3d centre = session.to_model(path[i]);
    const double radius = kTipRadius / session.scale();
    const bool flagged = (output.status & session::kExact) == 0;
    const bool tip_exact = session.forest().exact(centre, radius);
    outcome.exact += flagged ? 0 : 1;
    const double bound = flagged ? static_cast<double>(output.error_bound) : 0;
    const double error = std::abs(shown_distance(session, path[i], tip_exact) - truth[i]);
    outcome.max_beyond = std::max(outcome.max_beyond, error - bound);
    outcome.unflagged += error > bound + kSame ? 1 : 0;
    if (!flagged) continue;
    outcome.bounds.add(bound * 1e3);
    outcome.errors.add(error * 1e3);
    if (tip_exact) continue;  // the proxy's place was not
    const std::vector<std::uint32_t> wanted = session.loader().predicted(0);
    bool predicted = true, here = true;
    session.forest().grid().for_each_meeting(centre, radius, [&](spm::RegionId region, double) {
      if (session.forest().is_here(region)) return;
      here = false;
      predicted = predicted && std::find(wanted.begin(), wanted.end(), index(region)) != wanted.end();
    });
    ++(here ? outcome.not_refined : predicted ? outcome.under_way : outcome.not_predicted);
  }
  outcome.traffic = session.traffic();
  outcome.loader = session.loader().figures();
  outcome.budget_spent = session.budget_spent();
  outcome.nodes_full = session.nodes_full();
  return outcome;
}

/// Greatest difference between the static tree's distance and that to all triangles, one after the other, at `count`
/// poses spread over the path; m.
double brute_force(const StrokedModel& model, const std::vector<Vec3d>& path, const std::vector<double>& truth,
                   std::uint32_t count) {
  constexpr std::size_t kAtOnce = 64;  // poses: the mesh is read once for so many
  const std::size_t every = std::max<std::size_t>(1, path.size() / count);
  double worst = 0;
  std::vector<std::size_t> poses;
  for (std::size_t i = 0; i < path.size() && poses.size() < count; i += every) poses.push_back(i);
  for (std::size_t first = 0; first < poses.size(); first += kAtOnce) {
    const std::size_t last = std::min(poses.size(), first + kAtOnce);
    std::array<Vec3d, kAtOnce> at;
    std::array<double, kAtOnce> nearest;  // squared
    nearest.fill(1e300);
    for (std::size_t k = first; k < last; ++k) at[k - first] = path[poses[k]] / model.unit;
    for (const std::array<std::uint32_t, 3>& face : model.subject.finest) {
      std::array<Vec3d, 3> corner;
      double reach = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const std::array<float, 3>& p = model.subject.model.positions[face[c]];
        corner[c] = {p[0], p[1], p[2]};
      }
      for (std::size_t c = 1; c < 3; ++c) reach = std::max(reach, (corner[c] - corner[0]).squaredNorm());
      for (std::size_t k = 0; k < last - first; ++k) {
        // No point of a triangle is further from its first corner than its longer edge there: |a - p| <= d + e, and
        // (d + e)^2 <= 2 d^2 + 2 e^2.
        if ((corner[0] - at[k]).squaredNorm() > 2 * (nearest[k] + reach)) continue;
        nearest[k] = std::min(nearest[k], spm::closest_point(at[k], corner[0], corner[1], corner[2]).squared_distance);
      }
    }
    for (std::size_t k = first; k < last; ++k)
      worst = std::max(worst, std::abs(std::sqrt(nearest[k - first]) * model.unit - truth[poses[k]]));
  }
  return worst;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  const StrokedModel model{settings.model, settings.faces};
  const spm::ModelSummary& summary = model.subject.model.summary;
  std::fprintf(stderr, "making the path\n");
  const std::vector<Vec3d> path = surface_motion(model, settings.speed, 0, settings.cycles, settings.seed);
  std::vector<double> truth;
  truth.reserve(path.size());
  for (const Vec3d& tip : path) truth.push_back(model.distance(tip));
  double length = 0;
  for (std::size_t i = 1; i < path.size(); ++i) length += (path[i] - path[i - 1]).norm();

  char text[256];
  std::snprintf(
      text, sizeof text,
      "tip 3 mm, %g m/s along the surface, curvature of a band of %g Hz, pool %g MiB, %g Mbit/s, %s, seed %llu",
      settings.speed, kBand, settings.pool, settings.rate, settings.strategy.c_str(),
      static_cast<unsigned long long>(settings.seed));
  Report report{{model.subject.name, summary.digest, summary.faces, text}};
  report.virtual_time(true);
  report.figure("mean speed of the tip", "all cycles", "m/s", length / (static_cast<double>(path.size()) * 1e-3));

  RemoteSettings remote;
  remote.pool = spm::PoolSettings::for_bytes(static_cast<std::uint64_t>(settings.pool * (1 << 20)));
  remote.radius = kTipRadius;
  remote.rate = settings.rate * 1e6;
  if (settings.credit > 0) remote.loader.delivery.credit = static_cast<std::uint32_t>(settings.credit * 1024);
  const auto strategy = std::find(spm::kStrategyNames.begin(), spm::kStrategyNames.end(), settings.strategy);
  remote.loader.strategy = static_cast<spm::Strategy>(strategy - spm::kStrategyNames.begin());
  std::uint64_t audited = 0;
  for (const double round_trip : settings.round_trips) {
    std::fprintf(stderr, "%zu cycles, %g ms round trip\n", path.size(), round_trip);
    remote.round_trip = round_trip * 1e-3;
    const Outcome outcome = run_one(model, path, truth, remote);
    audited += outcome.contacts;
    char at[48];
    std::snprintf(at, sizeof at, "%g ms: ", round_trip);
    const auto figure = [&](const char* what, const char* of, const char* unit, double value) {
      report.figure(std::string{at} + what, of, unit, value);
    };
    const double contacts = static_cast<double>(outcome.contacts);
    const auto share = [&](std::uint64_t part) { return 100 * static_cast<double>(part) / contacts; };
    const std::string inexact = "contact cycles not exact";
    report.row(std::string{at} + "stated bound", inexact, "mm", outcome.bounds);
    report.row(std::string{at} + "error", inexact, "mm", outcome.errors);
    figure("a region not predicted", "contact cycles", "%", share(outcome.not_predicted));
    figure("a region predicted, not here yet", "contact cycles", "%", share(outcome.under_way));
    figure("a region here, not refined yet", "contact cycles", "%", share(outcome.not_refined));
    figure("refinement ended by its budget", "all cycles", "", static_cast<double>(outcome.budget_spent));
    figure("no tree node left", "all cycles", "", static_cast<double>(outcome.nodes_full));
    figure("fetched", "regions", "MB", static_cast<double>(outcome.traffic.bytes) / 1e6);
    figure("fetched", "regions", "", static_cast<double>(outcome.traffic.regions));
    figure("fetched, never used", "regions", "MB", static_cast<double>(outcome.traffic.unused) / 1e6);
    figure("refused, pool full", "regions", "", static_cast<double>(outcome.loader.refused_full));
    figure("refused, incomplete", "regions", "", static_cast<double>(outcome.loader.refused_other));
    figure("evicted", "regions", "", static_cast<double>(outcome.loader.regions_evicted));
    figure("load latency at the end", "regions", "ms", outcome.loader.load_latency * 1e3);
    report.at_least(std::string{at} + "exact", {"contact cycles", outcome.contacts}, "%", share(outcome.exact),
                    round_trip < 5 ? 99.9 : 95);
    report.at_most(std::string{at} + "wrong beyond the stated bound", {"contact cycles", outcome.contacts}, "",
                   static_cast<double>(outcome.unflagged), 0);
  }
  std::fprintf(stderr, "brute force\n");
  report.figure("cycles checked by brute force", "", "", settings.brute);
  report.at_most("static tree less brute force, at worst", {"those", settings.brute}, "mm",
                 brute_force(model, path, truth, settings.brute) * 1e3, kSame * 1e3);
  report.at_least("audited cycles", "contact cycles, all runs", "", static_cast<double>(audited),
                  0.9 * settings.cycles);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"swift",
                         "Swift strokes over a network on a large model: exact, or never wrong beyond the stated bound",
                         "10^5 cycles on a million faces, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 50000000u));
  app.add_option("--cycles", settings.cycles, "of 1 ms")->check(CLI::Range(1000u, 100000000u));
  app.add_option("--brute", settings.brute, "cycles checked by brute force")->check(CLI::Range(1u, 1000000u));
  app.add_option("--speed", settings.speed, "mean, m/s")->check(CLI::Range(0.001, 5.0));
  app.add_option("--round-trips", settings.round_trips, "ms")->check(CLI::Range(0.0, 1000.0));
  app.add_option("--rate", settings.rate, "of the link, Mbit/s")->check(CLI::Range(0.1, 1e5));
  app.add_option("--pool", settings.pool, "MiB")->check(CLI::Range(1.0, 1e4));
  app.add_option("--credit", settings.credit, "KiB that the host may have under way; 0: as the HRTC has it");
  app.add_option("--strategy", settings.strategy, "of prediction")
      ->check(CLI::IsMember(
          std::vector<std::string>(tactus::spm::kStrategyNames.begin(), tactus::spm::kStrategyNames.end())));
  app.add_option("--seed", settings.seed, "of the path");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.cycles = std::min(settings.cycles, 100000u);
      settings.faces = std::min(settings.faces, 1000000u);
      settings.brute = std::min(settings.brute, 1000u);
    }
    return tactus::bench::run(settings);
  });
}
