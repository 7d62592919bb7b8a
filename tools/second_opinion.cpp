#include "tools/second_opinion.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace tactus::tools {

void SecondOpinion::build() {
  std::vector<spm::fcl::FixedMesh::Position> vertices;
  std::vector<spm::fcl::FixedMesh::Face> faces;
  vertices.reserve(3 * triangles_.size());
  faces.reserve(triangles_.size());
  for (const Corners& triangle : triangles_) {
    const auto first = static_cast<std::uint32_t>(vertices.size());
    faces.push_back({first, first + 1, first + 2});
    for (int i = 0; i < 9; i += 3) vertices.push_back({triangle[i], triangle[i + 1], triangle[i + 2]});
  }
  mesh_.emplace(vertices, faces);
}

SecondOpinion::Answer SecondOpinion::compare(const Point& centre, double radius, double tolerance,
                                             const std::vector<SurfaceGrid::Near>& near) {
  if (!mesh_) build();
  const spm::Vec3d at{centre[0], centre[1], centre[2]};
  mesh_->find_touched_faces(at, radius, touching_);
  std::sort(touching_.begin(), touching_.end());
  std::vector<std::uint32_t> ours;
  for (const SurfaceGrid::Near& triangle : near)
    if (triangle.distance <= radius) ours.push_back(triangle.triangle);

  Answer answer;
  const auto differences = [&](const std::vector<std::uint32_t>& from, const std::vector<std::uint32_t>& without,
                               std::vector<std::uint32_t>& out) {
    std::vector<std::uint32_t> all;
    std::set_difference(from.begin(), from.end(), without.begin(), without.end(), std::back_inserter(all));
    for (const std::uint32_t triangle : all) {
      if (std::abs(distance_to_triangle(centre, triangles_[triangle]) - radius) <= tolerance) {
        ++answer.tangent;
      } else {
        out.push_back(triangle);
      }
    }
  };
  differences(ours, touching_, answer.only_audit);
  differences(touching_, ours, answer.only_fcl);

  const double fcl = mesh_->distance(at);
  if (ours.empty()) {
    if (fcl < radius - tolerance) answer.distance = {std::nullopt, fcl};
    return answer;
  }
  double min = radius;
  for (const SurfaceGrid::Near& triangle : near) min = std::min(min, triangle.distance);
  if (!(std::abs(fcl - min) <= tolerance)) answer.distance = {min, fcl};
  return answer;
}

}  // namespace tactus::tools
