#include "spm/offline/generate.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "spm/model.hpp"
#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {
namespace {

constexpr double kPi = 3.14159265358979323846;

struct NamedShape {
  std::string_view name;
  Shape shape;
};
constexpr std::array<NamedShape, 6> kShapes{{{"sphere", Shape::kSphere},
                                             {"torus", Shape::kTorus},
                                             {"organ", Shape::kOrgan},
                                             {"terrain", Shape::kTerrain},
                                             {"wall", Shape::kWall},
                                             {"box", Shape::kBox}}};

/// A smooth random function of position with values in [-1, 1]: random values at integer positions, interpolated by
/// quintic polynomials. Source: Perlin 2002.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : seed_{seed} {}

  double at(const Vec3d& p) const {
    const Vec3d cell = p.array().floor();
    const Vec3d in = p - cell;
    const Vec3d s = in.array().cube() * (in.array() * (in.array() * 6 - 15) + 10);
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      double weight = 1;
      std::array<std::int64_t, 3> at{};
      for (int axis = 0; axis < 3; ++axis) {
        const int far = corner >> axis & 1;
        weight *= far != 0 ? s[axis] : 1 - s[axis];
        at[static_cast<std::size_t>(axis)] = static_cast<std::int64_t>(cell[axis]) + far;
      }
      sum += weight * value(at);
    }
    return sum;
  }

  /// The sum of `count` octaves. Each octave has twice the frequency and half the amplitude of the previous one.
  double octaves(Vec3d p, int count) const {
    double sum = 0, height = 1;
    for (int i = 0; i < count; ++i) {
      sum += height * at(p);
      p = 2 * p + Vec3d::Constant(17.3);
      height /= 2;
    }
    return sum;
  }

 private:
  double value(const std::array<std::int64_t, 3>& at) const {
    std::uint64_t h = seed_;
    for (const std::int64_t x : at) {
      h ^= static_cast<std::uint64_t>(x) + 0x9e3779b97f4a7c15ull + (h << 6) + (h >> 2);
      h = (h ^ h >> 30) * 0xbf58476d1ce4e5b9ull;
      h = (h ^ h >> 27) * 0x94d049bb133111ebull;
      h ^= h >> 31;
    }
    return static_cast<double>(h >> 11) / static_cast<double>(1ull << 52) - 1;
  }

  std::uint64_t seed_;
};

std::array<float, 3> rounded(const Vec3d& p) {
  return {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])};
}

/// A unit sphere whose vertices are on rings of latitude. The number of vertices of a ring is proportional to its
/// length. Triangles connect each ring to the next. A closed surface of V vertices has 2 V - 4 faces, so the number of
/// vertices determines the number of faces.
///
///      pole
///     /  |  \        ring i has counts[i] vertices
///    o---o---o
///    | \/ \ /|
///    o-o--o--o
struct UnitSphere {
  std::vector<Vec3d> points;
  std::vector<Triangle> faces;
};

/// Returns the number of vertices of each ring, for a sphere with so many vertices on rings.
std::vector<std::uint32_t> ring_counts(std::uint32_t vertices) {
  const auto rings = static_cast<std::uint32_t>(
      std::clamp(std::round(std::sqrt(kPi * vertices * std::sqrt(3.0) / 8)), 1.0, std::max(1.0, vertices / 3.0)));
  std::vector<double> length(rings);
  double total = 0;
  for (std::uint32_t i = 0; i < rings; ++i) total += length[i] = std::sin(kPi * (i + 1) / (rings + 1));
  std::vector<std::uint32_t> counts(rings);
  double exact_sum = 0;
  std::uint32_t sum = 0;
  for (std::uint32_t i = 0; i < rings; ++i) {  // each ring has at least 3; the next ring corrects the rounding error
    exact_sum += 3 + (vertices - 3.0 * rings) * length[i] / total;
    counts[i] = i + 1 == rings ? vertices - sum : static_cast<std::uint32_t>(std::round(exact_sum)) - sum;
    sum += counts[i];
  }
  return counts;
}

UnitSphere unit_sphere(std::uint32_t faces) {
  UnitSphere sphere;
  const std::vector<std::uint32_t> counts = ring_counts((faces + 4) / 2 - 2);
  const auto rings = static_cast<std::uint32_t>(counts.size());
  sphere.points.reserve(faces / 2 + 2);
  sphere.faces.reserve(faces);
  sphere.points.emplace_back(0, 0, 1);
  std::uint32_t above = 0, above_count = 1;
  for (std::uint32_t i = 0; i < rings; ++i) {
    const double polar = kPi * (i + 1) / (rings + 1);
    const auto first = static_cast<std::uint32_t>(sphere.points.size());
    for (std::uint32_t k = 0; k < counts[i]; ++k) {
      const double angle = 2 * kPi * k / counts[i];
      sphere.points.emplace_back(std::sin(polar) * std::cos(angle), std::sin(polar) * std::sin(angle), std::cos(polar));
    }
    // Connects this ring to the ring above. Each triangle advances by one vertex on the ring whose next edge has the
    // middle with the smaller angle.
    std::uint32_t a = 0, b = 0;
    const std::uint32_t above_steps = i == 0 ? 0 : above_count;
    while (a < above_steps || b < counts[i]) {
      const std::uint32_t at_a = above + a % above_count, at_b = first + b % counts[i];
      const bool step_above = b == counts[i] || (a < above_steps && std::uint64_t{2 * a + 1} * counts[i] <=
                                                                        std::uint64_t{2 * b + 1} * above_count);
      if (step_above) {
        sphere.faces.push_back({at_a, at_b, above + (a + 1) % above_count});
        ++a;
      } else {
        sphere.faces.push_back({at_a, at_b, first + (b + 1) % counts[i]});
        ++b;
      }
    }
    above = first;
    above_count = counts[i];
  }
  const auto pole = static_cast<std::uint32_t>(sphere.points.size());
  sphere.points.emplace_back(0, 0, -1);
  for (std::uint32_t k = 0; k < above_count; ++k) {
    sphere.faces.push_back({above + k, pole, above + (k + 1) % above_count});
  }
  return sphere;
}

TriangleMesh sphere(std::uint32_t faces) {
  UnitSphere unit = unit_sphere(faces);
  TriangleMesh mesh;
  for (const Vec3d& p : unit.points) mesh.positions.push_back(rounded(0.05 * p));
  mesh.faces = std::move(unit.faces);
  return mesh;
}

TriangleMesh organ(std::uint32_t faces, std::uint64_t seed) {
  const Noise noise{seed};
  UnitSphere unit = unit_sphere(faces);
  TriangleMesh mesh;
  mesh.positions.resize(unit.points.size());
  constexpr std::size_t kRange = 1 << 14;  // a point takes several microseconds
  parallel_ranges(unit.points.size(), kRange, 0, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      const Vec3d& p = unit.points[i];
      const double lobes = noise.octaves(1.3 * p + Vec3d::Constant(5), 2);
      const double folds = noise.octaves(6 * p + Vec3d::Constant(31), 4);
      const double radius = 0.045 * (1 + 0.22 * lobes + 0.035 * folds);
      mesh.positions[i] = rounded(radius * p.cwiseProduct(Vec3d{1.15, 0.9, 0.8}));
    }
  });
  mesh.faces = std::move(unit.faces);
  return mesh;
}

struct Quads {
  std::uint32_t columns, rows;
};

/// Returns the grid of quads for which 2 * columns * rows is nearest to `faces`, with about `aspect` times as many
/// columns as rows. It has at least `min` columns and rows.
Quads quads(std::uint32_t faces, double aspect, std::uint32_t min) {
  const double count = faces / 2.0;
  const double columns = std::sqrt(count * aspect);
  const auto around = static_cast<std::uint32_t>(std::max<double>(min, std::round(columns)));
  Quads best{};
  double best_error = 0;
  const std::uint32_t reach = around / 10 + 1;
  for (std::uint32_t step = 0; step <= 2 * reach; ++step) {  // around, around + 1, around - 1, ...
    const std::uint32_t offset = (step + 1) / 2;
    if (step % 2 == 0 && around < min + offset) continue;
    const std::uint32_t c = step % 2 == 0 ? around - offset : around + offset;
    const auto r = static_cast<std::uint32_t>(std::max<double>(min, std::round(count / c)));
    const double error = std::abs(double(c) * r - count);
    if (best.columns == 0 || error < best_error) {
      best = {c, r};
      best_error = error;
    }
  }
  return best;
}

TriangleMesh torus(std::uint32_t faces) {
  const Quads grid = quads(faces, 2.5, 3);
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i < grid.columns; ++i) {
    for (std::uint32_t k = 0; k < grid.rows; ++k) {
      const double along = 2 * kPi * i / grid.columns, opposite = 2 * kPi * k / grid.rows;
      const double out = 0.05 + 0.02 * std::cos(opposite);
      mesh.positions.push_back(rounded({out * std::cos(along), out * std::sin(along), 0.02 * std::sin(opposite)}));
      const std::uint32_t i1 = (i + 1) % grid.columns, k1 = (k + 1) % grid.rows;
      const std::uint32_t a = i * grid.rows + k, b = i1 * grid.rows + k;
      const std::uint32_t c = i1 * grid.rows + k1, d = i * grid.rows + k1;
      mesh.faces.push_back({a, b, c});
      mesh.faces.push_back({a, c, d});
    }
  }
  return mesh;
}

TriangleMesh terrain(std::uint32_t faces, std::uint64_t seed) {
  const Noise noise{seed};
  const Quads grid = quads(faces, 1, 1);
  TriangleMesh mesh;
  for (std::uint32_t y = 0; y <= grid.rows; ++y) {
    for (std::uint32_t x = 0; x <= grid.columns; ++x) {
      const double px = double(x) / grid.columns, py = double(y) / grid.rows;
      const double height = 0.012 * noise.octaves(Vec3d{4 * px, 4 * py, 0.5}, 6);
      mesh.positions.push_back(rounded({0.1 * px - 0.05, 0.1 * py - 0.05, height}));
      if (x == grid.columns || y == grid.rows) continue;
      const std::uint32_t a = y * (grid.columns + 1) + x, b = a + 1, d = a + grid.columns + 1, c = d + 1;
      mesh.faces.push_back((x + y) % 2 == 0 ? Triangle{a, b, c} : Triangle{a, b, d});
      mesh.faces.push_back((x + y) % 2 == 0 ? Triangle{a, c, d} : Triangle{b, c, d});
    }
  }
  return mesh;
}

/// Generates a closed block from the outer squares of a lattice of cubes that is `wide` times as wide as high.
TriangleMesh block(std::uint32_t faces, std::int64_t wide) {
  // A lattice of w x w x h cubes has 2 w^2 + 4 w h outer squares of two faces each, and w = `wide` * h.
  const double min = static_cast<double>(4 * wide * wide + 8 * wide);
  const std::int64_t high = std::max<std::int64_t>(1, std::llround(std::sqrt(faces / min)));
  const std::array<std::int64_t, 3> count{wide * high, wide * high, high};
  TriangleMesh mesh;
  std::map<std::array<std::int64_t, 3>, std::uint32_t> numbers;
  const auto vertex = [&](const std::array<std::int64_t, 3>& at) {
    const auto [found, is_new] = numbers.try_emplace(at, static_cast<std::uint32_t>(mesh.positions.size()));
    if (is_new) {
      const double edge = 0.1 / static_cast<double>(wide) / static_cast<double>(high);
      Vec3d p;
      for (std::size_t axis = 0; axis < 3; ++axis)
        p[static_cast<Eigen::Index>(axis)] =
            edge * (static_cast<double>(at[axis]) - 0.5 * static_cast<double>(count[axis]));
      mesh.positions.push_back(rounded(p));
    }
    return found->second;
  };
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool upper : {false, true}) {
      std::array<std::int64_t, 3> at{};
      at[axis] = upper ? count[axis] : 0;
      for (std::int64_t i = 0; i < count[u]; ++i) {
        for (std::int64_t k = 0; k < count[v]; ++k) {
          const auto corner = [&](std::int64_t du, std::int64_t dv) {
            at[u] = i + du;
            at[v] = k + dv;
            return vertex(at);
          };
          const std::uint32_t a = corner(0, 0), b = corner(1, 0), c = corner(1, 1), d = corner(0, 1);
          mesh.faces.push_back(upper ? Triangle{a, b, c} : Triangle{a, c, b});
          mesh.faces.push_back(upper ? Triangle{a, c, d} : Triangle{a, d, c});
        }
      }
    }
  }
  return mesh;
}

}  // namespace

TriangleMesh stylus() {
  constexpr std::uint32_t kAround = 24;
  constexpr std::uint32_t kTipRings = 12, kRings = 15;  // 12 rings of the hemisphere, 3 along the shaft
  constexpr double kRadius = 0.003, kShaft = 0.025;
  TriangleMesh mesh;
  mesh.positions.push_back(rounded({0, 0, -kRadius}));
  for (std::uint32_t ring = 1; ring <= kRings; ++ring) {
    const double polar = std::min(ring, kTipRings) * kPi / 2 / kTipRings;
    const double along = ring <= kTipRings ? 0 : double(ring - kTipRings) / (kRings - kTipRings);
    const double z = ring < kTipRings ? -kRadius * std::cos(polar) : kShaft * along;
    for (std::uint32_t k = 0; k < kAround; ++k) {
      const double angle = 2 * kPi * k / kAround, out = kRadius * std::sin(polar);
      mesh.positions.push_back(rounded({out * std::cos(angle), out * std::sin(angle), z}));
    }
  }
  const auto end = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.push_back(rounded({0, 0, kShaft}));
  for (std::uint32_t k = 0; k < kAround; ++k) {
    const std::uint32_t next = (k + 1) % kAround;
    mesh.faces.push_back({0, 1 + next, 1 + k});
    for (std::uint32_t ring = 0; ring + 1 < kRings; ++ring) {
      const std::uint32_t low = 1 + ring * kAround, high = low + kAround;
      mesh.faces.push_back({low + k, low + next, high + next});
      mesh.faces.push_back({low + k, high + next, high + k});
    }
    const std::uint32_t last = 1 + (kRings - 1) * kAround;
    mesh.faces.push_back({last + k, last + next, end});
  }
  return mesh;
}

std::vector<std::string_view> shape_names() {
  std::vector<std::string_view> names;
  for (const NamedShape& shape : kShapes) names.push_back(shape.name);
  return names;
}

Shape shape_from_name(std::string_view name) {
  for (const NamedShape& shape : kShapes) {
    if (shape.name == name) return shape.shape;
  }
  throw ModelError{"shape: found \"" + std::string{name} + "\", expected sphere, torus, organ, terrain, wall or box"};
}

TriangleMesh generate(Shape shape, std::uint32_t faces, std::uint64_t seed) {
  if (faces < 8 || faces >= kMaxBuiltFaces) {
    throw ModelError{"faces: found " + std::to_string(faces) + ", expected 8 to " + std::to_string(kMaxBuiltFaces - 1)};
  }
  switch (shape) {
    case Shape::kSphere:
      return sphere(faces);
    case Shape::kTorus:
      return torus(faces);
    case Shape::kOrgan:
      return organ(faces, seed);
    case Shape::kTerrain:
      return terrain(faces, seed);
    case Shape::kWall:
      return block(faces, 5);
    case Shape::kBox:
      return block(faces, 1);
  }
  throw ModelError{"shape: unknown"};
}

}  // namespace tactus::spm::offline
