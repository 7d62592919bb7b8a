#include "bench/query_run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <stdexcept>

#include "bench/priority.hpp"
#include "bench/refined_run.hpp"
#include "bench/stopwatch.hpp"
#include "bench/stylus.hpp"
#include "spm/triangle.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr std::uint32_t kMaxContacts = 1u << 16;
constexpr std::size_t kBlockCycles = 100;       // consecutive cycles of one contender
constexpr double kTangencyTolerance = 1e-9;     // m
constexpr std::size_t kFlushBytes = 64u << 20;  // bytes written before a cold query
constexpr std::size_t kColdCycles = 500;

/// Writes memory that nothing else uses, which evicts everything else from the CPU caches.
class CacheFlusher {
 public:
  void flush() {
    for (std::size_t i = 0; i < memory_.size(); i += 64) ++memory_[i];
    asm volatile("" : : "r"(memory_.data()) : "memory");
  }

 private:
  std::vector<unsigned char> memory_ = std::vector<unsigned char>(kFlushBytes);
};

std::uint64_t mix(std::uint64_t x) noexcept {
  x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ x >> 27) * 0x94d049bb133111ebull;
  return x ^ x >> 31;
}

std::uint64_t key_of(const spm::MeshContact& c) noexcept {
  std::uint64_t h = mix(std::uint64_t{index(c.face)} << 32 | c.triangle);
  for (const double x : {c.depth, c.point[0], c.point[1], c.point[2], c.normal[0], c.normal[1], c.normal[2]}) {
    std::uint64_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    h = mix(h ^ bits);
  }
  return h;
}
std::uint64_t key_of(const spm::Contact& c) noexcept { return index(c.face); }
bool is_finest(const spm::MeshContact& c) noexcept { return c.is_finest; }
bool is_finest(const spm::Contact& c) noexcept { return c.is_finest(); }

template <class Contacts>
ContactKeys keys_of(const Contacts& contacts, std::size_t count, bool finest_only) {
  ContactKeys keys;
  for (std::size_t i = 0; i < count; ++i)
    if (!finest_only || is_finest(contacts[i])) keys.push_back(key_of(contacts[i]));
  std::sort(keys.begin(), keys.end());
  return keys;
}

/// Queries AB-trees of the refined mesh or of a fixed mesh, and holds the contacts of the last query.
class TreeQuery {
 public:
  TreeQuery(const QueryScene& scene, ProbeKind kind) : scene_{scene}, kind_{kind}, placed_{scene.probe} {
    kind == ProbeKind::kSphere ? spheres_.resize(kMaxContacts) : pairs_.resize(kMaxContacts);
  }
  void query(const spm::AbTree& tree, std::size_t pose) {
    bool complete = true;
    if (kind_ == ProbeKind::kSphere) {
      count_ = tree.find_contacts(scene_.path[pose].centre, scene_.radius, spheres_.data(), kMaxContacts);
    } else {
      placed_.set_pose(scene_.poses[pose]);
      const spm::MeshQueryResult touch = placed_.find_contacts(tree, pairs_.data(), kMaxContacts);
      count_ = touch.contacts;
      complete = touch.complete;
    }
    if (count_ > kMaxContacts || !complete) throw std::runtime_error("a query did not return all contacts");
  }
  [[nodiscard]] ContactKeys keys(bool finest_only) const {
    return kind_ == ProbeKind::kSphere ? keys_of(spheres_, count_, finest_only) : keys_of(pairs_, count_, finest_only);
  }
  [[nodiscard]] const spm::PlacedProbe& placed() const noexcept { return placed_; }

 private:
  const QueryScene& scene_;
  const ProbeKind kind_;
  spm::PlacedProbe placed_;
  std::vector<spm::Contact> spheres_;
  std::vector<spm::MeshContact> pairs_;
  std::uint32_t count_ = 0;
};

/// Returns the distance from the sphere's surface to the face, file units; negative if they overlap.
double gap_to(const QueryScene& scene, std::size_t pose, const std::array<Vec3d, 3>& face) {
  const Vec3d& centre = scene.path[pose].centre;
  return std::sqrt(spm::closest_point(centre, face[0], face[1], face[2]).squared_distance) - scene.radius;
}

bool is_tangent(const QueryScene& scene, std::size_t pose, const std::array<Vec3d, 3>& face) {
  return std::abs(gap_to(scene, pose, face)) * scene.unit < kTangencyTolerance;
}

std::array<Vec3d, 3> finest_corners(const QueryScene& scene, std::uint64_t face) {
  std::array<Vec3d, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::array<float, 3>& p = scene.subject.model.positions[scene.subject.finest[face][k]];
    corners[k] = {p[0], p[1], p[2]};
  }
  return corners;
}

/// Compares the contacts of two queries of the same mesh. If the mesh is the finest one, differences of nearly tangent
/// faces of a sphere do not count.
void compare(Comparison& to, const QueryScene& scene, ProbeKind kind, std::size_t pose, const ContactKeys& found,
             const ContactKeys& expected, bool finest) {
  ++to.cycles;
  to.contacts += expected.size();
  if (found == expected) return;
  if (kind == ProbeKind::kStylus || !finest) {
    ++to.different_cycles;
    return;
  }
  ContactKeys different_faces;
  std::set_symmetric_difference(found.begin(), found.end(), expected.begin(), expected.end(),
                                std::back_inserter(different_faces));
  const auto tangent = std::count_if(different_faces.begin(), different_faces.end(), [&](std::uint64_t face) {
    return is_tangent(scene, pose, finest_corners(scene, face));
  });
  to.tangent_faces += static_cast<std::uint64_t>(tangent);
  to.different_cycles += static_cast<std::size_t>(tangent) < different_faces.size() ? 1 : 0;
}

/// Compares the contacts of the query with those of a test of each shown face.
void compare_with_all(Comparison& to, const QueryScene& scene, ProbeKind kind, std::size_t pose,
                      const spm::AbTree& tree, const TreeQuery& query) {
  ContactKeys found = query.keys(false), expected;
  Vec3d low = Vec3d::Constant(HUGE_VAL), high = -low;
  std::vector<spm::Triangle3d> tool;
  for (std::uint32_t t = 0; kind == ProbeKind::kStylus && t < scene.probe.triangles(); ++t) {
    tool.push_back(query.placed().triangle(t));
    for (const Vec3d& p : tool.back()) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  }
  for (const spm::LeafLane at : tree.shown()) {
    const std::array<Vec3d, 3> face = spm::shown_corners(tree, at);
    const spm::FaceId id = tree.face(at);
    if (kind == ProbeKind::kSphere) {
      const double gap = gap_to(scene, pose, face);
      if (std::abs(gap) * scene.unit < kTangencyTolerance) {
        ++to.tangent_faces;
        found.erase(std::remove(found.begin(), found.end(), index(id)), found.end());
      } else if (gap < 0) {
        expected.push_back(index(id));
      }
      continue;
    }
    const Vec3d face_low = face[0].cwiseMin(face[1]).cwiseMin(face[2]);
    const Vec3d face_high = face[0].cwiseMax(face[1]).cwiseMax(face[2]);
    if ((face_low.array() > high.array()).any() || (face_high.array() < low.array()).any()) continue;
    for (std::uint32_t t = 0; t < tool.size(); ++t)
      if (spm::PairContact c; spm::intersect(face, tool[t], c))
        expected.push_back(key_of(spm::MeshContact{id, t, tree.is_finest(at), c.point, c.normal, c.depth}));
  }
  std::sort(expected.begin(), expected.end());
  ++to.cycles;
  to.contacts += expected.size();
  to.different_cycles += found != expected ? 1 : 0;
}

/// The refined mesh, which is refined for the whole probe.
class RefinedQuery {
 public:
  RefinedQuery(const QueryScene& scene, ProbeKind kind)
      : scene_{scene},
        run_{scene.subject.model,
             kind == ProbeKind::kSphere ? spm::ProbeShape{scene.radius} : spm::ProbeShape{scene.probe},
             {scene.settings.speed / scene.unit, scene.settings.pool_share, scene.settings.budget}},
        query_{scene, kind} {}

  RefinedStep step(std::size_t pose) { return run_.step(scene_.poses[pose], pose > 0); }
  double query(std::size_t pose) {
    Stopwatch watch;
    query_.query(tree(), pose);
    return watch.lap();
  }
  [[nodiscard]] bool is_exact() const noexcept { return run_.refinement().is_exact(); }
  [[nodiscard]] const spm::AbTree& tree() const noexcept { return run_.forest().tree(); }
  [[nodiscard]] const TreeQuery& found() const noexcept { return query_; }

 private:
  const QueryScene& scene_;
  RefinedRun run_;
  TreeQuery query_;
};

double time_us(const Contender& contender, std::size_t pose) {
  Stopwatch watch;
  contender.query(pose);
  return watch.lap();
}

/// Times every tenth cycle cold. Alternates between a cold frame and a cold query.
void run_cold(const QueryScene& scene, ProbeKind kind, QueryRun& run) {
  constexpr std::size_t kEvery = 10;
  const std::size_t poses = std::min(scene.poses.size(), kColdCycles * kEvery);
  CacheFlusher flusher;
  RefinedQuery refined{scene, kind};
  for (std::size_t pose = 0; pose < poses; ++pose) {
    const bool cold = pose % kEvery == 0, cold_frame = pose / kEvery % 2 == 0;
    if (cold && cold_frame) flusher.flush();
    const RefinedStep step = refined.step(pose);
    if (!cold) continue;
    if (!cold_frame) flusher.flush();
    const double query = refined.query(pose);
    cold_frame ? run.refined.cold_frame.add(step.refine + step.refit + query) : run.refined.cold_query.add(query);
  }
  for (Contender& contender : run.fixed)
    for (std::size_t pose = 0; pose < poses; pose += kEvery) {
      flusher.flush();
      contender.cold_us.add(time_us(contender, pose));
    }
}

}  // namespace

void add_query_options(App& app, QuerySettings& settings) {
  app.add_option("--model", settings.model, "model file of any kind (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--seconds", settings.seconds, "length of the path, s")
      ->check(tactus::wire::finite_range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "speed of the tip, m/s")->check(tactus::wire::finite_range(0.001, 2.0));
  app.add_option("--pool-share", settings.pool_share, "pool divided by the model's records")
      ->check(tactus::wire::finite_range(0.01, 1.0));
  app.add_option("--budget", settings.budget, "budget of a cycle, units of spm::Budget")
      ->check(CLI::Range(100u, 1000000u));
  app.add_option("--seed", settings.seed, "seed of the path");
}

QueryScene::QueryScene(LoadedModel loaded, const QuerySettings& given)
    : settings{given},
      subject{std::move(loaded)},
      unit{subject.model.summary.metres_per_unit},
      radius{given.radius / unit},
      stylus{stylus_in(unit)},
      probe{stylus.positions, stylus.faces} {
  std::fprintf(stderr, "computing the path\n");
  const spm::fcl::FixedMesh surface{subject.model.positions, subject.finest};
  path = surface_poses(subject.model.positions, subject.finest,
                       {radius, settings.depth / unit, settings.speed * kPeriod / unit,
                        static_cast<std::uint32_t>(settings.seconds / kPeriod), settings.seed},
                       [&](const Vec3d& p) { return surface.distance(p); });
  poses = stylus_poses(path);
}

std::string QueryScene::text() const {
  char text[320];
  std::snprintf(text, sizeof text,
                "radius %g mm, stylus of %u triangles, %g cm/s, %g mm deep, %g s, 1 unit = %g m, %u base faces, pool "
                "%g of the model's records, budget %u, path seed %llu, each query timed once, %s",
                settings.radius * 1e3, probe.triangles(), settings.speed * 1e2, settings.depth * 1e3, settings.seconds,
                unit, subject.model.summary.base_faces, settings.pool_share, settings.budget,
                static_cast<unsigned long long>(settings.seed), Priority{}.text());
  return text;
}

Population Comparison::population() const {
  return {"cycles, " + std::to_string(contacts) + " contacts", static_cast<std::size_t>(cycles)};
}

FixedMesh::FixedMesh(const QueryScene& scene, const spm::offline::TriangleMesh& mesh)
    : scene_{scene},
      tree_{mesh.positions, mesh.faces},
      embree_{mesh.positions, mesh.faces},
      embree_tool_{mesh.positions, mesh.faces, scene.stylus.positions, scene.stylus.faces},
      fcl_{mesh.positions, mesh.faces} {}

std::vector<Contender> FixedMesh::contenders(ProbeKind probe, const std::string& mesh_name, int embree_index) {
  std::vector<Contender> all;
  if (probe == ProbeKind::kSphere) {
    const auto found = std::make_shared<std::vector<spm::Contact>>();
    all.push_back(
        {"Embree, " + mesh_name,
         [this, found](std::size_t pose) { embree_.find_contacts(scene_.path[pose].centre, scene_.radius, *found); },
         [found] { return keys_of(*found, found->size(), false); }});
  } else {
    const auto found = std::make_shared<std::vector<spm::MeshContact>>();
    all.push_back({"Embree, " + mesh_name,
                   [this, found](std::size_t pose) { embree_tool_.find_contacts(scene_.poses[pose], *found); },
                   [found] { return keys_of(*found, found->size(), false); }});
  }
  const auto query = std::make_shared<TreeQuery>(scene_, probe);
  all.push_back({"AB-tree, " + mesh_name, [this, query](std::size_t pose) { query->query(tree_.tree(), pose); },
                 [query] { return query->keys(false); }, embree_index});
  return all;
}

Contender FixedMesh::fcl_contender(ProbeKind probe, const std::string& mesh_name) {
  if (probe == ProbeKind::kSphere) {
    const auto faces = std::make_shared<std::vector<std::uint32_t>>();
    return {
        "FCL, " + mesh_name,
        [this, faces](std::size_t pose) { fcl_.find_touched_faces(scene_.path[pose].centre, scene_.radius, *faces); },
        {}};
  }
  struct Tool {
    spm::fcl::FixedMesh mesh;
    std::vector<std::array<float, 3>> moved;
    std::vector<std::array<std::uint32_t, 2>> pairs;
  };
  const std::vector<std::array<float, 3>>& rest = scene_.stylus.positions;
  const auto tool = std::make_shared<Tool>(Tool{{rest, scene_.stylus.faces}, rest, {}});
  return {"FCL, " + mesh_name,
          [this, tool, &rest](std::size_t pose) {
            for (std::size_t v = 0; v < rest.size(); ++v) {
              const Vec3d at = scene_.poses[pose] * Vec3d{rest[v][0], rest[v][1], rest[v][2]};
              for (int axis = 0; axis < 3; ++axis)
                tool->moved[v][static_cast<std::size_t>(axis)] = static_cast<float>(at[axis]);
            }
            tool->mesh.move(tool->moved);
            tool->mesh.refit();
            fcl_.intersecting(tool->mesh, tool->pairs);
          },
          {}};
}

double RefinedFigures::exact_percent() const noexcept {
  return cycles == 0 ? 0 : 100 * static_cast<double>(exact_cycles) / static_cast<double>(cycles);
}

QueryRun run_queries(const QueryScene& scene, ProbeKind kind, std::vector<Contender> fixed, bool cold) {
  std::fprintf(stderr, "%s, %zu cycles\n", kind == ProbeKind::kSphere ? "sphere" : "stylus", scene.poses.size());
  QueryRun run{{}, std::move(fixed)};
  RefinedQuery refined{scene, kind};
  RefinedFigures& r = run.refined;
  const std::size_t sample = std::max<std::size_t>(1, scene.poses.size() / 50);
  std::vector<std::vector<ContactKeys>> found(run.fixed.size(), std::vector<ContactKeys>(kBlockCycles));
  std::vector<ContactKeys> found_refined(kBlockCycles);
  std::vector<bool> exact(kBlockCycles);
  const auto refine_and_query = [&](std::size_t pose, std::size_t in_block) {
    const RefinedStep step = refined.step(pose);
    const double query = refined.query(pose);
    r.refine.add(step.refine);
    r.refit.add(step.refit);
    if (step.changes > 0) {
      r.changed_refine.add(step.refine);
      r.changed_refit.add(step.refit);
    }
    r.query.add(query);
    r.frame.add(step.refine + step.refit + query);
    if (pose % sample == 0) compare_with_all(r.with_brute_force, scene, kind, pose, refined.tree(), refined.found());
    ++r.cycles;
    exact[in_block] = refined.is_exact();
    r.exact_cycles += exact[in_block] ? 1 : 0;
    found_refined[in_block] = refined.found().keys(true);
  };
  const Priority priority;
  for (std::size_t begin = 0; begin < scene.poses.size(); begin += kBlockCycles) {
    const std::size_t count = std::min(kBlockCycles, scene.poses.size() - begin);
    const std::size_t contenders = run.fixed.size() + 1;
    for (std::size_t turn = 0; turn < contenders; ++turn) {
      const std::size_t contender_index = (begin / kBlockCycles + turn) % contenders;
      for (std::size_t i = 0; i < count; ++i) {
        if (contender_index == run.fixed.size()) {
          refine_and_query(begin + i, i);
          continue;
        }
        Contender& contender = run.fixed[contender_index];
        contender.times_us.add(time_us(contender, begin + i));
        if (contender.contacts) found[contender_index][i] = contender.contacts();
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      if (exact[i]) compare(r.with_finest, scene, kind, begin + i, found_refined[i], found[0][i], true);
      for (std::size_t contender_index = 0; contender_index < run.fixed.size(); ++contender_index) {
        Contender& contender = run.fixed[contender_index];
        if (contender.reference < 0) continue;
        compare(contender.with_reference, scene, kind, begin + i, found[contender_index][i],
                found[static_cast<std::size_t>(contender.reference)][i], contender.reference == 0);
      }
    }
  }
  if (cold) run_cold(scene, kind, run);
  return run;
}

spm::offline::TriangleMesh finest_mesh(const LoadedModel& subject) {
  return {{subject.model.positions.begin(), subject.model.positions.end()}, subject.finest};
}

void add_comparisons(Report& report, const std::string& probe, const QueryRun& run) {
  const auto add = [&](const std::string& what, const Comparison& c) {
    report.add_at_most(probe + ": " + what, c.population(), "", static_cast<double>(c.different_cycles), 0);
    if (c.tangent_faces > 0)
      report.add_value(probe + ": nearly tangent faces, not compared", c.population(), "",
                       static_cast<double>(c.tangent_faces));
  };
  const RefinedFigures& r = run.refined;
  add("exact cycles with contacts that differ from " + run.fixed.front().name, r.with_finest);
  add("cycles with contacts that differ from a test of each shown face", r.with_brute_force);
  for (const Contender& contender : run.fixed)
    if (contender.reference >= 0)
      add("cycles of " + contender.name + " with contacts that differ from " +
              run.fixed[static_cast<std::size_t>(contender.reference)].name,
          contender.with_reference);
  report.add_at_least(probe + ": exact cycles divided by all cycles", {"cycles", r.cycles}, "%", r.exact_percent(), 99);
}

}  // namespace tactus::bench
