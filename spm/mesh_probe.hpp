/// A rigid mesh as a probe: all pairs of its triangles and shown faces that meet, with point, normal and depth; or all
/// that are near each other.
///
///   MeshProbe     the mesh and a static 8-wide tree over it, built once at start; shared by whoever uses it
///   PlacedProbe   the same in one pose in one object's frame, and the room a query works in; one for each user of it
///
/// The query goes down AbTree and probe tree together. Boxes are compared along the axes of both frames, so that a long
/// thin part at a slant is not taken for all the space around it; then planes; then each pair left is decided exactly
/// (triangle_pair.hpp). What is pruned is pruned with room for float rounding: the contacts are those of all pairs of
/// shown faces and placed triangles, one by one.
///
/// Object's model frame and file units; the probe in a frame and unit of its own.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/simd.hpp"
#include "spm/span.hpp"
#include "spm/triangle_gap.hpp"
#include "spm/triangle_pair.hpp"

namespace tactus::spm {

/// A shown face and a triangle of the probe that meet; point, normal and depth as in PairContact.
struct MeshContact {
  FaceId face{};
  std::uint32_t triangle = 0;  ///< of the probe, as numbered when it was made
  bool last = false;           ///< the face's finest version
  Vec3d point, normal;
  double depth = 0;
  std::uint32_t row = 0;  ///< face row
};

/// Eight pairs that may be near each other: the shown faces' corners, model frame, and which they are.
struct alignas(64) NearPairs {
  static constexpr std::uint32_t kWidth = TriangleLanes::kWidth;
  TriangleLanes face;
  std::array<std::uint32_t, kWidth> face_id;   ///< FaceId
  std::array<std::uint32_t, kWidth> triangle;  ///< of the probe, in tree order (MeshProbe::corners)
};

/// What a query came to.
struct MeshTouch {
  std::uint32_t contacts = 0;  ///< in all, or pairs; more than the capacity: truncated
  std::uint32_t work = 0;      ///< pairs of nodes visited and pairs of triangles decided
  bool complete = true;        ///< false: stopped at the limit of work, more may meet
};

struct ProbeWalk;

class MeshProbe {
 public:
  static constexpr std::uint32_t kMaxTriangles = 1u << 18;

  /// Copies. Corners counter-clockwise seen from outside, though nothing but a picture depends on it. Not realtime.
  /// Throws std::invalid_argument when there is no triangle or too many, a corner is no vertex or a vertex not finite.
  MeshProbe(Span<const std::array<float, 3>> vertices, Span<const std::array<std::uint32_t, 3>> triangles);

  [[nodiscard]] std::uint32_t triangles() const noexcept { return static_cast<std::uint32_t>(corners_.size()); }
  /// Greatest distance of a vertex from the probe's origin.
  [[nodiscard]] double radius() const noexcept { return radius_; }

  /// By axis, filled up with zeros to whole vectors of eight.
  [[nodiscard]] const std::array<std::vector<double>, 3>& vertices() const noexcept { return vertices_; }
  /// Vertices of a triangle, in tree order; and its number as it was given.
  [[nodiscard]] const std::array<std::uint32_t, 3>& corners(std::uint32_t in_tree) const noexcept {
    return corners_[in_tree];
  }
  [[nodiscard]] std::uint32_t number(std::uint32_t in_tree) const noexcept { return number_[in_tree]; }
  /// What makes the same probe again. Allocate.
  [[nodiscard]] std::vector<std::array<float, 3>> given_vertices() const;
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> given_triangles() const;

 private:
  friend class PlacedProbe;
  friend struct ProbeWalk;
  static constexpr int kWidth = 8;
  static constexpr int kMaxHeight = 6;

  /// Children that are there come first. Boxes in the probe's frame; [axis][child].
  struct alignas(64) Node {
    float low[3][kWidth], high[3][kWidth];
    float normal[3][kWidth], offset[kWidth];  ///< of a leaf's triangles; normal 0: too thin to have one
    std::uint32_t child[kWidth];              ///< nodes, or triangles in tree order
    float whole_low[3], whole_high[3];        ///< box of all children
    float size;                               ///< its longest side
    std::uint8_t count;
    bool leaf;
  };

  std::uint32_t build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last, int height,
                      Span<const std::array<std::uint32_t, 3>> triangles);

  std::array<std::vector<double>, 3> vertices_;        // by axis, filled up to whole vectors
  std::size_t given_ = 0;                              // of these
  std::vector<std::array<std::uint32_t, 3>> corners_;  // by triangle in tree order
  std::vector<std::uint32_t> number_;                  // as given, by the same
  std::vector<Node> nodes_;
  std::uint32_t root_ = 0;
  double radius_ = 0;
};

class PlacedProbe {
 public:
  /// `probe` must outlive it. Allocates. Every `simd` that the processor has gives the same bits.
  explicit PlacedProbe(const MeshProbe& probe, Simd simd = best_simd());

  /// Takes probe coordinates to object coordinates by `pose`, a rotation (to 1e-7) and a translation, after `scale`:
  /// object units in a probe unit. Each vertex is rounded to double once, (r0 x + r1 y) + r2 z + t from left to right.
  /// Realtime.
  void place(const Eigen::Isometry3d& pose, double scale = 1) noexcept;

  /// A triangle as placed.
  [[nodiscard]] Triangle3d triangle(std::uint32_t number) const noexcept;

  /// All pairs that meet, in a fixed order (that of the trees), at most `capacity` of them. Stops after `max_work`
  /// and says so. Realtime.
  MeshTouch touching(const AbTree& tree, MeshContact* out, std::uint32_t capacity,
                     std::uint32_t max_work = 1u << 31) noexcept;

  /// Eight by eight, all pairs that are at most `margin` apart (object units, above 0) and others whose boxes and
  /// planes do not tell that they are further: `contacts` of them, as many as `capacity` has room for. Stops after
  /// `max_work` or when full, and says so. Realtime.
  MeshTouch near(const AbTree& tree, double margin, NearPairs* out, std::uint32_t capacity,
                 std::uint32_t max_work = 1u << 31) noexcept;

 private:
  friend struct ProbeWalk;
  void begin_pose() noexcept;
  MeshTouch walk(const AbTree& tree, MeshContact* out, NearPairs* near, std::uint32_t capacity, std::uint32_t max_work,
                 float margin) noexcept;
  static constexpr int kWidth = MeshProbe::kWidth;
  static constexpr int kStack = 64 * (AbTree::kMaxHeight + MeshProbe::kMaxHeight);

  /// What a query needs of a probe's node in the object's frame; made when first met under a pose.
  struct alignas(64) Node {
    float low[3][kWidth], high[3][kWidth];
    float normal[3][kWidth], offset[kWidth];
    float corner[3][3][kWidth];  ///< of a leaf's triangles: [corner][axis][triangle]
    float whole_low[3], whole_high[3];
    std::uint32_t pose;  ///< number of the pose it was made for
  };
  struct Entry {
    std::uint32_t object_node, probe_node;
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
  std::vector<std::uint32_t> in_tree_;  // place in tree order, by triangle as given
  std::vector<Entry> stack_;
  TrianglePairs pairs_{};
  PairContacts found_{};
};

}  // namespace tactus::spm
