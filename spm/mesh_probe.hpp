/// A rigid mesh as a probe: finds all pairs of its triangles and shown faces that intersect, with point, normal and
/// depth, or all pairs that are near each other.
///
///   MeshProbe     the mesh and a static 8-wide tree over it; built once, shared
///   PlacedProbe   the probe in one pose in an object's frame, with the memory of a query; one for each user of a probe
///
/// A query walks the AbTree and the probe's tree together. It compares boxes along the axes of both frames, because a
/// long thin part that is slanted fills little of its box in one frame. Then it compares planes, and then decides each
/// remaining pair exactly (triangle_pair.hpp). Each rejection allows for float rounding, so the contacts are those of
/// all pairs of shown faces and placed triangles.
///
/// Model frame and file units of the object; the probe has its own frame and unit.
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

/// A shown face and a triangle of the probe that intersect; point, normal and depth as in PairContact.
struct MeshContact {
  FaceId face{};
  std::uint32_t triangle = 0;  ///< of the probe, in the order of its construction
  bool last = false;           ///< the face's finest version
  Vec3d point, normal;
  double depth = 0;
  RowIndex row{};
};

/// Eight pairs that may be near each other: corners of the shown faces in the model frame, faces and triangles.
struct alignas(64) NearPairs {
  static constexpr std::uint32_t kWidth = TriangleLanes::kWidth;
  TriangleLanes corners;
  std::array<FaceId, kWidth> face;
  std::array<std::uint32_t, kWidth> triangle;  ///< of the probe, in tree order (MeshProbe::corners)
};

/// The result of a query.
struct MeshTouch {
  std::uint32_t contacts = 0;  ///< all contacts or pairs; more than the capacity: truncated
  std::uint32_t work = 0;      ///< pairs of nodes visited and pairs of triangles decided
  bool complete = true;        ///< false: stopped at the work limit; there may be more contacts
};

struct ProbeWalk;

class MeshProbe {
 public:
  static constexpr std::uint32_t kMaxTriangles = 1u << 18;

  /// Copies. Corners should be counter-clockwise seen from outside; only drawings depend on it. Not realtime. Throws
  /// std::invalid_argument if there are no or too many triangles, a corner is not a vertex, or a vertex is not finite.
  MeshProbe(std::span<const std::array<float, 3>> vertices, std::span<const std::array<std::uint32_t, 3>> triangles);

  [[nodiscard]] std::uint32_t triangles() const noexcept { return static_cast<std::uint32_t>(corners_.size()); }
  /// Maximum distance of a vertex from the probe's origin.
  [[nodiscard]] double radius() const noexcept { return radius_; }

  /// By axis, padded with zeros to a multiple of eight.
  [[nodiscard]] const std::array<std::vector<double>, 3>& vertices() const noexcept { return vertices_; }
  /// The vertices of a triangle by its number in tree order, and its number at construction.
  [[nodiscard]] const std::array<std::uint32_t, 3>& corners(std::uint32_t in_tree) const noexcept {
    return corners_[in_tree];
  }
  [[nodiscard]] std::uint32_t number(std::uint32_t in_tree) const noexcept { return number_[in_tree]; }
  /// The arguments that construct the same probe again. Allocate.
  [[nodiscard]] std::vector<std::array<float, 3>> given_vertices() const;
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> given_triangles() const;

 private:
  friend class PlacedProbe;
  friend struct ProbeWalk;
  static constexpr int kWidth = 8;
  static constexpr int kMaxHeight = 6;

  /// Existing children come first. Boxes in the probe's frame; [axis][child].
  struct alignas(64) Node {
    float low[3][kWidth], high[3][kWidth];
    float normal[3][kWidth], offset[kWidth];  ///< planes of a leaf's triangles; normal 0: the triangle is too thin
    std::uint32_t child[kWidth];              ///< nodes, or triangles in tree order
    float whole_low[3], whole_high[3];        ///< box of all children
    float size;                               ///< its longest side
    std::uint8_t count;
    bool leaf;
  };

  std::uint32_t build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last, int height,
                      std::span<const std::array<std::uint32_t, 3>> triangles);

  std::array<std::vector<double>, 3> vertices_;        // by axis, padded to a multiple of eight
  std::size_t given_ = 0;                              // vertices without padding
  std::vector<std::array<std::uint32_t, 3>> corners_;  // by triangle in tree order
  std::vector<std::uint32_t> number_;                  // at construction, by the same
  std::vector<Node> nodes_;
  std::uint32_t root_ = 0;
  double radius_ = 0;
};

class PlacedProbe {
 public:
  /// `probe` must outlive it. Allocates. All `simd` give the same bits.
  explicit PlacedProbe(const MeshProbe& probe, Simd simd = best_simd());

  /// Places the probe in the object's frame: scales by `scale` (object units per probe unit), then applies `pose`, a
  /// rotation (to 1e-7) and a translation. Each vertex is (r0 x + r1 y) + r2 z + t, left to right, in double. Realtime.
  void place(const Eigen::Isometry3d& pose, double scale = 1) noexcept;

  /// A triangle in the object's frame.
  [[nodiscard]] Triangle3d triangle(std::uint32_t number) const noexcept;

  /// All intersecting pairs in a fixed order, at most `capacity`. Stops after `max_work`; the result is then not
  /// complete. Realtime.
  MeshTouch touching(const AbTree& tree, MeshContact* out, std::uint32_t capacity,
                     std::uint32_t max_work = 1u << 31) noexcept;

  /// All pairs at most `margin` apart (object units, above 0), in blocks of eight. Also contains pairs that are further
  /// apart but that boxes and planes do not rule out. Stops after `max_work` or `capacity` pairs; the result is then
  /// not complete. Realtime.
  MeshTouch near(const AbTree& tree, double margin, NearPairs* out, std::uint32_t capacity,
                 std::uint32_t max_work = 1u << 31) noexcept;

 private:
  friend struct ProbeWalk;
  void begin_pose() noexcept;
  MeshTouch walk(const AbTree& tree, MeshContact* out, NearPairs* near, std::uint32_t capacity, std::uint32_t max_work,
                 float margin) noexcept;
  static constexpr int kWidth = MeshProbe::kWidth;
  static constexpr int kStack = 64 * (AbTree::kMaxHeight + MeshProbe::kMaxHeight);

  /// A probe node in the object's frame; computed when a query first reaches it in a pose.
  struct alignas(64) Node {
    float low[3][kWidth], high[3][kWidth];
    float normal[3][kWidth], offset[kWidth];
    float corner[3][3][kWidth];  ///< of a leaf's triangles: [corner][axis][triangle]
    float whole_low[3], whole_high[3];
    std::uint32_t pose;  ///< number of the pose for which it was computed
  };
  struct Entry {
    NodeIndex object_node;
    std::uint32_t probe_node;
    float size;  ///< longest side of the object's node
  };

  const MeshProbe& probe_;
  Simd simd_;
  std::uint32_t pose_ = 0;
  float margin_ = 0;  // of the last query
  double scale_ = 1;
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
  Vec3d translation_ = Vec3d::Zero();
  std::array<std::vector<double>, 3> vertices_;  // as placed, by axis
  std::array<std::vector<float>, 3> rounded_;
  std::vector<Node> nodes_;
  std::vector<std::uint32_t> in_tree_;  // number in tree order, by number at construction
  std::vector<Entry> stack_;
  TrianglePairs pairs_{};
  PairContacts found_{};
};

}  // namespace tactus::spm
