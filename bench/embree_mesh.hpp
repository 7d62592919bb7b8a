/// Embree 3 on a mesh of one fixed resolution, used as its experts would: the peer of this project's queries.
///
/// The caller's frame and unit. One thread. Allocates, as Embree does.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/mesh_probe.hpp"

namespace tactus::bench {

using EmbreePositions = std::span<const std::array<float, 3>>;
using EmbreeFaces = std::span<const std::array<std::uint32_t, 3>>;

/// Sphere queries: triangle geometry, rtcPointQuery, and Ericson's test of a point and a triangle.
class EmbreeMesh {
 public:
  /// Copies the mesh and builds the tree. Throws std::runtime_error when Embree fails.
  EmbreeMesh(EmbreePositions vertices, EmbreeFaces faces);
  ~EmbreeMesh();
  EmbreeMesh(const EmbreeMesh&) = delete;
  EmbreeMesh& operator=(const EmbreeMesh&) = delete;

  /// All triangles within `radius` of `centre`: face and point as AbTree::touching returns them.
  void touching(const spm::Vec3d& centre, double radius, std::vector<spm::Contact>& out) const;

 private:
  struct Scene;
  std::unique_ptr<Scene> scene_;
};

/// Queries of a rigid mesh against another: rtcCollide, which takes user geometry only. Embree moves no user geometry
/// rigidly, so the tool's tree is refitted to each pose. Planes reject most pairs; the rest are decided eight at a time
/// by the test that PlacedProbe uses.
class EmbreeTool {
 public:
  EmbreeTool(EmbreePositions object_vertices, EmbreeFaces object_faces, EmbreePositions vertices,
             EmbreeFaces triangles);
  ~EmbreeTool();
  EmbreeTool(const EmbreeTool&) = delete;
  EmbreeTool& operator=(const EmbreeTool&) = delete;

  /// Moves all vertices of the tool, refits its tree and finds all intersecting pairs, as PlacedProbe::touching does.
  void touching(const Eigen::Isometry3d& pose, std::vector<spm::MeshContact>& out);

 private:
  struct Scenes;
  std::unique_ptr<Scenes> scenes_;
};

}  // namespace tactus::bench
