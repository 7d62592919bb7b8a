#include "spm/offline/clean.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "spm/ids.hpp"
#include "spm/offline/parallel.hpp"
#include "spm/prefetch.hpp"

namespace tactus::spm::offline {
namespace {

using Point = std::array<float, 3>;

/// Hashes three numbers. The result is never 0.
std::uint32_t mix(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
  std::uint64_t h = a * 0x9e3779b97f4a7c15ull ^ b * 0xc2b2ae3d27d4eb4full ^ c * 0x165667b19e3779f9ull;
  h ^= h >> 29;
  h *= 0xbf58476d1ce4e5b9ull;
  return std::max(1u, static_cast<std::uint32_t>(h ^ h >> 32));
}

/// Returns, for each item below `count`, the first item that is equal to it, which may be the item itself; kNone for
/// items with hash 0. Each thread has a hash table (open addressing) for a range of hashes and enters the items in
/// ascending order, so the result does not depend on `threads`.
template <class HashOf, class Equal>
std::vector<std::uint32_t> first_equals(std::size_t count, unsigned threads, HashOf hash_of, Equal equal) {
  std::vector<std::uint32_t> hashes(count), first(count, kNone);
  parallel_ranges(count, kGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) hashes[i] = hash_of(static_cast<std::uint32_t>(i));
  });
  const std::uint32_t tables = thread_count(threads);
  parallel_for(tables, threads, [&](std::size_t own, unsigned) {
    const auto is_own = [&](std::size_t i) { return hashes[i] != 0 && range_of_hash(hashes[i], tables) == own; };
    std::size_t items = 0, size = 16;
    for (std::size_t i = 0; i < count; ++i) items += is_own(i);
    while (size < 2 * items) size *= 2;
    const std::size_t mask = size - 1;
    std::vector<std::uint32_t> table(size, kNone);
    constexpr std::size_t kAhead = 16;  // items to prefetch
    for (std::size_t i = 0; i < count; ++i) {
      if (i + kAhead < count && is_own(i + kAhead)) prefetch(&table[hashes[i + kAhead] & mask]);
      if (!is_own(i)) continue;
      const auto item = static_cast<std::uint32_t>(i);
      std::size_t at = hashes[i] & mask;
      while (table[at] != kNone && !(hashes[table[at]] == hashes[i] && equal(table[at], item))) at = (at + 1) & mask;
      if (table[at] == kNone) table[at] = item;
      first[i] = table[at];
    }
  });
  return first;
}

std::uint32_t bits(float x) {
  std::uint32_t b = 0;
  std::memcpy(&b, &x, sizeof b);
  return b;
}

/// An exact sum of doubles, stored as doubles whose bits do not overlap. Source: Shewchuk 1997, grow-expansion.
class ExactSum {
 public:
  void add(double value) {
    std::size_t size = 0;
    for (std::size_t i = 0; i < size_; ++i) {
      const double sum = value + terms_[i];
      const double from_value = sum - terms_[i];
      const double error = (value - from_value) + (terms_[i] - (sum - from_value));
      if (error != 0) terms_[size++] = error;
      value = sum;
    }
    size_ = size;
    if (value != 0) terms_[size_++] = value;
  }
  void add_product(double a, double b) {
    const double product = a * b;
    add(product);
    add(std::fma(a, b, -product));
  }
  [[nodiscard]] bool is_zero() const { return size_ == 0; }

 private:
  std::array<double, 32> terms_{};
  std::size_t size_ = 0;
};

/// The exact difference a - b: `high` is the rounded value, `low` the rounding error.
struct Difference {
  double high, low;
  Difference(double a, double b) : high{a - b} {
    const double back = a - high;
    low = (a - (high + back)) + (back - b);
  }
};

/// True if the projections of a, b, c on the plane of axes i, j are exactly on one line.
bool are_collinear_in(const Point& a, const Point& b, const Point& c, std::size_t i, std::size_t j) {
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
  return sum.is_zero();
}

bool are_collinear(const Point& a, const Point& b, const Point& c) {
  return are_collinear_in(a, b, c, 0, 1) && are_collinear_in(a, b, c, 1, 2) && are_collinear_in(a, b, c, 2, 0);
}

bool is_finite(const Point& p) { return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]); }

/// Returns, for each vertex, the first vertex at the same position; the vertex itself if the position is not finite.
std::vector<std::uint32_t> weld(TriangleMesh& mesh, CleanReport& report, unsigned threads) {
  std::vector<Point>& at = mesh.positions;
  const auto hash_of = [&at](std::uint32_t v) {
    if (!is_finite(at[v])) return 0u;
    for (float& x : at[v]) x += 0.0f;  // -0 becomes 0
    return mix(bits(at[v][0]), bits(at[v][1]), bits(at[v][2]));
  };
  std::vector<std::uint32_t> first =
      first_equals(at.size(), threads, hash_of, [&at](std::uint32_t a, std::uint32_t b) { return at[a] == at[b]; });
  for (std::uint32_t v = 0; v < first.size(); ++v) {
    if (first[v] == kNone) first[v] = v;
    report.welded_vertices += static_cast<std::uint32_t>(first[v] != v);
  }
  return first;
}

Triangle from_smallest(const Triangle& f) {
  if (f[0] < f[1] && f[0] < f[2]) return f;
  return f[1] < f[2] ? Triangle{f[1], f[2], f[0]} : Triangle{f[2], f[0], f[1]};
}

/// Returns the counter for a face that must be dropped, or null. Does not look for duplicates.
std::uint32_t CleanReport::*reason_to_drop(const TriangleMesh& mesh, const Triangle& f) {
  const Point &a = mesh.positions[f[0]], &b = mesh.positions[f[1]], &c = mesh.positions[f[2]];
  if (!is_finite(a) || !is_finite(b) || !is_finite(c)) return &CleanReport::non_finite_faces;
  if (f[0] == f[1] || f[1] == f[2] || f[2] == f[0]) return &CleanReport::repeated_corner_faces;
  return are_collinear(a, b, c) ? &CleanReport::zero_area_faces : nullptr;
}

void drop_bad_faces(TriangleMesh& mesh, const std::vector<std::uint32_t>& welded, CleanReport& report,
                    unsigned threads) {
  std::vector<Triangle>& faces = mesh.faces;
  const auto hash_of = [&](std::uint32_t i) {
    for (std::uint32_t& v : faces[i]) v = welded[v];
    if (reason_to_drop(mesh, faces[i]) != nullptr) return 0u;
    const Triangle key = from_smallest(faces[i]);
    return mix(key[0], key[1], key[2]);
  };
  const std::vector<std::uint32_t> first = first_equals(
      faces.size(), threads, hash_of,
      [&faces](std::uint32_t a, std::uint32_t b) { return from_smallest(faces[a]) == from_smallest(faces[b]); });
  std::uint32_t kept = 0;
  for (std::uint32_t i = 0; i < faces.size(); ++i) {
    if (first[i] == i) {
      faces[kept++] = faces[i];
    } else if (first[i] != kNone) {
      ++report.duplicate_faces;
    } else {
      ++(report.*reason_to_drop(mesh, faces[i]));
    }
  }
  faces.resize(kept);
}

void drop_unused_vertices(TriangleMesh& mesh, CleanReport& report, unsigned threads) {
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
  if (kept == mesh.positions.size()) return;
  mesh.positions.resize(kept);
  parallel_ranges(mesh.faces.size(), kGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      for (std::uint32_t& v : mesh.faces[f]) v = to[v];
    }
  });
}

void require_vertices(const TriangleMesh& mesh, unsigned threads) {
  parallel_ranges(mesh.faces.size(), kGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      for (const std::uint32_t v : mesh.faces[i]) {
        if (v < mesh.positions.size()) continue;
        throw ModelError{"face " + std::to_string(i) + ": found vertex " + std::to_string(v) + ", expected below " +
                         std::to_string(mesh.positions.size())};
      }
    }
  });
}

}  // namespace

CleanReport clean(TriangleMesh& mesh, unsigned threads) {
  require_vertices(mesh, threads);
  CleanReport report;
  const std::vector<std::uint32_t> first = weld(mesh, report, threads);
  drop_bad_faces(mesh, first, report, threads);
  drop_unused_vertices(mesh, report, threads);
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
