#include "tests/support/mesh_zoo.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <ostream>
#include <random>
#include <utility>

#include "spm/offline/generate.hpp"

namespace tactus::test_support {
namespace {

using spm::offline::Triangle;
using spm::offline::TriangleMesh;
using Point = std::array<float, 3>;

TriangleMesh tetrahedron() {
  return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}};
}

TriangleMesh translated(TriangleMesh mesh, float dx, float dy, float dz) {
  for (Point& p : mesh.positions) p = {p[0] + dx, p[1] + dy, p[2] + dz};
  return mesh;
}

TriangleMesh joined(TriangleMesh a, const TriangleMesh& b) {
  const auto first = static_cast<std::uint32_t>(a.positions.size());
  a.positions.insert(a.positions.end(), b.positions.begin(), b.positions.end());
  for (const Triangle& f : b.faces) a.faces.push_back({f[0] + first, f[1] + first, f[2] + first});
  return a;
}

/// Adds hills, so that any two versions of the surface differ.
TriangleMesh hilly(TriangleMesh patch) {
  for (Point& p : patch.positions) p[2] += 0.8f * std::sin(0.9f * p[0]) * std::cos(0.7f * p[1]);
  return patch;
}

TriangleMesh with_hole(TriangleMesh mesh) {
  TriangleMesh out{mesh.positions, {}};
  for (const Triangle& f : mesh.faces) {
    if (mesh.positions[f[0]][2] < 0.7f) out.faces.push_back(f);
  }
  return out;
}

/// A flat patch with a perpendicular patch (fin) on its middle column, so that each edge of that column has three
/// faces.
TriangleMesh fin() {
  TriangleMesh patch = grid_patch(6, 8);
  TriangleMesh upright = grid_patch(3, 8);
  for (Point& p : upright.positions) p = {3, p[1], p[0]};
  return joined(std::move(patch), upright);
}

/// Two spheres that touch at one vertex.
TriangleMesh bow_tie() {
  const TriangleMesh sphere = icosphere(2);
  Point top = sphere.positions[0];
  TriangleMesh other = sphere;
  for (Point& p : other.positions) {
    for (std::size_t axis = 0; axis < 3; ++axis) p[axis] = 2 * top[axis] - p[axis];
  }
  for (Triangle& f : other.faces) std::swap(f[1], f[2]);
  return joined(sphere, other);
}

/// Two spheres that share one edge, which therefore has four faces.
TriangleMesh pinched_edge() {
  const TriangleMesh sphere = icosphere(2);
  const Triangle face = sphere.faces[0];
  const Point a = sphere.positions[face[0]], b = sphere.positions[face[1]];
  TriangleMesh other = sphere;
  for (Point& p : other.positions) {  // rotates by 180 degrees about the line through a and b
    if (p == a || p == b) continue;
    float along = 0, length2 = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      along += (p[k] - a[k]) * (b[k] - a[k]);
      length2 += (b[k] - a[k]) * (b[k] - a[k]);
    }
    for (std::size_t k = 0; k < 3; ++k) p[k] = 2 * (a[k] + along / length2 * (b[k] - a[k])) - p[k];
  }
  return joined(sphere, other);
}

/// A sphere with pillows on some of its edges, as in meshes from range scans. A pillow is a pair of opposite faces with
/// the same three vertices.
TriangleMesh pillows() {
  TriangleMesh mesh = icosphere(2);
  const std::size_t sphere_faces = mesh.faces.size();
  for (std::size_t i = 0; i < sphere_faces; i += 9) {
    const Triangle f = mesh.faces[i];
    const Point a = mesh.positions[f[0]], b = mesh.positions[f[1]];
    mesh.positions.push_back({0.55f * (a[0] + b[0]), 0.55f * (a[1] + b[1]), 0.55f * (a[2] + b[2])});
    const auto top = static_cast<std::uint32_t>(mesh.positions.size() - 1);
    mesh.faces.push_back({f[0], f[1], top});
    mesh.faces.push_back({f[1], f[0], top});
  }
  return mesh;
}

/// A patch in which the faces of every second row are a thousand times longer than wide.
TriangleMesh slivers() {
  TriangleMesh mesh = grid_patch(24, 12);
  for (Point& p : mesh.positions) {
    const auto row = static_cast<int>(p[1]);
    p[1] = static_cast<float>(row / 2) + 0.001f * static_cast<float>(row % 2);
    p[2] = 0.2f * std::sin(p[0]);
  }
  return mesh;
}

/// Gives every face its own vertices, as in an STL file.
TriangleMesh soup_of(const TriangleMesh& mesh) {
  TriangleMesh soup;
  for (const Triangle& f : mesh.faces) {
    const auto first = static_cast<std::uint32_t>(soup.positions.size());
    for (const std::uint32_t v : f) soup.positions.push_back(mesh.positions[v]);
    soup.faces.push_back({first, first + 1, first + 2});
  }
  return soup;
}

TriangleMesh with_duplicate_faces(TriangleMesh mesh) {
  const std::size_t original_faces = mesh.faces.size();
  for (std::size_t i = 0; i < original_faces; i += 3) {
    const Triangle f = mesh.faces[i];
    mesh.faces.push_back({f[1], f[2], f[0]});
  }
  return mesh;
}

/// Adds three faces without area: one with collinear vertices, one with two corners at one vertex, and one with three
/// corners at one vertex. Also adds a face with a coordinate that is not a number.
TriangleMesh with_degenerate_faces(TriangleMesh mesh) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  const float nan = std::numeric_limits<float>::quiet_NaN();
  mesh.positions.insert(mesh.positions.end(),
                        {{0.1f, 0.3f, 0}, {0.2f, 0.6f, 0}, {0.4f, 1.2f, 0}, {nan, 0, 0}, {-0.0f, 0, 0}});
  mesh.faces.push_back({first, first + 1, first + 2});
  mesh.faces.push_back({0, 0, 1});
  mesh.faces.push_back({first, first, first});
  mesh.faces.push_back({0, 1, first + 3});
  return mesh;
}

/// A sheet that contains each face twice, in opposite orientations. Each inner edge has four faces.
TriangleMesh two_sided() {
  TriangleMesh sheet = hilly(grid_patch(6, 6));
  const std::vector<Triangle> faces = sheet.faces;
  for (const Triangle& f : faces) sheet.faces.push_back({f[0], f[2], f[1]});
  return sheet;
}

/// A disc of a hundred faces around one vertex.
TriangleMesh fan() {
  TriangleMesh mesh;
  mesh.positions.push_back({0, 0, 0.5f});
  for (int i = 0; i < 100; ++i) {
    const float angle = 0.0628318531f * static_cast<float>(i);
    mesh.positions.push_back({std::cos(angle), std::sin(angle), 0});
    const auto border_vertex = static_cast<std::uint32_t>(i + 1);
    mesh.faces.push_back({0, border_vertex, border_vertex % 100 + 1});
  }
  return mesh;
}

/// A Moebius strip. It has only one side, so its faces cannot all have consistent orientations.
TriangleMesh moebius() {
  TriangleMesh mesh;
  constexpr int kRows = 40, kColumns = 4;
  for (int i = 0; i < kRows; ++i) {
    for (int k = 0; k <= kColumns; ++k) {
      const float angle = 6.2831853f * static_cast<float>(i) / kRows;
      const float offset = 0.4f * (static_cast<float>(k) / kColumns - 0.5f);
      const float radius = 1 + offset * std::cos(angle / 2);
      mesh.positions.push_back({radius * std::cos(angle), radius * std::sin(angle), offset * std::sin(angle / 2)});
    }
  }
  const auto vertex_at = [](int i, int k) {
    return static_cast<std::uint32_t>(i < kRows ? i * (kColumns + 1) + k : kColumns - k);
  };
  for (int i = 0; i < kRows; ++i) {
    for (int k = 0; k < kColumns; ++k) {
      mesh.faces.push_back({vertex_at(i, k), vertex_at(i + 1, k), vertex_at(i + 1, k + 1)});
      mesh.faces.push_back({vertex_at(i, k), vertex_at(i + 1, k + 1), vertex_at(i, k + 1)});
    }
  }
  return mesh;
}

/// A sphere with independent noise at each vertex, so that many collapses would turn a face over.
TriangleMesh noisy_sphere() {
  TriangleMesh mesh = icosphere(4);
  std::mt19937 random{7};
  for (Point& p : mesh.positions) {
    const float radius = 1 + 0.05f * (static_cast<float>(random() % 1000) / 1000 - 0.5f);
    for (float& x : p) x *= radius;
  }
  return mesh;
}

TriangleMesh many_components() {
  TriangleMesh mesh = icosphere(2);
  mesh = joined(mesh, translated(tetrahedron(), 3, 0, 0));
  mesh = joined(mesh, translated(hilly(grid_patch(5, 5)), 0, 3, 0));
  mesh = joined(mesh, TriangleMesh{{{9, 0, 0}, {10, 0, 0}, {9, 1, 0}}, {{0, 1, 2}}});
  return joined(mesh, translated(icosphere(1), -3, 0, 0));
}

}  // namespace

TriangleMesh icosphere(int subdivisions) {
  const float t = (1 + std::sqrt(5.0f)) / 2;
  TriangleMesh mesh{{{-1, t, 0},
                     {1, t, 0},
                     {-1, -t, 0},
                     {1, -t, 0},
                     {0, -1, t},
                     {0, 1, t},
                     {0, -1, -t},
                     {0, 1, -t},
                     {t, 0, -1},
                     {t, 0, 1},
                     {-t, 0, -1},
                     {-t, 0, 1}},
                    {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                     {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                     {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}}};
  const auto onto_sphere = [](Point p) {
    const float length = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    return Point{p[0] / length, p[1] / length, p[2] / length};
  };
  for (Point& p : mesh.positions) p = onto_sphere(p);
  for (int i = 0; i < subdivisions; ++i) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto found = middles.try_emplace(std::pair{std::min(a, b), std::max(a, b)},
                                             static_cast<std::uint32_t>(mesh.positions.size()));
      if (found.second) {
        const Point &p = mesh.positions[a], &q = mesh.positions[b];
        mesh.positions.push_back(onto_sphere({p[0] + q[0], p[1] + q[1], p[2] + q[2]}));
      }
      return found.first->second;
    };
    std::vector<Triangle> finer;
    for (const Triangle& f : mesh.faces) {
      const std::uint32_t ab = middle(f[0], f[1]), bc = middle(f[1], f[2]), ca = middle(f[2], f[0]);
      finer.insert(finer.end(), {{f[0], ab, ca}, {ab, f[1], bc}, {ca, bc, f[2]}, {ab, bc, ca}});
    }
    mesh.faces = std::move(finer);
  }
  return mesh;
}

TriangleMesh grid_patch(int columns, int rows) {
  TriangleMesh mesh;
  for (int y = 0; y <= rows; ++y) {
    for (int x = 0; x <= columns; ++x) {
      mesh.positions.push_back({static_cast<float>(x), static_cast<float>(y), 0});
      if (x == columns || y == rows) continue;
      const auto a = static_cast<std::uint32_t>(y * (columns + 1) + x);
      const auto above = a + static_cast<std::uint32_t>(columns) + 1;
      mesh.faces.push_back({a, a + 1, above + 1});
      mesh.faces.push_back({a, above + 1, above});
    }
  }
  return mesh;
}

std::vector<ZooMesh> mesh_zoo() {
  return {
      {"Tetrahedron", tetrahedron(), true},
      {"Triangle", {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}}, true},
      {"TwoTriangles", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}}}, true},
      {"Closed", icosphere(3), true},
      {"Torus", spm::offline::generate(spm::offline::Shape::kTorus, 1500), true},
      {"FlatBorder", grid_patch(16, 16), true},
      {"Border", hilly(grid_patch(20, 17)), true},
      {"Hole", with_hole(icosphere(3)), true},
      {"Strip", hilly(grid_patch(40, 1)), true},
      {"Components", many_components(), true},
      {"NonManifoldEdge", fin(), false},
      {"NonManifoldVertex", bow_tie(), true},
      {"PinchedEdge", pinched_edge(), false},
      {"Pillows", pillows(), false},
      {"TwoSided", two_sided(), false},
      {"Fan", fan(), true},
      {"Moebius", moebius(), true},
      {"Slivers", slivers(), true},
      {"DuplicatedVertices", soup_of(icosphere(2)), true},
      {"DuplicatedFaces", with_duplicate_faces(icosphere(2)), true},
      {"DegenerateFaces", with_degenerate_faces(translated(icosphere(2), 2, 0, 0)), true},
      {"FarFromOrigin", translated(icosphere(2), 1000, -2000, 500), true},
      {"NoisySphere", noisy_sphere(), true},
      {"Organ", spm::offline::generate(spm::offline::Shape::kOrgan, 6000, 3), true},
      {"Terrain", spm::offline::generate(spm::offline::Shape::kTerrain, 4000, 5), true},
  };
}

void PrintTo(const ZooMesh& mesh, std::ostream* out) { *out << mesh.name; }

}  // namespace tactus::test_support
