/// Divides a model's bounds into cells and finds the finest faces that intersect each cell.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

struct PartitionOptions {
  std::uint32_t cell_faces = 400;       ///< desired mean number of finest faces of a cell
  std::uint32_t max_cell_faces = 1000;  ///< a cell with more faces is divided into eight, if that separates its faces
};

struct Cell {
  std::array<std::uint16_t, 3> at;        ///< x, y, z, in cells of this depth
  std::uint16_t depth;                    ///< number of times that a cell of the even grid was divided
  std::array<std::uint32_t, 2> occupied;  ///< bits of the occupied subcells, as Region::occupied
  std::uint32_t first_face, face_count;   ///< range in `Partition::faces`
};

struct Partition {
  GridFrame grid;
  std::vector<Cell> cells;           ///< labelled cells, in Morton order; none is inside another
  std::vector<std::uint32_t> faces;  ///< faces of all cells, cell by cell; ascending within a cell
};

/// Divides the bounds of `mesh`. A face belongs to every cell that its triangle intersects. The test is in double, with
/// slightly enlarged cells: despite rounding, a cell that contains a point of a face always has the face. The edge of a
/// cell of depth 0 is at least a thousandth of the longest side of the bounds. `threads`: 0: one per processor.
[[nodiscard]] Partition partition(const TriangleMesh& mesh, const PartitionOptions& options, unsigned threads = 0);

/// True if the triangle intersects or touches the cube around `centre`. Computes in double, without margin.
/// Source: Akenine-Moeller 2001 (separating axes of a triangle and a box).
[[nodiscard]] bool triangle_intersects_cube(const std::array<Vec3d, 3>& triangle, const Vec3d& centre,
                                            double half_edge);

}  // namespace tactus::spm::offline
