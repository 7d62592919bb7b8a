/// Simplifies one block of faces, called a patch. simplify.hpp states the rules for collapses.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "spm/ids.hpp"
#include "spm/offline/cost_queue.hpp"
#include "spm/offline/quadric.hpp"
#include "spm/offline/simplify.hpp"

namespace tactus::spm::offline {

/// The mesh that is simplified. In each round, a face belongs to exactly one patch. A vertex belongs to a patch if all
/// its faces do. A patch reads and writes only its own faces and vertices.
struct Surface {
  static constexpr std::uint8_t kAlive = 1, kChanged = 2;
  static constexpr std::uint32_t kShared = kNone;

  const TriangleMesh& finest;
  std::vector<Triangle> corners;            ///< by face
  std::vector<std::uint8_t> state;          ///< by face: bits kAlive (not removed) and kChanged (by a collapse)
  std::vector<Quadric> quadrics;            ///< by vertex, with the vertex as origin, in scaled coordinates
  std::vector<std::uint32_t> owner;         ///< by vertex: the block that has all its faces, or kShared
  std::vector<std::uint32_t> local_number;  ///< by vertex: its number in the patch that owns it
  float scale;  ///< power of two by which positions are multiplied, so that edges are about 1

  [[nodiscard]] Offset scaled(std::uint32_t v) const {
    const std::array<float, 3>& p = finest.positions[v];
    return {p[0] * scale, p[1] * scale, p[2] * scale};
  }
};

/// Returns the unit normal, or zero if the triangle has no area. Sets `length` to twice the area.
[[nodiscard]] Offset unit_normal(const std::array<Offset, 3>& triangle, float& length);
/// Adds a plane through a border edge, perpendicular to its only face, so that a motion away from the border has a
/// cost.
void add_border_plane(Quadric& quadric, const Offset& edge, const Offset& normal);

struct PatchTask {
  std::span<const std::uint32_t> faces;  ///< faces of the patch that are not removed
  std::uint32_t block;                   ///< number of the patch in `Surface::owner`
  std::uint32_t target;                  ///< number of faces at which to stop
  bool is_first_round;                   ///< the faces are finest, and their quadrics must be computed
  bool is_last_round;  ///< also collapses pairs without an edge, and repeats as long as collapses make others legal
};

class Patch {
 public:
  Patch(Surface& surface, const SimplifyOptions& options);

  /// Copies the faces from the surface, simplifies until `target` faces are left or no collapse is legal, and writes
  /// the result to the surface. Calls `progress` with the finished share, 0 to 1.
  [[nodiscard]] Segment simplify(const PatchTask& task, const std::function<void(double)>& progress = {});

 private:
  static constexpr std::uint32_t kRingCapacity = 128;

  struct Vertex {
    Offset at;
    // The star of an inner vertex: the corners of faces at the vertex (4 * face + corner), in `corners_`.
    std::uint32_t star, size, capacity;
    std::uint32_t id;  // in `Surface`
    bool is_inner;     // the patch has all its faces
    bool is_removed;
  };
  struct Face {
    std::array<std::uint32_t, 3> corner;
    Offset normal;     // unit normal of its finest version, or zero if that has no area
    std::uint32_t id;  // in `Surface`
    bool is_alive, is_changed;
  };
  /// The form of the graph whose nodes are the neighbours of u and whose edges are the faces of u.
  enum class Star {
    kDisc,     ///< one closed ring
    kFan,      ///< one open chain: u is on a border
    kPinched,  ///< any other graph without border: sheets that touch at u or along an edge of u
    kLocked,   ///< any other graph: u can collapse only as a pair (SimplifyOptions::pair_distance)
  };
  /// The neighbours of a vertex u. `neighbours` has, for the edge from u to each vertex of the ring, the third corners
  /// of the first two faces at this edge, as positions in the ring.
  struct Ring {
    std::uint32_t size = 0;
    Star star = Star::kLocked;
    std::array<std::uint32_t, kRingCapacity> vertex;
    std::array<std::uint8_t, kRingCapacity> degree;  // number of faces at the edge from u to the vertex
    std::array<std::array<std::uint8_t, 2>, kRingCapacity> neighbours;
  };

  /// A vertex to which u may collapse.
  struct Candidate {
    float cost;
    std::uint32_t t;
  };

  void load(const PatchTask& task);
  std::uint32_t local_number(std::uint32_t vertex, std::uint32_t block);
  void load_normal(Face& face, bool is_first_round);
  void build_stars();
  void add_border_planes(std::uint32_t v);
  void store();
  void fill_queue(bool is_first_round);
  void try_vertex(std::uint32_t u);
  void build_ring(std::uint32_t u);
  bool is_connected() const;
  std::uint32_t ring_index(std::uint32_t v);
  std::uint32_t in_ring(std::uint32_t v) const { return ring_position_[v] == 0 ? ring_.size : ring_position_[v] - 1u; }
  void clear_ring();
  void gather_candidates(std::uint32_t u);
  void gather_pairs(std::uint32_t u);
  void fill_grid();
  std::uint32_t grid_coordinate(double x) const;
  static std::uint64_t grid_key(std::uint32_t x, std::uint32_t y, std::uint32_t z);
  bool is_within_pair_distance(std::uint32_t u, std::uint32_t t) const;
  float cost(std::uint32_t u, std::uint32_t t) const;
  bool is_legal_collapse(std::uint32_t u, std::uint32_t t) const;
  bool preserves_surface(std::uint32_t u, std::uint32_t at) const;
  bool preserves_sheets(std::uint32_t u, std::uint32_t t) const;
  bool preserves_faces(std::uint32_t u, std::uint32_t t) const;
  bool has_face(std::uint32_t u, std::uint32_t a, std::uint32_t b) const;
  bool preserves_shapes(std::uint32_t u, std::uint32_t t) const;
  void collapse(std::uint32_t u, std::uint32_t t);
  void remove_corner(std::uint32_t v, std::uint32_t face);
  void reserve_star(std::uint32_t v, std::uint32_t size);
  std::span<const std::uint32_t> star(std::uint32_t v) const {
    return {corners_.data() + vertices_[v].star, vertices_[v].size};
  }

  Surface& surface_;
  SimplifyOptions options_;
  std::uint32_t alive_ = 0;  // number of faces
  std::vector<Vertex> vertices_;
  std::vector<Face> faces_;
  std::vector<Quadric> quadrics_;
  std::vector<std::uint32_t> corners_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> shared_;  // vertex id, index in `vertices_`; ascending
  std::vector<std::uint8_t> ring_position_;                      // by vertex: 1 + position in the ring, 0: none
  CostQueue queue_;
  Ring ring_;
  float pair_distance2_ = 0;  // square of SimplifyOptions::pair_distance, scaled; 0: no pairs
  double cell_ = 0;           // edge of a cell of `grid_`, scaled
  std::vector<std::pair<std::uint64_t, std::uint32_t>> grid_;  // cell, inner vertex; empty without pairs
  std::vector<Candidate> candidates_;
  Segment out_;
};

}  // namespace tactus::spm::offline
