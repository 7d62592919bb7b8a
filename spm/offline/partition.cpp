#include "spm/offline/partition.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "spm/morton.hpp"
#include "spm/offline/parallel.hpp"

namespace tactus::spm::offline {
namespace {

constexpr std::uint32_t kMaxDepth = 6;
constexpr double kLongestSide = 1000;  // max cells of the longest side, so that coordinates at kMaxDepth fit 16 bits
static_assert(kMaxDepth <= kMaxCellDepth && kLongestSide < kMaxCellsPerSide);

class Partitioner {
 public:
  Partitioner(const TriangleMesh& mesh, const PartitionOptions& options, unsigned threads)
      : mesh_{mesh}, options_{options}, threads_{threads} {
    Vec3d low = Vec3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    double largest = 0;
    for (const std::array<float, 3>& p : mesh.positions) {
      const Vec3d at{p[0], p[1], p[2]};
      low = low.cwiseMin(at);
      high = high.cwiseMax(at);
      largest = std::max(largest, at.cwiseAbs().maxCoeff());
    }
    const double area = parallel_sum(mesh.faces.size(), threads, [this](std::size_t f) {
      const std::array<Vec3d, 3> t = corners(static_cast<std::uint32_t>(f));
      return (t[1] - t[0]).cross(t[2] - t[0]).norm() / 2;
    });
    const double side = (high - low).maxCoeff();
    const double even = std::sqrt(area * options.cell_faces / static_cast<double>(mesh.faces.size()));
    const double cell = std::min(std::max(even, side / kLongestSide), 1.01 * side);
    margin_ = 1e-6 * cell + 4 * static_cast<double>(std::numeric_limits<float>::epsilon()) * largest;
    // The model is in the middle of the grid, slightly inside the outermost cells.
    out_.grid.cell_size = cell;
    for (int axis = 0; axis < 3; ++axis) {
      const double extent = high[axis] - low[axis] + 4 * margin_;
      count_[axis] = static_cast<std::uint32_t>(std::ceil(extent / cell));
      out_.grid.origin[static_cast<std::size_t>(axis)] = (low[axis] + high[axis] - count_[axis] * cell) / 2;
      extent_ = std::max(extent_, count_[axis] * cell);
    }
    // A coordinate has an error of at most some units of roundoff of `largest + extent_`. For an axis, it is multiplied
    // by the length of the axis, and the error of the axis itself by `extent_`.
    rounding_ = 0x1p14 * std::numeric_limits<double>::epsilon() * (largest + extent_);
  }

  Partition run() {
    std::vector<Entry> entries = intersections();
    parallel_sort(entries, threads_,
                  [](const Entry& a, const Entry& b) { return a.key != b.key ? a.key < b.key : a.face < b.face; });
    constexpr std::size_t kPiece = 1 << 15;
    std::vector<Cells> pieces(entries.size() / kPiece + 1);  // by the first entry of each
    const auto same_cell = [&entries](std::size_t i) { return entries[i].key == entries[i - 1].key; };
    parallel_groups(entries.size(), kPiece, threads_, same_cell, [&](std::size_t first, std::size_t last) {
      std::vector<std::uint32_t> faces;
      for (std::size_t i = first; i < last;) {
        const std::uint64_t key = entries[i].key;
        faces.clear();
        for (; i < last && entries[i].key == key; ++i) faces.push_back(entries[i].face);
        add(unmorton(key), 0, faces, pieces[first / kPiece]);
      }
    });
    out_.faces.reserve(entries.size());
    entries = {};
    for (const Cells& piece : pieces) {
      const auto before = static_cast<std::uint32_t>(out_.faces.size());
      for (Cell cell : piece.cells) {
        cell.first_face += before;
        out_.cells.push_back(cell);
      }
      out_.faces.insert(out_.faces.end(), piece.faces.begin(), piece.faces.end());
    }
    return std::move(out_);
  }

 private:
  using CellCoordinates = std::array<std::uint32_t, 3>;
  /// An intersection of a cell of the even grid and a face.
  struct Entry {
    std::uint64_t key;  // Morton code of the cell
    std::uint32_t face;
  };
  /// Some of the cells, in the form of Partition.
  struct Cells {
    std::vector<Cell> cells;
    std::vector<std::uint32_t> faces;
  };

  /// Finds all pairs of a face and a cell of the even grid that intersect.
  std::vector<Entry> intersections() const {
    constexpr std::size_t kChunk = 1 << 16;
    std::vector<std::vector<Entry>> chunks((mesh_.faces.size() + kChunk - 1) / kChunk);
    parallel_for(chunks.size(), threads_, [&](std::size_t chunk, unsigned) {
      chunks[chunk].reserve(kChunk * 3 / 2);
      const std::size_t last = std::min(mesh_.faces.size(), (chunk + 1) * kChunk);
      for (std::size_t f = chunk * kChunk; f < last; ++f)
        add_intersections(static_cast<std::uint32_t>(f), chunks[chunk]);
    });
    std::size_t sum = 0;
    for (const std::vector<Entry>& chunk : chunks) sum += chunk.size();
    std::vector<Entry> entries;
    entries.reserve(sum);
    for (std::vector<Entry>& chunk : chunks) {
      entries.insert(entries.end(), chunk.begin(), chunk.end());
      chunk = {};
    }
    return entries;
  }

  void add_intersections(std::uint32_t f, std::vector<Entry>& entries) const {
    const std::array<Vec3d, 3> t = corners(f);
    CellCoordinates first{}, last{};
    for (int axis = 0; axis < 3; ++axis) {
      const double low = std::min({t[0][axis], t[1][axis], t[2][axis]});
      const double high = std::max({t[0][axis], t[1][axis], t[2][axis]});
      first[static_cast<std::size_t>(axis)] = cell_of(low - margin_, axis);
      last[static_cast<std::size_t>(axis)] = cell_of(high + margin_, axis);
    }
    if (first == last) {  // the bounds of the face are inside one cell
      entries.push_back({morton(first[0], first[1], first[2]), f});
      return;
    }
    constexpr std::uint64_t kFewCells = 64;
    if (cells_of(first, last) <= kFewCells) {
      add_cells(t, f, first, last, entries);
    } else {
      add_block(t, f, first, last, entries);
    }
  }

  static std::uint64_t cells_of(const CellCoordinates& first, const CellCoordinates& last) {
    std::uint64_t cells = 1;
    for (std::size_t k = 0; k < 3; ++k) cells *= last[k] - first[k] + 1;
    return cells;
  }

  /// Tests each cell of a block.
  void add_cells(const std::array<Vec3d, 3>& t, std::uint32_t f, const CellCoordinates& first,
                 const CellCoordinates& last, std::vector<Entry>& entries) const {
    for (std::uint32_t z = first[2]; z <= last[2]; ++z) {
      for (std::uint32_t y = first[1]; y <= last[1]; ++y) {
        for (std::uint32_t x = first[0]; x <= last[0]; ++x) {
          if (intersects_cell(t, {x, y, z}, 0)) entries.push_back({morton(x, y, z), f});
        }
      }
    }
  }

  /// Halves a block and its halves, without those that do not intersect the face. So a long thin face costs a number of
  /// tests in proportion to its length, not to its bounding box.
  void add_block(const std::array<Vec3d, 3>& t, std::uint32_t f, const CellCoordinates& first,
                 const CellCoordinates& last, std::vector<Entry>& entries) const {
    constexpr std::uint64_t kFewCells = 8;
    if (!can_intersect_block(t, first, last)) return;
    if (cells_of(first, last) <= kFewCells) return add_cells(t, f, first, last, entries);
    std::size_t longest = 0;
    for (std::size_t k = 1; k < 3; ++k)
      if (last[k] - first[k] > last[longest] - first[longest]) longest = k;
    CellCoordinates end = last, begin = first;
    end[longest] = first[longest] + (last[longest] - first[longest]) / 2;
    begin[longest] = end[longest] + 1;
    add_block(t, f, first, end, entries);
    add_block(t, f, begin, last, entries);
  }

  /// Returns false only if `intersects_cell` is false for each cell of the block. Tests the axes of
  /// triangle_intersects_cube with a tolerance above the rounding errors of both tests.
  bool can_intersect_block(const std::array<Vec3d, 3>& t, const CellCoordinates& first,
                           const CellCoordinates& last) const {
    Vec3d centre, half;
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      centre[axis] = out_.grid.origin[k] + (first[k] + last[k] + 1.0) / 2 * out_.grid.cell_size;
      half[axis] = (last[k] - first[k] + 1.0) / 2 * out_.grid.cell_size + margin_;
    }
    const Vec3d a = t[0] - centre, b = t[1] - centre, c = t[2] - centre;
    // `scale`: upper bound of the length of the axis.
    const auto apart = [&](const Vec3d& axis, double scale) {
      const double pa = axis.dot(a), pb = axis.dot(b), pc = axis.dot(c);
      const double reach = half.dot(axis.cwiseAbs()) + rounding_ * scale;
      return std::min({pa, pb, pc}) > reach || std::max({pa, pb, pc}) < -reach;
    };
    const std::array<Vec3d, 3> edges{Vec3d{b - a}, Vec3d{c - b}, Vec3d{a - c}};
    if (apart(edges[0].cross(edges[1]), extent_ * extent_)) return false;
    for (int axis = 0; axis < 3; ++axis) {
      if (apart(Vec3d::Unit(axis), 1)) return false;
      for (const Vec3d& edge : edges)
        if (apart(Vec3d::Unit(axis).cross(edge), extent_)) return false;
    }
    return true;
  }

  std::array<Vec3d, 3> corners(std::uint32_t f) const {
    std::array<Vec3d, 3> t;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::array<float, 3>& p = mesh_.positions[mesh_.faces[f][k]];
      t[k] = {p[0], p[1], p[2]};
    }
    return t;
  }

  std::uint32_t cell_of(double x, int axis) const {
    const double at = std::floor((x - out_.grid.origin[static_cast<std::size_t>(axis)]) / out_.grid.cell_size);
    return static_cast<std::uint32_t>(std::clamp(at, 0.0, count_[axis] - 1.0));
  }

  bool intersects_cell(const std::array<Vec3d, 3>& t, const CellCoordinates& at, std::uint32_t depth) const {
    const double edge = std::ldexp(out_.grid.cell_size, -static_cast<int>(depth));
    Vec3d centre;
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      centre[axis] = out_.grid.origin[k] + (at[k] + 0.5) * edge;
    }
    return triangle_intersects_cube(t, centre, edge / 2 + margin_);
  }

  static CellCoordinates unmorton(std::uint64_t key) {
    CellCoordinates at{};
    for (std::uint32_t bit = 0; bit < 21; ++bit) {
      for (std::uint32_t axis = 0; axis < 3; ++axis)
        at[axis] |= static_cast<std::uint32_t>(key >> (3 * bit + axis) & 1u) << bit;
    }
    return at;
  }

  /// Adds the cell at `at` with these faces, or the eight cells into which it is divided.
  void add(const CellCoordinates& at, std::uint32_t depth, const std::vector<std::uint32_t>& faces, Cells& out) const {
    if (faces.empty() || divide(at, depth, faces, out)) return;
    const std::uint64_t occupied = occupied_subcells(faces, at, depth);
    out.cells.push_back(
        {{static_cast<std::uint16_t>(at[0]), static_cast<std::uint16_t>(at[1]), static_cast<std::uint16_t>(at[2])},
         static_cast<std::uint16_t>(depth),
         {static_cast<std::uint32_t>(occupied), static_cast<std::uint32_t>(occupied >> 32)},
         static_cast<std::uint32_t>(out.faces.size()),
         static_cast<std::uint32_t>(faces.size())});
    out.faces.insert(out.faces.end(), faces.begin(), faces.end());
  }

  /// Returns the occupied subcells as bits. The test enlarges each subcell slightly.
  std::uint64_t occupied_subcells(const std::vector<std::uint32_t>& faces, const CellCoordinates& at,
                                  std::uint32_t depth) const {
    const double edge = std::ldexp(out_.grid.cell_size, -static_cast<int>(depth));
    const double quarter = edge / 4;
    Vec3d low;
    for (int axis = 0; axis < 3; ++axis) {
      const auto k = static_cast<std::size_t>(axis);
      low[axis] = out_.grid.origin[k] + at[k] * edge;
    }
    std::uint64_t occupied = 0;
    for (const std::uint32_t f : faces) {
      const std::array<Vec3d, 3> t = corners(f);
      std::array<int, 3> first, last;
      for (int axis = 0; axis < 3; ++axis) {
        const auto k = static_cast<std::size_t>(axis);
        const auto quarter_of = [&](double x) {
          return static_cast<int>(std::clamp(std::floor((x - low[axis]) / quarter), 0.0, 3.0));
        };
        first[k] = quarter_of(std::min({t[0][axis], t[1][axis], t[2][axis]}) - margin_);
        last[k] = quarter_of(std::max({t[0][axis], t[1][axis], t[2][axis]}) + margin_);
      }
      const bool in_one_subcell = first == last;
      for (int z = first[2]; z <= last[2]; ++z) {
        for (int y = first[1]; y <= last[1]; ++y) {
          for (int x = first[0]; x <= last[0]; ++x) {
            const std::uint64_t bit = std::uint64_t{1} << (x + 4 * y + 16 * z);
            if ((occupied & bit) != 0) continue;
            const Vec3d centre = low + quarter * Vec3d{x + 0.5, y + 0.5, z + 0.5};
            if (in_one_subcell || triangle_intersects_cube(t, centre, quarter / 2 + margin_)) occupied |= bit;
          }
        }
      }
    }
    return occupied;
  }

  /// Divides a cell with too many faces in eight and adds these cells. Returns false if the cell has few enough faces,
  /// or if the eight cells would share most faces, as around a vertex of very many faces or in a stack of sheets.
  bool divide(const CellCoordinates& at, std::uint32_t depth, const std::vector<std::uint32_t>& faces,
              Cells& out) const {
    if (faces.size() <= options_.max_cell_faces || depth == kMaxDepth) return false;
    std::array<std::vector<std::uint32_t>, 8> parts;
    std::size_t sum = 0;
    const auto child = [&at](std::uint32_t octant) {
      return CellCoordinates{2 * at[0] + (octant & 1u), 2 * at[1] + (octant >> 1 & 1u), 2 * at[2] + (octant >> 2)};
    };
    for (std::uint32_t octant = 0; octant < 8; ++octant) {
      for (const std::uint32_t f : faces) {
        if (intersects_cell(corners(f), child(octant), depth + 1)) parts[octant].push_back(f);
      }
      sum += parts[octant].size();
    }
    if (sum > 2 * faces.size()) return false;
    for (std::uint32_t octant = 0; octant < 8; ++octant) add(child(octant), depth + 1, parts[octant], out);
    return true;
  }

  const TriangleMesh& mesh_;
  PartitionOptions options_;
  unsigned threads_;
  double margin_ = 0;    // by which cells are enlarged on each side, file units
  double extent_ = 0;    // longest side of the grid, file units
  double rounding_ = 0;  // upper bound of the rounding error of a projection onto an axis of length 1, file units
  std::array<std::uint32_t, 3> count_{};
  Partition out_{};
};

}  // namespace

bool triangle_intersects_cube(const std::array<Vec3d, 3>& triangle, const Vec3d& centre, double half_edge) {
  const Vec3d a = triangle[0] - centre, b = triangle[1] - centre, c = triangle[2] - centre;
  const auto apart = [&](const Vec3d& axis) {
    const double pa = axis.dot(a), pb = axis.dot(b), pc = axis.dot(c);
    const double reach = half_edge * (std::abs(axis[0]) + std::abs(axis[1]) + std::abs(axis[2]));
    return std::min({pa, pb, pc}) > reach || std::max({pa, pb, pc}) < -reach;
  };
  for (int axis = 0; axis < 3; ++axis) {
    if (apart(Vec3d::Unit(axis))) return false;
  }
  const std::array<Vec3d, 3> edges{Vec3d{b - a}, Vec3d{c - b}, Vec3d{a - c}};
  if (apart(edges[0].cross(edges[1]))) return false;
  for (const Vec3d& edge : edges) {
    for (int axis = 0; axis < 3; ++axis) {
      if (apart(Vec3d::Unit(axis).cross(edge))) return false;
    }
  }
  return true;
}

Partition partition(const TriangleMesh& mesh, const PartitionOptions& options, unsigned threads) {
  return Partitioner{mesh, options, threads}.run();
}

}  // namespace tactus::spm::offline
