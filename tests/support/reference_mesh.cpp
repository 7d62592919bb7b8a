#include "tests/support/reference_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstring>
#include <map>
#include <set>
#include <utility>

namespace tactus::test_support {
namespace {

constexpr std::array<std::uint32_t, 3> kNoCorners{spm::kNone, spm::kNone, spm::kNone};

Eigen::Vector3d normal(std::span<const std::array<float, 3>> positions, const std::array<std::uint32_t, 3>& face) {
  const auto corner = [&](std::size_t k) {
    const std::array<float, 3>& p = positions[face[k]];
    return Eigen::Vector3d{p[0], p[1], p[2]};
  };
  return (corner(1) - corner(0)).cross(corner(2) - corner(0));
}

}  // namespace

ReferenceMesh::ReferenceMesh(const spm::Model& model)
    : model_{model},
      active_(model.summary.vertices, false),
      shown_(model.summary.faces, false),
      finest_(model.summary.faces, false),
      corners_(model.summary.faces, kNoCorners) {
  std::fill_n(active_.begin(), model.summary.base_vertices, true);
  for (const spm::BaseFace& f : model.base_faces) {
    shown_[index(f.face)] = true;
    finest_[index(f.face)] = f.finest != 0;
    for (std::size_t k = 0; k < 3; ++k) corners_[index(f.face)][k] = index(f.corners[k]);
  }
  std::vector<std::array<std::uint32_t, 3>> corners = corners_;
  for (std::uint32_t r = 0; r < model.summary.records; ++r) {
    const std::uint32_t u = model.summary.base_vertices + r;
    std::vector<FaceChange>& changes = changes_.emplace_back();
    for (spm::PartIndex p{r}; p != spm::kNone; p = model.parts[p].next) {
      const spm::RecordPart& part = model.parts[p];
      for (std::size_t i = 0; i < part.born_count; ++i) {
        // The new vertex u is at corner 0. The parent is at the corner after u if the order is 0, and at the corner
        // before u if the order is 1. Vertex x is at the third corner.
        const spm::BornRef born = part.born[i];
        const std::uint32_t x = index(part.born_x[i]), face = index(born.face());
        std::array<std::uint32_t, 3> after{u, x, x};
        after[born.order() == 0 ? 1 : 2] = index(part.parent);
        changes.push_back({face, corners[face], after, born.is_finest()});
      }
      for (std::uint32_t i = 0; i < part.deformed_count; ++i) {
        const spm::DeformedRef deformed = part.deformed(i);
        const std::uint32_t face = index(deformed.face());
        std::array<std::uint32_t, 3> after = corners[face];
        after[deformed.corner()] = u;
        changes.push_back({face, corners[face], after, deformed.is_finest()});
      }
    }
    for (const FaceChange& change : changes) corners[change.face] = change.after;
  }
}

bool ReferenceMesh::apply(std::uint32_t record) {
  const std::uint32_t u = model_.summary.base_vertices + record;
  if (active_[u]) return false;
  for (const FaceChange& change : changes_[record]) {
    if (corners_[change.face] != change.before || shown_[change.face] != (change.before != kNoCorners)) return false;
    for (const std::uint32_t v : change.after) {
      if (v != u && !active_[v]) return false;
    }
  }
  for (const FaceChange& change : changes_[record]) {
    shown_[change.face] = true;
    finest_[change.face] = change.becomes_finest;
    corners_[change.face] = change.after;
  }
  active_[u] = true;
  return true;
}

bool ReferenceMesh::apply_region(std::uint32_t region) {
  for (const spm::Interval& interval : model_.intervals_of(spm::RegionId{region})) {
    for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) {
      if (!applied(r) && !apply(r)) return false;
    }
  }
  return true;
}

std::vector<std::string> ReferenceMesh::defects(const std::vector<std::array<std::uint32_t, 3>>& finest,
                                                bool manifold) const {
  std::vector<std::string> found;
  std::set<std::array<std::uint32_t, 3>> seen, seen_finest;
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> faces_of_edge;
  for (std::uint32_t f = 0; f < shown_.size(); ++f) {
    if (!shown_[f]) continue;
    const std::string name = "face " + std::to_string(f);
    const std::array<std::uint32_t, 3>& c = corners_[f];
    for (std::size_t k = 0; k < 3; ++k) {
      if (!active_[c[k]]) found.push_back(name + ": corner " + std::to_string(c[k]) + " is not active");
      if (c[k] == c[(k + 1) % 3]) found.push_back(name + ": has a corner twice");
      ++faces_of_edge[std::minmax(c[k], c[(k + 1) % 3])];
    }
    // Two faces may have the same three vertices if they also share their vertices in the finest mesh, as in a
    // two-sided sheet.
    std::array<std::uint32_t, 3> vertices = c, finest_vertices = finest[f];
    std::sort(vertices.begin(), vertices.end());
    std::sort(finest_vertices.begin(), finest_vertices.end());
    const bool repeats_in_finest = !seen_finest.insert(finest_vertices).second;
    if (!seen.insert(vertices).second && !repeats_in_finest)
      found.push_back(name + ": has the vertices of another face");
    if (normal(model_.positions, c).dot(normal(model_.positions, finest[f])) <= 0) {
      found.push_back(name + ": is turned over");
    }
  }
  for (const auto& [edge, count] : faces_of_edge) {
    if (manifold && count > 2) {
      found.push_back("edge " + std::to_string(edge.first) + " " + std::to_string(edge.second) + ": has " +
                      std::to_string(count) + " faces");
    }
  }
  return found;
}

std::vector<FaceBits> sorted_faces(std::span<const std::array<float, 3>> positions,
                                   const std::vector<std::array<std::uint32_t, 3>>& faces) {
  std::vector<FaceBits> sorted;
  for (const std::array<std::uint32_t, 3>& face : faces) {
    FaceBits bits;
    for (std::size_t k = 0; k < 3; ++k) std::memcpy(&bits[k], &positions[face[k]], sizeof bits[k]);
    std::rotate(bits.begin(), std::min_element(bits.begin(), bits.end()), bits.end());
    sorted.push_back(bits);
  }
  std::sort(sorted.begin(), sorted.end());
  return sorted;
}

}  // namespace tactus::test_support
