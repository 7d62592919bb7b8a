/// Times the collision queries of a sphere and of a stylus along one path, on the locally refined mesh and on fixed
/// meshes.
///
/// Each contender queries each pose once. Contenders alternate after each block of 100 cycles, in rotating order. Each
/// time is of one query, and the first cycle counts. Contacts are compared outside the timed code. File units, model
/// frame.
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
  double seconds = 20;          // duration of the path
  double radius = 0.003;        // m
  double speed = 0.05;          // m/s
  double depth = 0.0002;        // depth of the tip in the surface, m
  double pool_share = 0.25;     // pool slots beyond the base mesh divided by the model's record parts
  std::uint32_t budget = 1000;  // of a cycle, units of spm::Budget
  std::uint64_t seed = 1;
};
/// Adds an option for each setting except radius and depth.
void add_query_options(App& app, QuerySettings& settings);

enum class ProbeKind { kSphere, kStylus };

/// The model, the two probes and their path.
struct QueryScene {
  QueryScene(LoadedModel loaded, const QuerySettings& settings);

  QuerySettings settings;
  LoadedModel subject;
  double unit;                           ///< metres in a file unit
  double radius;                         ///< of the sphere, file units
  std::vector<SurfacePose> path;         ///< of the sphere's centre and the stylus' tip
  std::vector<Eigen::Isometry3d> poses;  ///< of the stylus, one for each pose of `path`
  spm::offline::TriangleMesh stylus;
  spm::MeshProbe probe;  ///< the stylus

  /// Returns the settings on which the figures depend, and the scheduling policy that the system grants.
  [[nodiscard]] std::string text() const;
};

/// The contacts of one query, sorted. For a sphere, face ids. For a stylus, hashes over face, triangle, point, normal
/// and depth.
using ContactKeys = std::vector<std::uint64_t>;

/// Comparison of the contacts of one kind of query with those of another, the reference.
struct Comparison {
  std::uint64_t cycles = 0;            ///< number of cycles compared
  std::uint64_t contacts = 0;          ///< number of contacts of the reference
  std::uint64_t different_cycles = 0;  ///< number of cycles with different contacts
  /// Number of faces that were not compared, because their distance is within 1e-9 m of the sphere's radius, where
  /// rounding decides.
  std::uint64_t tangent_faces = 0;
  [[nodiscard]] Population population() const;
};

/// One kind of query on a fixed mesh, with its times.
struct Contender {
  std::string name;
  std::function<void(std::size_t pose)> query;
  std::function<ContactKeys()> contacts;  ///< returns the contacts of the last query; null: contacts are not compared
  int reference = -1;                     ///< index of the contender with the expected contacts; -1: none
  Samples times_us{};
  Samples cold_us{};  ///< times of cold queries: before each, 64 MiB of other memory were written
  Comparison with_reference{};
};

/// A fixed mesh in the data structures of Embree, AB-tree and FCL. Must outlive its contenders.
class FixedMesh {
 public:
  FixedMesh(const QueryScene& scene, const spm::offline::TriangleMesh& mesh);
  /// Returns two contenders: Embree, and the AB-tree with Embree as its reference. `mesh_name` becomes part of their
  /// names. The caller puts Embree at `embree_index` of its list of contenders.
  [[nodiscard]] std::vector<Contender> contenders(ProbeKind probe, const std::string& mesh_name, int embree_index);
  /// Returns FCL, whose contacts are not compared.
  [[nodiscard]] Contender fcl_contender(ProbeKind probe, const std::string& mesh_name);

 private:
  const QueryScene& scene_;
  spm::FinestTree tree_;
  EmbreeMesh embree_;
  EmbreeTool embree_tool_;
  spm::fcl::FixedMesh fcl_;
};

/// Times on the refined mesh, us. A frame is T_R + T_B + T_Q: refine, refit and query. Loading is not timed, since
/// another thread of an HRTC does it.
struct RefinedFigures {
  Samples refine, refit, query, frame;    ///< times of all cycles
  Samples changed_refine, changed_refit;  ///< times of the cycles that split or collapsed a record
  Samples cold_query, cold_frame;         ///< times of cold queries and of cold frames
  std::uint64_t cycles = 0, exact_cycles = 0;
  Comparison with_finest;       ///< exact cycles, compared with the first contender
  Comparison with_brute_force;  ///< about 50 cycles, compared with a test of all shown faces
  /// Returns the exact cycles divided by all cycles, %.
  [[nodiscard]] double exact_percent() const noexcept;
};

/// Times and comparisons of one probe on the refined mesh and on the fixed meshes.
struct QueryRun {
  RefinedFigures refined;
  std::vector<Contender> fixed;
};

/// Runs all cycles on the mesh that is refined for the whole probe, and on the meshes of `fixed`. The first of `fixed`
/// must query the finest mesh. If `cold`, also times cold queries and frames.
[[nodiscard]] QueryRun run_queries(const QueryScene& scene, ProbeKind probe, std::vector<Contender> fixed, bool cold);

/// Returns the model's mesh at full resolution.
[[nodiscard]] spm::offline::TriangleMesh finest_mesh(const LoadedModel& subject);

/// Adds rows with the bounds that contacts are equal and that 99 % of the cycles are exact.
void add_comparisons(Report& report, const std::string& probe, const QueryRun& run);

}  // namespace tactus::bench
