/// Queries with Embree 3 on a mesh of fixed resolution, for comparison with the queries of this project.
///
/// Uses the functions and build qualities that Embree provides for such queries, so that the comparison is fair.
/// Coordinates have the caller's frame and unit. One thread at a time.
/// Allocates, as Embree does.
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

/// Finds the triangles that a sphere touches: rtcPointQuery on triangle geometry, then Ericson's closest point of each
/// triangle.
class EmbreeMesh {
 public:
  /// Copies the mesh and builds the tree. Throws std::runtime_error when Embree fails.
  EmbreeMesh(EmbreePositions vertices, EmbreeFaces faces);
  ~EmbreeMesh();
  EmbreeMesh(const EmbreeMesh&) = delete;
  EmbreeMesh& operator=(const EmbreeMesh&) = delete;

  /// Fills `out` with all triangles within `radius` of `centre`. Faces and points are those of AbTree::find_contacts.
  void find_contacts(const spm::Vec3d& centre, double radius, std::vector<spm::Contact>& out) const;

 private:
  struct Scene;
  std::unique_ptr<Scene> scene_;
};

/// Finds the pairs of triangles in which a rigid tool and an object intersect.
///
/// rtcCollide accepts only user geometry, and Embree does not transform user geometry. Therefore each query refits the
/// tool's tree to the pose. A test against the planes of the triangles rejects most pairs. PlacedProbe's test decides
/// the others, eight at a time.
class EmbreeTool {
 public:
  EmbreeTool(EmbreePositions object_vertices, EmbreeFaces object_faces, EmbreePositions tool_vertices,
             EmbreeFaces tool_faces);
  ~EmbreeTool();
  EmbreeTool(const EmbreeTool&) = delete;
  EmbreeTool& operator=(const EmbreeTool&) = delete;

  /// Moves the tool to `pose` and fills `out` with all intersecting pairs, as PlacedProbe::find_contacts does.
  void find_contacts(const Eigen::Isometry3d& pose, std::vector<spm::MeshContact>& out);

 private:
  struct Scenes;
  std::unique_ptr<Scenes> scenes_;
};

}  // namespace tactus::bench
