#include "spm/offline/clean.hpp"

#include <cmath>
#include <cstring>
#include <string>

#include "spm/ids.hpp"

namespace tactus::spm::offline {
namespace {

using Point = std::array<float, 3>;

std::uint64_t mix(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
  std::uint64_t h = a * 0x9e3779b97f4a7c15ull ^ b * 0xc2b2ae3d27d4eb4full ^ c * 0x165667b19e3779f9ull;
  h ^= h >> 29;
  h *= 0xbf58476d1ce4e5b9ull;
  return h ^ h >> 32;
}

/// Finds an earlier equal item; open addressing over indices, so the order of insertion alone decides.
class FirstOfItsKind {
 public:
  explicit FirstOfItsKind(std::size_t items) {
    std::size_t size = 16;
    while (size < 2 * items) size *= 2;
    table_.assign(size, kNone);
  }
  template <class Equal>
  std::uint32_t find_or_insert(std::uint64_t hash, std::uint32_t item, Equal equal) {
    const std::size_t mask = table_.size() - 1;
    for (std::size_t at = hash & mask;; at = (at + 1) & mask) {
      if (table_[at] == kNone) return table_[at] = item;
      if (equal(table_[at])) return table_[at];
    }
  }

 private:
  std::vector<std::uint32_t> table_;
};

std::uint32_t bits(float x) {
  std::uint32_t b = 0;
  std::memcpy(&b, &x, sizeof b);
  return b;
}

/// An exact sum of doubles, kept as doubles that do not overlap (Shewchuk 1997, grow-expansion).
class ExactSum {
 public:
  void add(double value) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < size_; ++i) {
      const double sum = value + terms_[i];
      const double from_value = sum - terms_[i];
      const double error = (value - from_value) + (terms_[i] - (sum - from_value));
      if (error != 0) terms_[kept++] = error;
      value = sum;
    }
    size_ = kept;
    if (value != 0) terms_[size_++] = value;
  }
  void add_product(double a, double b) {
    const double product = a * b;
    add(product);
    add(std::fma(a, b, -product));
  }
  [[nodiscard]] bool zero() const { return size_ == 0; }

 private:
  std::array<double, 32> terms_{};
  std::size_t size_ = 0;
};

/// a - b exactly: the rounded difference and what rounding lost.
struct Difference {
  double high, low;
  Difference(double a, double b) : high{a - b} {
    const double back = a - high;
    low = (a - (high + back)) + (back - b);
  }
};

/// Whether (b - a) x (c - a) is exactly zero in the plane of axes i, j.
bool flat_in(const Point& a, const Point& b, const Point& c, std::size_t i, std::size_t j) {
  const Difference bi{b[i], a[i]}, bj{b[j], a[j]}, ci{c[i], a[i]}, cj{c[j], a[j]};
  const double left = bi.high * cj.high, right = bj.high * ci.high;
  if (std::abs(left - right) > 1e-15 * (std::abs(left) + std::abs(right))) return false;
  ExactSum sum;
  for (const double p : {bi.high, bi.low}) {
    for (const double q : {cj.high, cj.low}) sum.add_product(p, q);
  }
  for (const double p : {bj.high, bj.low}) {
    for (const double q : {ci.high, ci.low}) sum.add_product(-p, q);
  }
  return sum.zero();
}

bool collinear(const Point& a, const Point& b, const Point& c) {
  return flat_in(a, b, c, 0, 1) && flat_in(a, b, c, 1, 2) && flat_in(a, b, c, 2, 0);
}

bool finite(const Point& p) { return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]); }

/// For each vertex the first with its position.
std::vector<std::uint32_t> weld(TriangleMesh& mesh, CleanReport& report) {
  std::vector<std::uint32_t> first(mesh.positions.size());
  FirstOfItsKind known{mesh.positions.size()};
  for (std::uint32_t v = 0; v < first.size(); ++v) {
    Point& p = mesh.positions[v];
    first[v] = v;
    if (!finite(p)) continue;
    for (float& x : p) x += 0.0f;  // -0 becomes 0
    first[v] = known.find_or_insert(mix(bits(p[0]), bits(p[1]), bits(p[2])), v,
                                    [&](std::uint32_t other) { return mesh.positions[other] == p; });
    if (first[v] != v) ++report.welded_vertices;
  }
  return first;
}

Triangle from_smallest(const Triangle& f) {
  if (f[0] < f[1] && f[0] < f[2]) return f;
  return f[1] < f[2] ? Triangle{f[1], f[2], f[0]} : Triangle{f[2], f[0], f[1]};
}

void drop_bad_faces(TriangleMesh& mesh, const std::vector<std::uint32_t>& first, CleanReport& report) {
  FirstOfItsKind known{mesh.faces.size()};
  std::uint32_t kept = 0;
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    Triangle f = mesh.faces[i];
    for (std::uint32_t& v : f) v = first[v];
    const Point &a = mesh.positions[f[0]], &b = mesh.positions[f[1]], &c = mesh.positions[f[2]];
    if (!finite(a) || !finite(b) || !finite(c)) {
      ++report.non_finite_faces;
    } else if (f[0] == f[1] || f[1] == f[2] || f[2] == f[0]) {
      ++report.repeated_corner_faces;
    } else if (collinear(a, b, c)) {
      ++report.zero_area_faces;
    } else {
      const Triangle key = from_smallest(f);
      const std::uint32_t same = known.find_or_insert(mix(key[0], key[1], key[2]), kept, [&](std::uint32_t other) {
        return from_smallest(mesh.faces[other]) == key;
      });
      if (same == kept) {
        mesh.faces[kept++] = f;
      } else {
        ++report.duplicate_faces;
      }
    }
  }
  mesh.faces.resize(kept);
}

void drop_unused_vertices(TriangleMesh& mesh, CleanReport& report) {
  std::vector<std::uint32_t> to(mesh.positions.size(), kNone);
  for (const Triangle& f : mesh.faces) {
    for (const std::uint32_t v : f) to[v] = 0;
  }
  std::uint32_t kept = 0;
  for (std::uint32_t v = 0; v < to.size(); ++v) {
    if (to[v] == kNone) continue;
    mesh.positions[kept] = mesh.positions[v];
    to[v] = kept++;
  }
  report.unreferenced_vertices = static_cast<std::uint32_t>(to.size()) - kept - report.welded_vertices;
  mesh.positions.resize(kept);
  for (Triangle& f : mesh.faces) {
    for (std::uint32_t& v : f) v = to[v];
  }
}

}  // namespace

CleanReport clean(TriangleMesh& mesh) {
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    for (const std::uint32_t v : mesh.faces[i]) {
      if (v >= mesh.positions.size()) {
        throw ModelError{"face " + std::to_string(i) + ": names vertex " + std::to_string(v) + ", the mesh has " +
                         std::to_string(mesh.positions.size())};
      }
    }
  }
  CleanReport report;
  const std::vector<std::uint32_t> first = weld(mesh, report);
  drop_bad_faces(mesh, first, report);
  drop_unused_vertices(mesh, report);
  return report;
}

CleanReport operator+(const CleanReport& a, const CleanReport& b) {
  return {a.welded_vertices + b.welded_vertices,
          a.non_finite_faces + b.non_finite_faces,
          a.repeated_corner_faces + b.repeated_corner_faces,
          a.zero_area_faces + b.zero_area_faces,
          a.duplicate_faces + b.duplicate_faces,
          a.unreferenced_vertices + b.unreferenced_vertices};
}

}  // namespace tactus::spm::offline
