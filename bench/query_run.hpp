/// One path of a sphere and of a stylus over a model, and what each contender takes for its queries there.
///
/// The refined mesh and the contenders on fixed meshes each get every pose once, in blocks of 100 cycles whose order
/// rotates. A time is that of one query, and the first cycle counts like any other. Contacts are compared outside what
/// is timed. File units, model frame.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/embree_mesh.hpp"
#include "bench/models.hpp"
#include "bench/surface_path.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/finest_tree.hpp"
#include "spm/mesh_probe.hpp"
#include "spm/offline/generate.hpp"

namespace tactus::bench {

struct QuerySettings {
  std::string model;
  std::uint32_t faces = 70000;
  double seconds = 20;
  double radius = 0.003;  // m
  double speed = 0.05;    // m/s
  double depth = 0.0002;  // m
  double pool_share = 0.25;
  std::uint32_t budget = 1000;
  std::uint64_t seed = 1;
};
void add_query_options(App& app, QuerySettings& settings);

enum class ProbeKind { kSphere, kStylus };

struct QueryScene {
  QueryScene(LoadedModel loaded, const QuerySettings& settings);

  QuerySettings settings;
  LoadedModel subject;
  double unit, radius;  ///< m; file units
  std::vector<SurfacePose> path;
  std::vector<Eigen::Isometry3d> poses;  ///< of both probes
  spm::offline::TriangleMesh stylus;
  spm::MeshProbe probe;  ///< the stylus

  /// What the figures depend on, with the priority that was granted.
  [[nodiscard]] std::string text() const;
};

/// Sorted; of a sphere face ids, of a stylus hashes over face, triangle, point, normal and depth.
using ContactKeys = std::vector<std::uint64_t>;

/// What one kind of query found where another found something, with the number of cycles compared.
struct Comparison {
  std::uint64_t cycles = 0, contacts = 0, differ = 0;
  std::uint64_t tangent = 0;  ///< faces left out: within 1e-9 m of tangency, where rounding decides
  [[nodiscard]] Population population() const;
};

/// A way to query a fixed mesh.
struct Contender {
  std::string name;
  std::function<void(std::size_t pose)> query;
  std::function<ContactKeys()> contacts;  ///< of the last query; null: not compared
  int reference = -1;                     ///< the contender on the same mesh whose contacts are expected; -1: none
  Samples times{}, cold{};                ///< us; cold: after 64 MiB of other memory were walked
  Comparison compared{};
};

/// A fixed mesh in the trees of all. Must outlive its contenders.
class FixedMeshes {
 public:
  FixedMeshes(const QueryScene& scene, const spm::offline::TriangleMesh& mesh);
  /// Embree, then the AB-tree compared with it. `name` of the mesh; `first`: the index of the first contender.
  [[nodiscard]] std::vector<Contender> contenders(ProbeKind probe, const std::string& name, int first);
  /// FCL, which is not compared.
  [[nodiscard]] Contender with_fcl(ProbeKind probe, const std::string& name);

 private:
  const QueryScene& scene_;
  spm::FinestTree tree_;
  EmbreeMesh embree_;
  EmbreeTool embree_tool_;
  spm::fcl::FixedMesh fcl_;
};

/// us. A frame is T_R + T_B + T_Q; loading is outside, as it has a thread of its own in an HRTC.
struct RefinedTimes {
  Samples refine, refit, query, frame;    ///< all cycles
  Samples changed_refine, changed_refit;  ///< cycles that split or collapsed a record
  Samples cold_query, cold_frame;
  std::uint64_t cycles = 0, exact = 0;
  Comparison compared;  ///< exact cycles, with the first contender
  Comparison by_all;    ///< a sample of all cycles, with all shown faces one by one
  [[nodiscard]] double exact_percent() const noexcept;
};

struct QueryRun {
  RefinedTimes refined;
  std::vector<Contender> fixed;
};

/// Refines for the whole probe. `cold`: also times cold queries and frames. The first of `fixed` is on the finest mesh.
[[nodiscard]] QueryRun run_queries(const QueryScene& scene, ProbeKind probe, std::vector<Contender> fixed, bool cold);

/// The mesh that records refine the model to.
[[nodiscard]] spm::offline::TriangleMesh finest_mesh(const LoadedModel& subject);

/// Adds the bounds that contacts are the same.
void add_comparisons(Report& report, const std::string& probe, const QueryRun& run);

}  // namespace tactus::bench
