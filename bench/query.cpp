// T_Q of a sphere and of a mesh probe on the locally refined mesh, beside Embree on the static finest mesh in the same
// run.
//
// All contenders take turns along one path, block by block, each beside a controller that refines and loads as it
// would, and change places until everyone has had every pose, in several rounds. The same work is done in each round,
// so of a pose's times the least counts: more is the machine's other work. Contacts are compared: with Embree's in
// every exact cycle, and with all shown faces one by one in a sample of cycles.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/embree_mesh.hpp"
#include "bench/figures.hpp"
#include "bench/models.hpp"
#include "bench/refined_run.hpp"
#include "bench/stopwatch.hpp"
#include "bench/stylus.hpp"
#include "bench/surface_path.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/finest_tree.hpp"
#include "spm/mesh_probe.hpp"
#include "spm/triangle.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr std::uint32_t kContacts = 1u << 16;
constexpr std::size_t kBlock = 100;         // cycles in a row for one contender
constexpr double kTangent = 1e-9;           // m: nearer to tangency than this, rounding decides
constexpr std::size_t kWashed = 64u << 20;  // bytes walked before a cold query

struct Settings {
  std::string model;
  std::string json;
  std::uint32_t faces = 70000;
  double seconds = 20;
  double radius = 0.003;  // m
  double speed = 0.05;    // m/s
  double depth = 0.0002;  // m
  double edge = 0;        // m; 0: as large as the model is
  double pool_share = 0.25;
  std::uint32_t budget = 1000;
  std::uint64_t seed = 1;
  std::uint32_t rounds = 3;
  bool quick = false;
};

/// A model with its scale, a path over it and the trees of the others.
struct Bench {
  const Settings& settings;
  LoadedModel subject;
  double unit;    // m
  double radius;  // file units
  std::vector<SurfacePose> path;
  std::vector<Eigen::Isometry3d> poses;  // of the stylus
  spm::offline::TriangleMesh stylus;

  [[nodiscard]] RefinedRunSettings refined() const {
    return {settings.speed / unit, settings.pool_share, settings.budget};
  }
};

Bench prepare(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  Bench bench{settings, load_model(settings.model, settings.faces), 0, 0, {}, {}, {}};
  const LoadedModel& subject = bench.subject;
  if (settings.edge > 0) scale_to_edge(bench.subject, settings.edge);
  bench.unit = subject.model.summary.metres_per_unit;
  bench.radius = settings.radius / bench.unit;
  std::fprintf(stderr, "making the path\n");
  const spm::fcl::FixedMesh surface{subject.model.positions, subject.finest};
  const PathSettings path{bench.radius, settings.depth / bench.unit, settings.speed * kPeriod / bench.unit,
                          static_cast<std::uint32_t>(settings.seconds / kPeriod), settings.seed};
  bench.path =
      surface_poses(subject.model.positions, subject.finest, path, [&](const Vec3d& p) { return surface.distance(p); });
  bench.poses = stylus_poses(bench.path);
  bench.stylus = stylus_in(bench.unit);
  return bench;
}

// ---- taking turns ----

/// The least time of each pose, us.
class Best {
 public:
  explicit Best(std::size_t poses) : min_(poses, HUGE_VAL) {}
  void add(std::size_t pose, double us) { min_[pose] = std::min(min_[pose], us); }
  [[nodiscard]] Samples samples() const {
    Samples taken;
    for (const double us : min_)
      if (us < HUGE_VAL) taken.add(us);
    return taken;
  }

 private:
  std::vector<double> min_;
};

/// `first`: of the rounds, in which results are looked at too.
using Contender = std::function<void(std::size_t pose, const RefinedRun& refined, bool first)>;

/// Walks memory that nothing else uses.
class Washer {
 public:
  void wash() {
    for (std::size_t i = 0; i < memory_.size(); i += 64) sum_ = static_cast<unsigned char>(sum_ + ++memory_[i]);
  }
  [[nodiscard]] unsigned char sum() const noexcept { return sum_; }

 private:
  std::vector<unsigned char> memory_ = std::vector<unsigned char>(kWashed);
  unsigned char sum_ = 0;
};

/// Each contender gets each pose once a round (cold: of every `cold_every`), beside a run that refines for the probe.
void in_turn(const Bench& bench, const spm::ProbeShape& probe, const std::vector<Contender>& contenders,
             std::size_t poses, std::size_t cold_every) {
  Washer washer;
  for (std::size_t pass = 0; pass < bench.settings.rounds * contenders.size(); ++pass) {
    RefinedRun refined{bench.subject.model, probe, bench.refined()};
    for (std::size_t i = 0; i < poses; ++i) {
      static_cast<void>(refined.step(bench.poses[i], i > 0));
      if (!refined.settled()) continue;
      if (cold_every > 0) {
        if (i % cold_every != 0) continue;
        washer.wash();
      }
      const std::size_t turn = cold_every > 0 ? i / cold_every : i / kBlock;
      contenders[(turn + pass) % contenders.size()](i, refined, pass < contenders.size());
    }
  }
  static_cast<void>(washer.sum());
}

// ---- the sphere ----

struct Sphere {
  explicit Sphere(std::size_t poses) : ours{poses}, embree{poses}, cold_ours{poses}, cold_embree{poses} {}
  Best ours, embree, cold_ours, cold_embree;
  std::vector<std::vector<std::uint32_t>> found, expected;  // finest faces, by pose; found where exact
  std::vector<bool> exact;
  std::uint64_t cycles = 0, exact_cycles = 0, compared = 0, mismatches = 0, tangent = 0, by_all = 0, all_mismatches = 0;
  std::uint32_t truncated = 0;
};

double distance_to(const std::array<Vec3d, 3>& face, const Vec3d& p) {
  return std::sqrt(spm::closest_point(p, face[0], face[1], face[2]).squared_distance);
}

/// Shown faces that the ball touches by all of them one by one and not by the query, or the reverse.
std::uint64_t wrong_by_all(const Bench& bench, const spm::AbTree& tree, const Vec3d& centre,
                           const std::vector<spm::Contact>& contacts, std::uint32_t count) {
  std::vector<std::uint32_t> faces;
  for (std::uint32_t c = 0; c < count; ++c) faces.push_back(index(contacts[c].face));
  std::sort(faces.begin(), faces.end());
  std::uint64_t wrong = 0;
  for (const std::uint32_t row : tree.shown()) {
    const double off = distance_to(spm::shown_corners(tree, row), centre) - bench.radius;
    if (std::abs(off) * bench.unit < kTangent) continue;
    wrong += (off < 0) != std::binary_search(faces.begin(), faces.end(), tree.row(row).face) ? 1 : 0;
  }
  return wrong;
}

Sphere run_sphere(const Bench& bench, const EmbreeMesh& embree, std::size_t cold_poses, std::size_t cold_every) {
  const std::size_t poses = bench.path.size();
  const spm::ProbeShape tip{bench.radius};
  Sphere s{poses};
  s.found.resize(poses);
  s.expected.resize(poses);
  s.exact.resize(poses, false);
  std::vector<spm::Contact> contacts(kContacts), theirs;
  theirs.reserve(kContacts);
  const std::size_t sample = std::max<std::size_t>(1, poses / 50);
  const auto query = [&](std::size_t i, const RefinedRun& refined, Best& times) {
    Stopwatch watch;
    const std::uint32_t count =
        refined.forest().tree().touching(bench.path[i].centre, bench.radius, contacts.data(), kContacts);
    times.add(i, watch.lap());
    return count;
  };
  const auto ours = [&](std::size_t i, const RefinedRun& refined, bool first) {
    const std::uint32_t count = query(i, refined, s.ours);
    if (!first) return;
    ++s.cycles;
    if (count > kContacts) ++s.truncated;
    if (i % sample == 0) {
      ++s.by_all;
      s.all_mismatches +=
          wrong_by_all(bench, refined.forest().tree(), bench.path[i].centre, contacts, std::min(count, kContacts)) > 0;
    }
    if (!refined.forest().exact(bench.path[i].centre, bench.radius)) return;
    s.exact[i] = true;
    ++s.exact_cycles;
    for (std::uint32_t c = 0; c < std::min(count, kContacts); ++c)
      if (contacts[c].last()) s.found[i].push_back(index(contacts[c].face));
  };
  const auto peer = [&](std::size_t i, const RefinedRun&, bool first) {
    Stopwatch watch;
    embree.touching(bench.path[i].centre, bench.radius, theirs);
    s.embree.add(i, watch.lap());
    if (!first) return;
    for (const spm::Contact& c : theirs) s.expected[i].push_back(index(c.face));
  };
  in_turn(bench, tip, {ours, peer}, poses, 0);
  for (std::size_t i = 0; i < poses; ++i) {
    if (!s.exact[i]) continue;
    ++s.compared;
    std::sort(s.found[i].begin(), s.found[i].end());
    std::sort(s.expected[i].begin(), s.expected[i].end());
    std::vector<std::uint32_t> odd;
    std::set_symmetric_difference(s.found[i].begin(), s.found[i].end(), s.expected[i].begin(), s.expected[i].end(),
                                  std::back_inserter(odd));
    std::uint64_t wrong = 0;
    for (const std::uint32_t face : odd) {
      std::array<Vec3d, 3> corners;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::array<float, 3>& p = bench.subject.model.positions[bench.subject.finest[face][k]];
        corners[k] = {p[0], p[1], p[2]};
      }
      const double off = distance_to(corners, bench.path[i].centre) - bench.radius;
      ++(std::abs(off) * bench.unit < kTangent ? s.tangent : wrong);
    }
    s.mismatches += wrong > 0 ? 1 : 0;
  }
  const auto cold_ours = [&](std::size_t i, const RefinedRun& refined, bool) {
    static_cast<void>(query(i, refined, s.cold_ours));
  };
  const auto cold_peer = [&](std::size_t i, const RefinedRun&, bool) {
    Stopwatch watch;
    embree.touching(bench.path[i].centre, bench.radius, theirs);
    s.cold_embree.add(i, watch.lap());
  };
  in_turn(bench, tip, {cold_ours, cold_peer}, cold_poses, cold_every);
  return s;
}

// ---- the stylus ----

/// What a query found, whatever the order: as good as the whole list.
struct Digest {
  std::uint64_t sum = 0, count = 0;

  void add(const spm::MeshContact& c) noexcept {
    std::uint64_t h = mix(std::uint64_t{index(c.face)} << 32 | c.triangle);
    for (const double x : {c.depth, c.point[0], c.point[1], c.point[2], c.normal[0], c.normal[1], c.normal[2]}) {
      std::uint64_t bits;
      std::memcpy(&bits, &x, sizeof bits);
      h = mix(h ^ bits);
    }
    sum += h;
    ++count;
  }
  [[nodiscard]] bool operator!=(const Digest& other) const noexcept { return sum != other.sum || count != other.count; }

 private:
  static std::uint64_t mix(std::uint64_t x) noexcept {
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9ull;
    x = (x ^ x >> 27) * 0x94d049bb133111ebull;
    return x ^ x >> 31;
  }
};

struct Stylus {
  explicit Stylus(std::size_t poses)
      : ours{poses}, finest{poses}, embree{poses}, cold_ours{poses}, cold_finest{poses}, cold_embree{poses} {}
  Best ours, finest, embree, cold_ours, cold_finest, cold_embree;
  std::vector<Digest> refined, whole, expected;  // by pose; refined: finest faces only, where exact
  std::vector<bool> exact;
  std::uint64_t cycles = 0, exact_cycles = 0, compared = 0, mismatches = 0, whole_mismatches = 0;
  std::uint64_t by_all = 0, all_mismatches = 0, contacts = 0, coarse_contacts = 0, incomplete = 0, truncated = 0;
};

Digest by_all_pairs(const spm::AbTree& tree, const spm::PlacedProbe& probe, std::uint32_t triangles) {
  std::vector<spm::Triangle3d> tool;
  Vec3d low = Vec3d::Constant(HUGE_VAL), high = -low;
  for (std::uint32_t t = 0; t < triangles; ++t) {
    tool.push_back(probe.triangle(t));
    for (const Vec3d& p : tool.back()) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  }
  Digest digest;
  for (const std::uint32_t row : tree.shown()) {
    const spm::Triangle3d face = spm::shown_corners(tree, row);
    const Vec3d face_low = face[0].cwiseMin(face[1]).cwiseMin(face[2]);
    const Vec3d face_high = face[0].cwiseMax(face[1]).cwiseMax(face[2]);
    if ((face_low.array() > high.array()).any() || (face_high.array() < low.array()).any()) continue;
    for (std::uint32_t t = 0; t < triangles; ++t) {
      spm::PairContact contact;
      if (!spm::meet(face, tool[t], contact)) continue;
      digest.add({spm::FaceId{tree.row(row).face}, t, tree.row(row).last != 0, contact.point, contact.normal,
                  contact.depth, row});
    }
  }
  return digest;
}

Stylus run_stylus(const Bench& bench, const EmbreeMesh& embree, std::size_t cold_poses, std::size_t cold_every) {
  const std::size_t poses = bench.poses.size();
  Stylus s{poses};
  s.refined.resize(poses);
  s.whole.resize(poses);
  s.expected.resize(poses);
  s.exact.resize(poses, false);
  const spm::MeshProbe probe{bench.stylus.positions, bench.stylus.faces};
  const spm::ProbeShape along{probe};
  spm::PlacedProbe placed{probe};
  EmbreeMesh::Probe embree_probe{embree, bench.stylus.positions, bench.stylus.faces};
  const spm::FinestTree finest{bench.subject.model.positions, bench.subject.finest};
  std::vector<spm::MeshContact> contacts(kContacts), theirs;
  theirs.reserve(kContacts);
  const std::size_t sample = std::max<std::size_t>(1, poses / 50);
  const auto query = [&](std::size_t i, const spm::AbTree& tree, Best& times) {
    Stopwatch watch;
    placed.place(bench.poses[i]);
    const spm::MeshTouch touch = placed.touching(tree, contacts.data(), kContacts);
    times.add(i, watch.lap());
    s.incomplete += touch.complete ? 0 : 1;
    s.truncated += touch.contacts > kContacts ? 1 : 0;
    return std::min(touch.contacts, kContacts);
  };
  const auto ours = [&](std::size_t i, const RefinedRun& refined, bool first) {
    const spm::Forest& forest = refined.forest();
    const std::uint32_t count = query(i, forest.tree(), s.ours);
    if (!first) return;
    ++s.cycles;
    s.contacts += count;
    Digest all;
    for (std::uint32_t c = 0; c < count; ++c) {
      all.add(contacts[c]);
      if (contacts[c].last)
        s.refined[i].add(contacts[c]);
      else
        ++s.coarse_contacts;
    }
    if (i % sample == 0) {
      ++s.by_all;
      s.all_mismatches += by_all_pairs(forest.tree(), placed, probe.triangles()) != all ? 1 : 0;
    }
    s.exact[i] = refined.refinement().exact();
    s.exact_cycles += s.exact[i] ? 1 : 0;
  };
  const auto whole = [&](std::size_t i, const RefinedRun&, bool first) {
    const std::uint32_t count = query(i, finest.tree(), s.finest);
    if (!first) return;
    for (std::uint32_t c = 0; c < count; ++c) s.whole[i].add(contacts[c]);
  };
  const auto peer = [&](std::size_t i, const RefinedRun&, bool first) {
    Stopwatch watch;
    embree_probe.touching(bench.poses[i], theirs);
    s.embree.add(i, watch.lap());
    if (!first) return;
    for (const spm::MeshContact& c : theirs) s.expected[i].add(c);
  };
  in_turn(bench, along, {ours, whole, peer}, poses, 0);
  for (std::size_t i = 0; i < poses; ++i) {
    s.whole_mismatches += s.whole[i] != s.expected[i] ? 1 : 0;
    if (!s.exact[i]) continue;
    ++s.compared;
    s.mismatches += s.refined[i] != s.expected[i] ? 1 : 0;
  }
  const auto cold_ours = [&](std::size_t i, const RefinedRun& refined, bool) {
    static_cast<void>(query(i, refined.forest().tree(), s.cold_ours));
  };
  const auto cold_whole = [&](std::size_t i, const RefinedRun&, bool) {
    static_cast<void>(query(i, finest.tree(), s.cold_finest));
  };
  const auto cold_peer = [&](std::size_t i, const RefinedRun&, bool) {
    Stopwatch watch;
    embree_probe.touching(bench.poses[i], theirs);
    s.cold_embree.add(i, watch.lap());
  };
  in_turn(bench, along, {cold_ours, cold_whole, cold_peer}, cold_poses, cold_every);
  return s;
}

int run(const Settings& settings) {
  const Bench bench = prepare(settings);
  const spm::ModelSummary& summary = bench.subject.model.summary;
  const EmbreeMesh embree{bench.subject.model.positions, bench.subject.finest};
  const std::size_t cold_poses = std::min<std::size_t>(bench.path.size(), settings.quick ? 1000 : 5000);
  constexpr std::size_t kColdEvery = 10;
  std::fprintf(stderr, "sphere, %zu cycles\n", bench.path.size());
  const Sphere sphere = run_sphere(bench, embree, cold_poses, kColdEvery);
  std::fprintf(stderr, "stylus\n");
  const Stylus stylus = run_stylus(bench, embree, cold_poses, kColdEvery);

  char text[320];
  std::snprintf(text, sizeof text,
                "radius %g mm, stylus of %zu triangles, %g cm/s, %g mm deep, %g s, 1 unit = %g m, pool %g of the "
                "model, budget %u, path seed %llu, best of %u rounds for each pose",
                settings.radius * 1e3, bench.stylus.faces.size(), settings.speed * 1e2, settings.depth * 1e3,
                settings.seconds, bench.unit, settings.pool_share, settings.budget,
                static_cast<unsigned long long>(settings.seed), settings.rounds);
  Report report{{"query", bench.subject.name, summary.digest, summary.faces, text}};
  const std::string all = "all after 0.2 s", cold = "cold, every 10th";
  const Samples sphere_ours = sphere.ours.samples(), sphere_embree = sphere.embree.samples();
  const Samples sphere_cold = sphere.cold_ours.samples();
  const Samples stylus_ours = stylus.ours.samples(), stylus_embree = stylus.embree.samples();
  report.row("sphere, refined mesh", all, "us", sphere_ours);
  report.row("sphere, Embree on the finest", all, "us", sphere_embree);
  report.row("sphere, refined mesh", cold, "us", sphere_cold);
  report.row("sphere, Embree on the finest", cold, "us", sphere.cold_embree.samples());
  report.row("stylus, refined mesh", all, "us", stylus_ours);
  report.row("stylus, AB-tree of the finest", all, "us", stylus.finest.samples());
  report.row("stylus, Embree on the finest", all, "us", stylus_embree);
  report.row("stylus, refined mesh", cold, "us", stylus.cold_ours.samples());
  report.row("stylus, AB-tree of the finest", cold, "us", stylus.cold_finest.samples());
  report.row("stylus, Embree on the finest", cold, "us", stylus.cold_embree.samples());
  const auto share = [](std::uint64_t part, std::uint64_t whole) {
    return whole == 0 ? 0 : 100.0 * static_cast<double>(part) / static_cast<double>(whole);
  };
  report.figure("sphere, exact", all, "%", share(sphere.exact_cycles, sphere.cycles));
  report.figure("stylus, exact", all, "%", share(stylus.exact_cycles, stylus.cycles));
  report.figure("stylus, contacts on coarse faces", all, "%", share(stylus.coarse_contacts, stylus.contacts));
  report.figure("stylus, contacts in a cycle", all, "",
                static_cast<double>(stylus.contacts) / static_cast<double>(std::max<std::uint64_t>(1, stylus.cycles)));
  report.figure("faces excepted near tangency", "exact cycles", "", static_cast<double>(sphere.tangent));
  report.figure("compared with all faces", "a sample", "cycles", static_cast<double>(sphere.by_all + stylus.by_all));

  report.at_most("sphere: cycles with other contacts than Embree", "exact cycles", "",
                 static_cast<double>(sphere.mismatches), 0);
  report.at_most("sphere: cycles with other contacts than all faces give", "a sample", "",
                 static_cast<double>(sphere.all_mismatches), 0);
  report.at_most("stylus: cycles with other contacts than Embree, refined", "exact cycles", "",
                 static_cast<double>(stylus.mismatches), 0);
  report.at_most("stylus: cycles with other contacts than Embree, finest", all, "",
                 static_cast<double>(stylus.whole_mismatches), 0);
  report.at_most("stylus: cycles with other contacts than all pairs give", "a sample", "",
                 static_cast<double>(stylus.all_mismatches), 0);
  report.at_most("queries truncated or cut short", all, "",
                 static_cast<double>(sphere.truncated + stylus.truncated + stylus.incomplete), 0);
  report.at_most("sphere: median / Embree's", all, "times", sphere_ours.percentile(50) / sphere_embree.percentile(50),
                 1.1);
  report.at_most("sphere: median", cold, "us", sphere_cold.percentile(50), 10);
  report.at_most("sphere: p99", cold, "us", sphere_cold.percentile(99), 25);
  report.at_most("stylus: median / Embree's", all, "times", stylus_ours.percentile(50) / stylus_embree.percentile(50),
                 1);
  constexpr std::uint32_t kLarge = 2'000'000;  // faces
  if (summary.faces < kLarge)
    report.at_most("stylus: p99.9", all, "us", stylus_ours.percentile(99.9), 250);
  else
    report.at_most("stylus: p99", all, "us", stylus_ours.percentile(99), 500);
  return report.finish(settings.json);
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  CLI::App app{"Sphere and stylus queries on the refined mesh, beside Embree on the finest"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--edge", settings.edge, "scale the model to this mean edge, m")->check(CLI::Range(1e-5, 1e-2));
  app.add_option("--seconds", settings.seconds, "length of the path")->check(CLI::Range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "of the tip, m/s")->check(CLI::Range(0.001, 2.0));
  app.add_option("--pool-share", settings.pool_share, "pool, as a share of the model's records")
      ->check(CLI::Range(0.01, 1.0));
  app.add_option("--budget", settings.budget, "of a cycle, units of spm::Budget")->check(CLI::Range(100u, 1000000u));
  app.add_option("--rounds", settings.rounds, "of a pose's times the least of so many counts")
      ->check(CLI::Range(1u, 100u));
  app.add_option("--seed", settings.seed, "of the path");
  app.add_option("--json", settings.json, "the figures as JSON");
  app.add_flag("--quick", settings.quick, "2 s, for CI");
  return tactus::bench::bench_main(app, "tactus-bench-query", argc, argv, [&] {
    if (settings.quick) settings.seconds = std::min(settings.seconds, 2.0);
    return tactus::bench::run(settings);
  });
}
