/// Makes tools and objects of few triangles, and counts their intersecting triangle pairs by brute force.
#pragma once

#include <vector>

#include "haptics/tool.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/shown_mesh.hpp"

namespace tactus::haptics::testing {

using spm::offline::TriangleMesh;

inline void add_quad(TriangleMesh& mesh, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (const Vec3d& p : {a, b, c, d})
    mesh.positions.push_back({static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
  mesh.faces.push_back({first, first + 1, first + 2});
  mesh.faces.push_back({first, first + 2, first + 3});
}

/// `inwards`: normals point into the box, as for a cavity.
inline void add_box(TriangleMesh& mesh, const Vec3d& low, const Vec3d& high, bool inwards = false) {
  for (int axis = 0; axis < 3; ++axis)
    for (const bool top : {false, true}) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      std::array<Vec3d, 4> corners;
      for (int k = 0; k < 4; ++k) {
        corners[k][axis] = top ? high[axis] : low[axis];
        corners[k][u] = k == 1 || k == 2 ? high[u] : low[u];
        corners[k][v] = k >= 2 ? high[v] : low[v];
      }
      if (top != inwards)
        add_quad(mesh, corners[0], corners[1], corners[2], corners[3]);
      else
        add_quad(mesh, corners[3], corners[2], corners[1], corners[0]);
    }
}

inline TriangleMesh box_mesh(const Vec3d& low, const Vec3d& high, bool inwards = false) {
  TriangleMesh mesh;
  add_box(mesh, low, high, inwards);
  return mesh;
}

/// A square with edges of 2 `half` at z = `height`, facing up, in `parts` x `parts` squares of two triangles.
inline TriangleMesh sheet(double half, double height, int parts = 1) {
  TriangleMesh mesh;
  const auto coordinate = [&](int i) { return half * (2.0 * i / parts - 1); };
  for (int i = 0; i < parts; ++i)
    for (int j = 0; j < parts; ++j)
      add_quad(mesh, {coordinate(i), coordinate(j), height}, {coordinate(i + 1), coordinate(j), height},
               {coordinate(i + 1), coordinate(j + 1), height}, {coordinate(i), coordinate(j + 1), height});
  return mesh;
}

/// An object for a tool: a mesh in metres, in the world frame.
inline ToolObject object_of(const test_support::ShownMesh& shown, double friction = 0) {
  ToolObject object;
  object.tree = &shown.tree();
  object.friction = friction;
  return object;
}

/// Number of intersecting pairs of a triangle of `mesh` and a triangle of `tool`, by exact tests of all pairs.
inline std::size_t count_intersections(const TriangleMesh& mesh, const TriangleMesh& tool, const ToolPose& pose) {
  const auto triangle_of = [](const TriangleMesh& source, std::size_t f) {
    spm::Triangle3d t;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& p = source.positions[source.faces[f][i]];
      t[i] = {p[0], p[1], p[2]};
    }
    return t;
  };
  std::vector<spm::Triangle3d> tool_triangles;
  for (std::size_t f = 0; f < tool.faces.size(); ++f) {
    tool_triangles.push_back(triangle_of(tool, f));
    for (Vec3d& p : tool_triangles.back()) p = pose.position + pose.orientation * p;
  }
  Vec3d low = Vec3d::Constant(1e9), high = -low;
  for (const spm::Triangle3d& triangle : tool_triangles)
    for (const Vec3d& p : triangle) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  std::size_t intersections = 0;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const spm::Triangle3d face = triangle_of(mesh, f);
    const Vec3d face_low = face[0].cwiseMin(face[1]).cwiseMin(face[2]);
    const Vec3d face_high = face[0].cwiseMax(face[1]).cwiseMax(face[2]);
    if ((face_low.array() > high.array()).any() || (face_high.array() < low.array()).any()) continue;
    for (const spm::Triangle3d& triangle : tool_triangles) {
      spm::PairContact contact;
      if (spm::intersect(face, triangle, contact)) ++intersections;
    }
  }
  return intersections;
}

}  // namespace tactus::haptics::testing
