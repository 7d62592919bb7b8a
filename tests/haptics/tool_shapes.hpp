/// Tools and surroundings of few triangles, and their intersections by all pairs.
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

/// `inwards`: a room.
inline void add_box(TriangleMesh& mesh, const Vec3d& low, const Vec3d& high, bool inwards = false) {
  for (int axis = 0; axis < 3; ++axis)
    for (const bool top : {false, true}) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      std::array<Vec3d, 4> p;
      for (int k = 0; k < 4; ++k) {
        p[k][axis] = top ? high[axis] : low[axis];
        p[k][u] = k == 1 || k == 2 ? high[u] : low[u];
        p[k][v] = k >= 2 ? high[v] : low[v];
      }
      if (top != inwards)
        add_quad(mesh, p[0], p[1], p[2], p[3]);
      else
        add_quad(mesh, p[3], p[2], p[1], p[0]);
    }
}

inline TriangleMesh box_mesh(const Vec3d& low, const Vec3d& high, bool inwards = false) {
  TriangleMesh mesh;
  add_box(mesh, low, high, inwards);
  return mesh;
}

/// A square of edge 2 `half` at z = `height`, facing up, in `parts` x `parts` squares.
inline TriangleMesh sheet(double half, double height, int parts = 1) {
  TriangleMesh mesh;
  const auto at = [&](int i) { return half * (2.0 * i / parts - 1); };
  for (int i = 0; i < parts; ++i)
    for (int j = 0; j < parts; ++j)
      add_quad(mesh, {at(i), at(j), height}, {at(i + 1), at(j), height}, {at(i + 1), at(j + 1), height},
               {at(i), at(j + 1), height});
  return mesh;
}

/// A mesh in metres, at the origin, as an object for a tool.
inline ToolObject object_of(const test_support::ShownMesh& shown, double friction = 0) {
  ToolObject object;
  object.tree = &shown.tree();
  object.friction = friction;
  return object;
}

/// Number of intersecting pairs of the tool's and the mesh's triangles, by exact tests of all pairs.
inline std::size_t meeting(const TriangleMesh& mesh, const TriangleMesh& tool, const ToolPose& pose) {
  const auto corners = [](const TriangleMesh& of, std::size_t f) {
    spm::Triangle3d t;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& p = of.positions[of.faces[f][i]];
      t[i] = {p[0], p[1], p[2]};
    }
    return t;
  };
  std::vector<spm::Triangle3d> placed;
  for (std::size_t f = 0; f < tool.faces.size(); ++f) {
    placed.push_back(corners(tool, f));
    for (Vec3d& p : placed.back()) p = pose.position + pose.orientation * p;
  }
  Vec3d low = Vec3d::Constant(1e9), high = -low;
  for (const spm::Triangle3d& triangle : placed)
    for (const Vec3d& p : triangle) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  std::size_t count = 0;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const spm::Triangle3d face = corners(mesh, f);
    const Vec3d face_low = face[0].cwiseMin(face[1]).cwiseMin(face[2]);
    const Vec3d face_high = face[0].cwiseMax(face[1]).cwiseMax(face[2]);
    if ((face_low.array() > high.array()).any() || (face_high.array() < low.array()).any()) continue;
    for (const spm::Triangle3d& triangle : placed) {
      spm::PairContact contact;
      if (spm::intersect(face, triangle, contact)) ++count;
    }
  }
  return count;
}

}  // namespace tactus::haptics::testing
