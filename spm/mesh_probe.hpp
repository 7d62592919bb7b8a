/// A rigid mesh as a probe. Queries find all pairs of a probe triangle and a shown face that intersect, with point,
/// normal and depth, or all pairs that are near each other.
///
///   MeshProbe     the mesh and a static 8-wide tree over it; built once and shared
///   PlacedProbe   the probe in one pose in an object's frame, with the memory of a query; each caller has its own
///
/// A query walks the AbTree and the probe's tree together. First it compares boxes along the axes of both frames,
/// because a long slanted part may fill only little of its box in one of the frames. Then it compares planes. Then it
/// decides each remaining pair exactly (triangle_pair.hpp). Every comparison allows for float rounding, so no
/// intersecting pair is missed.
///
/// Results are in the model frame and file units of the object. The probe has its own frame and unit.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/simd.hpp"
#include "spm/triangle_gap.hpp"
#include "spm/triangle_pair.hpp"

namespace tactus::spm {

/// A shown face and a probe triangle that intersect. See PairContact for point, normal and depth.
struct MeshContact {
  FaceId face{};
  std::uint32_t triangle = 0;  ///< number of the probe triangle at construction
  bool is_finest = false;      ///< the face is in its finest version
  Vec3d point, normal;
  double depth = 0;
};

/// Eight pairs of a shown face and a probe triangle that may be near each other.
struct alignas(64) NearPairs {
  static constexpr std::uint32_t kWidth = TriangleLanes::kWidth;
  TriangleLanes corners;  ///< corners of the faces in the model frame
  std::array<FaceId, kWidth> face;
  std::array<std::uint32_t, kWidth> triangle;  ///< tree number of the probe triangle (MeshProbe::corners)
};

/// The result of a query.
struct MeshQueryResult {
  std::uint32_t contacts = 0;  ///< number of contacts or pairs; if it exceeds the capacity, the output is truncated
  std::uint32_t work = 0;      ///< number of visited pairs of nodes and tested pairs of triangles
  bool complete = true;        ///< false if the query stopped at the work limit, so that there may be more contacts
};

struct ProbeWalk;

class MeshProbe {
 public:
  static constexpr std::uint32_t kMaxTriangles = 1u << 18;

  /// Copies the mesh. The corners of a triangle should be counter-clockwise seen from outside; only drawings depend on
  /// this. Not realtime. Throws std::invalid_argument if there are no or more than kMaxTriangles triangles, a corner is
  /// not a vertex, or a vertex is not finite.
  MeshProbe(std::span<const std::array<float, 3>> vertices, std::span<const std::array<std::uint32_t, 3>> triangles);

  [[nodiscard]] std::uint32_t triangles() const noexcept { return static_cast<std::uint32_t>(corners_.size()); }
  /// Maximum distance of a vertex from the probe's origin.
  [[nodiscard]] double radius() const noexcept { return radius_; }

  /// The coordinates of the vertices by axis, padded with zeros to a multiple of eight.
  [[nodiscard]] const std::array<std::vector<double>, 3>& vertices() const noexcept { return vertices_; }
  /// The vertices of a triangle. `tree_number` is the number of the triangle in tree order.
  [[nodiscard]] const std::array<std::uint32_t, 3>& corners(std::uint32_t tree_number) const noexcept {
    return corners_[tree_number];
  }
  /// The number of a triangle at construction.
  [[nodiscard]] std::uint32_t number(std::uint32_t tree_number) const noexcept { return number_[tree_number]; }
  /// The arguments of the constructor. Allocate.
  [[nodiscard]] std::vector<std::array<float, 3>> original_vertices() const;
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> original_triangles() const;

 private:
  friend class PlacedProbe;
  friend struct ProbeWalk;
  static constexpr int kWidth = 8;
  static constexpr int kMaxHeight = 6;

  /// A node of the probe's tree. Arrays are [axis][child]; children that exist come first. Probe's frame.
  struct alignas(64) Node {
    float low[3][kWidth], high[3][kWidth];    ///< boxes of the children
    float normal[3][kWidth], offset[kWidth];  ///< planes of a leaf's triangles; all 0 for a triangle that is too thin
    std::uint32_t child[kWidth];              ///< numbers of nodes; in a leaf, tree numbers of triangles
    float whole_low[3], whole_high[3];        ///< box of all children
    float size;                               ///< longest side of this box
    std::uint8_t count;                       ///< number of children
    bool leaf;
  };

  std::uint32_t build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last, int height,
                      std::span<const std::array<std::uint32_t, 3>> triangles);

  std::array<std::vector<double>, 3> vertices_;        // by axis, padded to a multiple of eight
  std::size_t vertex_count_ = 0;                       // number of vertices without padding
  std::vector<std::array<std::uint32_t, 3>> corners_;  // vertices of each triangle, by its tree number
  std::vector<std::uint32_t> number_;                  // number at construction, by tree number
  std::vector<Node> nodes_;
  std::uint32_t root_ = 0;
  double radius_ = 0;
};

class PlacedProbe {
 public:
  /// `probe` must outlive the object. Allocates. Every `simd` gives the same bits.
  explicit PlacedProbe(const MeshProbe& probe, Simd simd = best_simd());

  /// Places the probe in the object's frame: scales by `scale` (object units per probe unit), then applies `pose`,
  /// whose linear part must be a rotation up to 1e-7. Each coordinate is computed in double as ((r0 x + r1 y) + r2 z) +
  /// t, in this order: t is the translation on this axis, and r0, r1, r2 are `scale` times a row of the rotation.
  /// Realtime.
  void set_pose(const Eigen::Isometry3d& pose, double scale = 1) noexcept;

  /// A triangle in the object's frame, by its number at construction.
  [[nodiscard]] Triangle3d triangle(std::uint32_t number) const noexcept;

  /// Writes a contact for each intersecting pair, in a fixed order, at most `capacity`. Stops when the work reaches
  /// `max_work`; the result is then not complete. Realtime.
  MeshQueryResult find_contacts(const AbTree& tree, MeshContact* out, std::uint32_t capacity,
                                std::uint32_t max_work = 1u << 31) noexcept;

  /// Writes all pairs at most `margin` apart (object units, above 0), in blocks of eight. Also writes pairs that are
  /// further apart if the tests of boxes and planes cannot exclude them. Stops when the work reaches `max_work`; the
  /// result is then not complete. Also stops when there are more than `capacity` pairs. Realtime.
  MeshQueryResult find_near_pairs(const AbTree& tree, double margin, NearPairs* out, std::uint32_t capacity,
                                  std::uint32_t max_work = 1u << 31) noexcept;

 private:
  friend struct ProbeWalk;
  void begin_pose() noexcept;
  MeshQueryResult walk(const AbTree& tree, MeshContact* out, NearPairs* near, std::uint32_t capacity,
                       std::uint32_t max_work, float margin) noexcept;
  static constexpr int kWidth = MeshProbe::kWidth;
  static constexpr int kStack = 64 * (AbTree::kMaxHeight + MeshProbe::kMaxHeight);

  /// A probe node in the object's frame. It is computed when a query first reaches the node in a pose.
  struct alignas(64) Node {
    float low[3][kWidth], high[3][kWidth];
    float normal[3][kWidth], offset[kWidth];
    float corner[3][3][kWidth];  ///< corners of a leaf's triangles: [corner][axis][triangle]
    float whole_low[3], whole_high[3];
    std::uint32_t pose;  ///< PlacedProbe::pose_ when the node was computed
  };
  struct Entry {
    NodeIndex object_node;
    std::uint32_t probe_node;
    float size;  ///< longest side of the object's node
  };

  const MeshProbe& probe_;
  Simd simd_;
  std::uint32_t pose_ = 0;  // number of the pose; changes when placed nodes become invalid
  float margin_ = 0;        // margin of the last query
  double scale_ = 1;
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
  Vec3d translation_ = Vec3d::Zero();
  std::array<std::vector<double>, 3> vertices_;  // as placed, by axis
  std::array<std::vector<float>, 3> rounded_;
  std::vector<Node> nodes_;
  std::vector<std::uint32_t> tree_number_;  // by number at construction
  std::vector<Entry> stack_;
  TrianglePairs pairs_{};
  PairContacts found_{};
};

}  // namespace tactus::spm
