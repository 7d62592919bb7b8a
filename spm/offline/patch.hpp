/// Simplifies one block of faces. The rules for collapses are in simplify.hpp.
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

/// The mesh from which patches are cut in each round. In a round, a face belongs to at most one patch, and so does a
/// vertex. A patch reads and writes only its own faces and vertices.
struct Surface {
  static constexpr std::uint8_t kAlive = 1, kTouched = 2;
  static constexpr std::uint32_t kShared = kNone;

  const TriangleMesh& finest;
  std::vector<Triangle> corners;     ///< by face
  std::vector<std::uint8_t> state;   ///< by face: kAlive and kTouched
  std::vector<Quadric> quadrics;     ///< by vertex, with the vertex as origin, in units of 1 / scale
  std::vector<std::uint32_t> owner;  ///< by vertex: the block with all its faces, or kShared
  std::vector<std::uint32_t> slot;   ///< by vertex: scratch memory of its owner, a number below the number of vertices
  float scale;                       ///< a power of two that makes edges about 1

  [[nodiscard]] Offset scaled(std::uint32_t v) const {
    const std::array<float, 3>& p = finest.positions[v];
    return {p[0] * scale, p[1] * scale, p[2] * scale};
  }
};

/// The unit normal, or zero if the triangle has no area; `length` is set to twice the area.
[[nodiscard]] Offset unit_normal(const std::array<Offset, 3>& triangle, float& length);
/// Adds a plane through a border edge, perpendicular to its only face, so that leaving the border has a cost.
void add_border_plane(Quadric& quadric, const Offset& edge, const Offset& normal);

struct PatchTask {
  std::span<const std::uint32_t> faces;  ///< alive
  std::uint32_t block;                   ///< its number in `Surface::owner`
  std::uint32_t target;                  ///< stop at this many faces
  bool fresh;                            ///< the faces are finest, and their quadrics must be computed
  bool last;  ///< also collapses pairs without edge, and repeats while a collapse makes another one legal
};

class Patch {
 public:
  Patch(Surface& surface, const SimplifyOptions& options);

  /// Takes the faces from the surface, simplifies until `target` are left or no collapse is legal, and returns the rest
  /// to the surface.
  [[nodiscard]] Segment simplify(const PatchTask& task, const std::function<void(double)>& progress = {});

 private:
  static constexpr std::uint32_t kRingCapacity = 128;

  struct Vertex {
    Offset at;
    std::uint32_t star, size, capacity;  // its faces' corners (4 * face + corner), in `corners_`; inner vertices only
    std::uint32_t id;
    bool inner, gone;
  };
  struct Face {
    std::array<std::uint32_t, 3> corner;
    Offset normal;  // of its finest version, or zero
    std::uint32_t id;
    bool alive, touched;
  };
  /// The vertices around u and the graph whose edges are the faces of u.
  enum class Star {
    kDisc,     ///< one closed ring
    kFan,      ///< one open chain: u is on a border
    kPinched,  ///< any other graph without border: sheets that touch in u or along an edge of u
    kLocked,   ///< anything else
  };
  struct Ring {
    std::uint32_t size = 0;
    Star star = Star::kLocked;
    std::array<std::uint32_t, kRingCapacity> vertex;
    std::array<std::uint8_t, kRingCapacity> degree;                 // faces on the edge from u
    std::array<std::array<std::uint8_t, 2>, kRingCapacity> joined;  // the first two faces
  };

  struct Candidate {
    float cost;
    std::uint32_t t;
  };

  void load(const PatchTask& task);
  std::uint32_t local(std::uint32_t vertex, std::uint32_t block);
  void load_normal(Face& face, bool fresh);
  void link_stars();
  void add_border_planes(std::uint32_t v);
  void store();
  void push_all(bool fresh);
  void step(std::uint32_t u);
  void build_ring(std::uint32_t u);
  bool is_connected() const;
  std::uint32_t ring_index(std::uint32_t v);
  std::uint32_t in_ring(std::uint32_t v) const { return ring_place_[v] == 0 ? ring_.size : ring_place_[v] - 1u; }
  void clear_ring();
  void gather_candidates(std::uint32_t u);
  void gather_partners(std::uint32_t u);
  void place_in_grid();
  std::uint32_t grid_place(double x) const;
  static std::uint64_t grid_key(std::uint32_t x, std::uint32_t y, std::uint32_t z);
  bool near(std::uint32_t u, std::uint32_t t) const;
  float cost(std::uint32_t u, std::uint32_t t) const;
  bool legal(std::uint32_t u, std::uint32_t t) const;
  bool keeps_surface(std::uint32_t u, std::uint32_t at) const;
  bool keeps_sheets(std::uint32_t u, std::uint32_t t) const;
  bool keeps_faces(std::uint32_t u, std::uint32_t t) const;
  bool has_face(std::uint32_t u, std::uint32_t a, std::uint32_t b) const;
  bool keeps_shapes(std::uint32_t u, std::uint32_t t) const;
  void collapse(std::uint32_t u, std::uint32_t t);
  void remove_corner(std::uint32_t v, std::uint32_t face);
  void reserve_star(std::uint32_t v, std::uint32_t size);
  std::span<const std::uint32_t> star(std::uint32_t v) const {
    return {corners_.data() + vertices_[v].star, vertices_[v].size};
  }

  Surface& surface_;
  SimplifyOptions options_;
  std::uint32_t living_ = 0;
  std::vector<Vertex> vertices_;
  std::vector<Face> faces_;
  std::vector<Quadric> quadrics_;
  std::vector<std::uint32_t> corners_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> shared_;  // vertex, where in `vertices_`; ascending
  std::vector<std::uint8_t> ring_place_;                         // by vertex: 1 + position in the ring, 0: none
  CostQueue queue_;
  Ring ring_;
  float near2_ = 0;                                            // square of the distance of pairs; 0: none
  double cell_ = 0;                                            // edge of a cell of `grid_`
  std::vector<std::pair<std::uint64_t, std::uint32_t>> grid_;  // cell, inner vertex; only with pairs
  std::vector<Candidate> candidates_;
  Segment out_;
};

}  // namespace tactus::spm::offline
