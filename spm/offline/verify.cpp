#include "spm/offline/verify.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "spm/offline/clean.hpp"
#include "spm/offline/partition.hpp"
#include "spm/offline/snap.hpp"
#include "spm/region_grid.hpp"

namespace tactus::spm::offline {
namespace {

constexpr std::size_t kMaxMismatches = 10;

/// An oriented triangle as the bits of its corner positions, the corner with the smallest bits first.
using FaceBits = std::array<std::array<std::uint32_t, 3>, 3>;

FaceBits bits_of(std::span<const std::array<float, 3>> positions, const Triangle& face) {
  FaceBits bits;
  for (std::size_t k = 0; k < 3; ++k) std::memcpy(&bits[k], &positions[face[k]], sizeof bits[k]);
  std::rotate(bits.begin(), std::min_element(bits.begin(), bits.end()), bits.end());
  return bits;
}

std::vector<FaceBits> sorted_bits(std::span<const std::array<float, 3>> positions, const std::vector<Triangle>& faces) {
  std::vector<FaceBits> all;
  all.reserve(faces.size());
  for (const Triangle& face : faces) all.push_back(bits_of(positions, face));
  std::sort(all.begin(), all.end());
  return all;
}

Vec3d point(std::span<const std::array<float, 3>> positions, std::uint32_t v) {
  return {positions[v][0], positions[v][1], positions[v][2]};
}

/// The active mesh of a model of which at most one region is refined. `undo` costs as much as `apply`.
class MeshWithOneRegion {
 public:
  explicit MeshWithOneRegion(const Model& model) : model_{model}, corners_{model.summary.faces, {kNone, kNone, kNone}} {
    for (const BaseFace& face : model.base_faces) corners_[face.face] = face.corners;
  }

  void apply(RegionId region) {
    for (const Interval& interval : model_.intervals_of(region)) {
      for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) split(RecordId{r});
    }
  }
  void undo() {
    for (auto change = changes_.rbegin(); change != changes_.rend(); ++change) corners_[change->face] = change->corners;
    changes_.clear();
  }
  [[nodiscard]] bool is_finest(std::uint32_t face, const Triangle& finest) const {
    const auto& [a, b, c] = corners_[FaceId{face}];
    return Triangle{index(a), index(b), index(c)} == finest;
  }

 private:
  struct PreviousVersion {
    FaceId face;
    std::array<VertexId, 3> corners;
  };

  void split(RecordId record) {
    const VertexId u = model_.vertex_of(record);
    for_each_change(
        model_.parts, PartIndex{index(record)}, u,
        [&](DeformedRef ref) {
          changes_.push_back({ref.face(), corners_[ref.face()]});
          corners_[ref.face()][ref.corner()] = u;
        },
        [&](BornRef ref, const std::array<VertexId, 3>& corners, PartIndex, std::uint32_t) {
          changes_.push_back({ref.face(), corners_[ref.face()]});
          corners_[ref.face()] = corners;
        });
  }

  const Model& model_;
  ModelCorners corners_;
  std::vector<PreviousVersion> changes_;  // previous versions of changed faces, in order
};

class Verifier {
 public:
  Verifier(const Model& model, const TriangleMesh& original, const std::function<void(double)>& progress)
      : model_{model}, original_{original}, progress_{progress}, finest_{finest_faces(model)} {}

  Verification run() {
    out_.faces = static_cast<std::uint32_t>(original_.faces.size());
    compare_finest_meshes();
    if (out_.mismatches.empty()) compare_regions();
    return std::move(out_);
  }

 private:
  void add_mismatch(const std::string& text) {
    if (out_.mismatches.size() < kMaxMismatches) out_.mismatches.push_back(text);
  }

  void compare_finest_meshes() {
    const std::vector<FaceBits> expected = sorted_bits(original_.positions, original_.faces);
    const std::vector<FaceBits> found = sorted_bits(model_.positions, finest_);
    if (expected == found) return;
    std::vector<FaceBits> missing, extra;
    std::set_difference(expected.begin(), expected.end(), found.begin(), found.end(), std::back_inserter(missing));
    std::set_difference(found.begin(), found.end(), expected.begin(), expected.end(), std::back_inserter(extra));
    add_mismatch("finest mesh: " + std::to_string(missing.size()) + " of " + std::to_string(expected.size()) +
                 " faces of the original are missing, " + std::to_string(extra.size()) +
                 " faces are not in the original");
  }

  /// Compares with the finest faces of the model, which compare_finest_meshes() has found equal to those of the
  /// original.
  void compare_regions() {
    const RegionGrid grid{model_.summary.grid, model_.regions};
    const double rounding = 1e-9 * model_.summary.grid.cell_size;
    const std::vector<std::uint32_t> by_x = faces_by_x();
    MeshWithOneRegion mesh{model_};
    std::vector<bool> covered(std::size_t{4} * finest_.size(), false);  // by face: its corners and centre
    for (std::uint32_t i = 0; i < grid.size(); ++i) {
      if (progress_ && i % 64 == 0) progress_(double(i) / grid.size());
      const CellBox& box = grid.box(RegionId{i});
      mesh.apply(RegionId{i});
      const auto first = std::lower_bound(by_x.begin(), by_x.end(), box.low[0] - max_extent_x_,
                                          [this](std::uint32_t f, double x) { return low_x(f) < x; });
      for (auto at = first; at != by_x.end() && low_x(*at) <= box.high[0]; ++at) {
        const std::array<Vec3d, 3> t = triangle(*at);
        if (!triangle_intersects_cube(t, (box.low + box.high) / 2, (box.high - box.low).maxCoeff() / 2)) continue;
        ++out_.faces_in_regions;
        if (!mesh.is_finest(*at, finest_[*at])) {
          add_mismatch("region " + std::to_string(i) + ": face " + std::to_string(*at) +
                       " is not in its finest version");
        }
        for (std::size_t k = 0; k < 4; ++k) {
          const Vec3d point = k < 3 ? t[k] : Vec3d{(t[0] + t[1] + t[2]) / 3};
          if (grid.squared_distance(RegionId{i}, point) <= rounding * rounding) covered[4 * *at + k] = true;
        }
      }
      mesh.undo();
      ++out_.regions;
    }
    for (std::size_t i = 0; i < covered.size(); ++i) {
      if (!covered[i])
        add_mismatch("face " + std::to_string(i / 4) +
                     ": a corner or its centre lies in no occupied subcell of a labelled cell");
    }
  }

  std::array<Vec3d, 3> triangle(std::uint32_t f) const {
    return {point(model_.positions, finest_[f][0]), point(model_.positions, finest_[f][1]),
            point(model_.positions, finest_[f][2])};
  }
  double low_x(std::uint32_t f) const {
    const Triangle& t = finest_[f];
    return std::min({model_.positions[t[0]][0], model_.positions[t[1]][0], model_.positions[t[2]][0]});
  }

  std::vector<std::uint32_t> faces_by_x() {
    std::vector<std::uint32_t> order(finest_.size());
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(), [this](std::uint32_t a, std::uint32_t b) { return low_x(a) < low_x(b); });
    for (const Triangle& t : finest_) {
      for (std::size_t k = 0; k < 3; ++k) {
        max_extent_x_ = std::max(
            max_extent_x_, std::abs(double{model_.positions[t[k]][0]} - double{model_.positions[t[(k + 1) % 3]][0]}));
      }
    }
    return order;
  }

  const Model& model_;
  const TriangleMesh& original_;
  const std::function<void(double)>& progress_;
  std::vector<Triangle> finest_;
  double max_extent_x_ = 0;  // maximum extent of a face in x
  Verification out_;
};

}  // namespace

Verification verify(const Model& model, TriangleMesh original, const std::function<void(double)>& progress) {
  clean(original);
  if (model.summary.position_step > 0) snap(original, model.summary.position_step);
  return Verifier{model, original, progress}.run();
}

}  // namespace tactus::spm::offline
