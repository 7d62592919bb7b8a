#include "study/full_mesh.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::study {

using spm::Vec3d;

FullMesh::FullMesh(std::span<const std::array<float, 3>> vertices, std::span<const std::array<std::uint32_t, 3>> faces,
                   const hrtc_service::Placement& placement, double cell_size)
    : placement_{placement}, vertices_{vertices}, faces_{faces}, cell_size_{cell_size / placement.scale()} {
  Vec3d low = Vec3d::Constant(1e30), high = Vec3d::Constant(-1e30);
  for (const std::array<float, 3>& v : vertices) {
    low = low.cwiseMin(Vec3d{v[0], v[1], v[2]});
    high = high.cwiseMax(Vec3d{v[0], v[1], v[2]});
  }
  origin_ = low;
  for (int axis = 0; axis < 3; ++axis)
    size_[axis] = static_cast<std::int32_t>((high[axis] - low[axis]) / cell_size_) + 1;
  starts_.assign(std::size_t(size_[0]) * size_[1] * size_[2] + 1, 0);
  const auto each_cell = [&](std::uint32_t face, auto&& visit) {
    const auto [a, b, c] = corners(face);
    const GridCell first = cell_of(a.cwiseMin(b).cwiseMin(c)), last = cell_of(a.cwiseMax(b).cwiseMax(c));
    for (std::int32_t z = first[2]; z <= last[2]; ++z)
      for (std::int32_t y = first[1]; y <= last[1]; ++y)
        for (std::int32_t x = first[0]; x <= last[0]; ++x) visit((std::size_t(z) * size_[1] + y) * size_[0] + x);
  };
  for (std::uint32_t face = 0; face < faces.size(); ++face) each_cell(face, [&](std::size_t at) { ++starts_[at + 1]; });
  for (std::size_t i = 1; i < starts_.size(); ++i) starts_[i] += starts_[i - 1];
  entries_.resize(starts_.back());
  std::vector<std::uint32_t> next{starts_.begin(), starts_.end() - 1};
  for (std::uint32_t face = 0; face < faces.size(); ++face)
    each_cell(face, [&](std::size_t at) { entries_[next[at]++] = {face, box_of(face)}; });
}

FullMesh::GridCell FullMesh::cell_of(const Vec3d& p) const noexcept {
  GridCell cell;
  for (int axis = 0; axis < 3; ++axis)
    cell[axis] = static_cast<std::int32_t>(
        std::clamp(std::floor((p[axis] - origin_[axis]) / cell_size_), 0.0, double(size_[axis] - 1)));
  return cell;
}

spm::CellBox FullMesh::box_of(std::uint32_t face) const noexcept {
  const auto [a, b, c] = corners(face);
  return {a.cwiseMin(b).cwiseMin(c), a.cwiseMax(b).cwiseMax(c)};
}

FullMesh::Corners FullMesh::corners(std::uint32_t face) const noexcept {
  const auto corner = [&](int i) {
    const std::array<float, 3>& v = vertices_[faces_[face][i]];
    return Vec3d{v[0], v[1], v[2]};
  };
  return {corner(0), corner(1), corner(2)};
}

template <class Visit>
void FullMesh::for_each_near(const Vec3d& middle, const double& reach, Visit&& visit) const noexcept {
  const GridCell first = cell_of(middle.array() - reach), last = cell_of(middle.array() + reach);
  for (std::int32_t z = first[2]; z <= last[2]; ++z)
    for (std::int32_t y = first[1]; y <= last[1]; ++y)
      for (std::int32_t x = first[0]; x <= last[0]; ++x) {
        const std::size_t at = (std::size_t(z) * size_[1] + y) * size_[0] + x;
        for (std::uint32_t i = starts_[at]; i < starts_[at + 1]; ++i) {
          const Entry& entry = entries_[i];
          if (entry.box.squared_distance(middle) > reach * reach) continue;
          const GridCell home = cell_of(entry.box.low);  // visits a face of several cells only once
          if (std::max(home[0], first[0]) != x || std::max(home[1], first[1]) != y || std::max(home[2], first[2]) != z)
            continue;
          visit(entry);
        }
      }
}

bool FullMesh::sweep(const Vec3d& from, const Vec3d& to, double radius, haptics::SurfaceHit& hit) noexcept {
  const Vec3d start = placement_.to_model(from), end = placement_.to_model(to);
  const double reach = radius / placement_.scale();
  haptics::FirstTouch first{start, end, reach};
  const double grown = (reach + (end - start).norm() / 2) * (1 + 1e-6) + 1e-9 * start.cwiseAbs().maxCoeff();
  const double slack = grown - reach - (end - start).norm() / 2;
  for_each_near((start + end) / 2, grown, [&](const Entry& entry) {
    // A face farther than `max` from the start cannot be touched before the earliest contact found so far.
    const double max = reach + slack + first.time() * (end - start).norm();
    if (entry.box.squared_distance(start) > max * max) return;
    const auto [a, b, c] = corners(entry.face);
    first.add_triangle(a, b, c, 0, entry.face);
  });
  if (!first.result(hit)) return false;
  hit.point = placement_.to_world(hit.point);
  hit.normal = placement_.direction_to_world(hit.normal);
  return true;
}

bool FullMesh::closest(const Vec3d& point, double within, haptics::SurfaceHit& hit) const noexcept {
  constexpr double kTolerance = 1e-6;  // relative
  const Vec3d centre = placement_.to_model(point);
  const double max = within / placement_.scale() * (1 + kTolerance);
  // ClosestSide sums the normals of the faces that share the closest point. The order of the faces decides the
  // rounding, so they are sorted by id.
  std::vector<std::pair<std::uint32_t, Corners>> found;
  for (double start = cell_size_ / 4; found.empty(); start *= 2) {
    double reach = std::min(start, max);
    for_each_near(centre, reach, [&](const Entry& entry) {
      const Corners at = corners(entry.face);
      const double distance = std::sqrt(spm::closest_point(centre, at.a, at.b, at.c).squared_distance);
      if (distance > reach) return;
      reach = std::min(reach, distance * (1 + kTolerance));
      found.push_back({entry.face, at});
    });
    if (start >= max) break;
  }
  std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  haptics::ClosestSide side{point, within};
  for (const auto& [face, at] : found)
    side.add_triangle(placement_.to_world(at.a), placement_.to_world(at.b), placement_.to_world(at.c), 0, face);
  return side.result(hit);
}

}  // namespace tactus::study
