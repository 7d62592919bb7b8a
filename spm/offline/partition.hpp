/// The even partition of the bounding volume: which finest faces meet which cell.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

struct PartitionOptions {
  std::uint32_t cell_faces = 400;       ///< finest faces aimed at in a cell
  std::uint32_t max_cell_faces = 1000;  ///< a cell with more is divided in eight, where that helps
};

struct Cell {
  std::array<std::uint16_t, 3> at;  ///< x, y, z at its depth
  std::uint16_t depth;
  std::array<std::uint32_t, 2> occupied;  ///< as Region::occupied
  std::uint32_t first_face, face_count;   ///< in `Partition::faces`
};

struct Partition {
  GridFrame grid;
  std::vector<Cell> cells;           ///< labelled cells only, in Morton order; none lies within another
  std::vector<std::uint32_t> faces;  ///< of all cells, ascending within each
};

/// A face belongs to every cell that its triangle meets, decided in double with cells a hair larger than they are, so
/// that a point on a face always has its cell. Cells are at least a thousandth of the longest side.
[[nodiscard]] Partition partition(const TriangleMesh& mesh, const PartitionOptions& options, unsigned threads = 0);

/// Whether the triangle meets the cube around `centre`, faces included; in double, without a margin.
/// Source: Akenine-Moeller 2001 (separating axes of a triangle and a box).
[[nodiscard]] bool triangle_meets_box(const std::array<Vec3d, 3>& triangle, const Vec3d& centre, double half_edge);

/// Bits of x, y, z interleaved, x lowest; 21 bits of each count.
[[nodiscard]] std::uint64_t morton(std::uint32_t x, std::uint32_t y, std::uint32_t z);

}  // namespace tactus::spm::offline
