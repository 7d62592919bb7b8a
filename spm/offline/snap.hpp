/// The compact profile: moves every coordinate to a grid, before any other step of a build.
#pragma once

#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// The step of a grid with 2^bits positions along the longest side of the bounds. `mesh` must be clean and have faces.
/// Throws ModelError if the mesh has no extent, or is so far from its origin that floats are coarser than the grid.
[[nodiscard]] double step_of_grid(const TriangleMesh& mesh, unsigned bits);

/// Moves each coordinate of a clean mesh to the nearest position of a grid with this step that begins at the lower
/// bounds (ModelSummary::position_step), and cleans the mesh. Idempotent.
CleanReport snap(TriangleMesh& mesh, double step, unsigned threads = 0);

}  // namespace tactus::spm::offline
