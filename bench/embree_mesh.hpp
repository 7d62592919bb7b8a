/// A mesh of one fixed resolution in Embree's tree: the honest bar for queries.
///
/// Embree finds the candidates, in float and robust; what a candidate comes to is decided by the code that this
/// project's own queries use, so that the same contacts come out and the trees are what is compared. One thread. The
/// caller's frame and unit. Allocates, as Embree does.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/mesh_probe.hpp"
#include "spm/span.hpp"

namespace tactus::bench {

class EmbreeMesh {
 public:
  using Position = std::array<float, 3>;
  using Face = std::array<std::uint32_t, 3>;

  /// Copies the mesh and builds the tree at Embree's highest quality. Throws std::runtime_error when Embree fails.
  EmbreeMesh(spm::Span<const Position> vertices, spm::Span<const Face> faces);
  ~EmbreeMesh();
  EmbreeMesh(const EmbreeMesh&) = delete;
  EmbreeMesh& operator=(const EmbreeMesh&) = delete;

  /// All triangles within `radius` of `centre`: face and point as AbTree::touching has them.
  void touching(const spm::Vec3d& centre, double radius, std::vector<spm::Contact>& out) const;

  /// A mesh to probe with; its tree is refitted to each pose, as Embree has no rigid motion of user geometry.
  class Probe {
   public:
    Probe(const EmbreeMesh& object, spm::Span<const Position> vertices, spm::Span<const Face> triangles);
    ~Probe();
    Probe(const Probe&) = delete;
    Probe& operator=(const Probe&) = delete;

    /// Moves all vertices, refits and finds all pairs that meet, as PlacedProbe::touching has them.
    void touching(const Eigen::Isometry3d& pose, std::vector<spm::MeshContact>& out);

   private:
    struct Scene;
    std::unique_ptr<Scene> scene_;
  };

 private:
  struct Scene;
  std::unique_ptr<Scene> scene_;
};

}  // namespace tactus::bench
