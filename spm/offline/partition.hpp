/// The even partition of the model's bounds: which finest faces intersect which cell.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

struct PartitionOptions {
  std::uint32_t cell_faces = 400;       ///< target for the finest faces of a cell
  std::uint32_t max_cell_faces = 1000;  ///< a cell with more is divided in eight, if that separates its faces
};

struct Cell {
  std::array<std::uint16_t, 3> at;  ///< x, y, z at its depth
  std::uint16_t depth;
  std::array<std::uint32_t, 2> occupied;  ///< as Region::occupied
  std::uint32_t first_face, face_count;   ///< in `Partition::faces`
};

struct Partition {
  GridFrame grid;
  std::vector<Cell> cells;           ///< labelled cells, in Morton order; none is inside another
  std::vector<std::uint32_t> faces;  ///< of all cells, ascending within each
};

/// A face belongs to every cell that its triangle intersects. The test is in double, with slightly enlarged cells, so
/// that the cell of each point of a face has the face. Cells are at least a thousandth of the longest side.
[[nodiscard]] Partition partition(const TriangleMesh& mesh, const PartitionOptions& options, unsigned threads = 0);

/// True if the triangle intersects the closed cube around `centre`; in double, without margin.
/// Source: Akenine-Moeller 2001 (separating axes of a triangle and a box).
[[nodiscard]] bool triangle_meets_box(const std::array<Vec3d, 3>& triangle, const Vec3d& centre, double half_edge);

/// Bits of x, y, z interleaved, x lowest; 21 bits of each count.
[[nodiscard]] std::uint64_t morton(std::uint32_t x, std::uint32_t y, std::uint32_t z);

}  // namespace tactus::spm::offline
