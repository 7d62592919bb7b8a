/// Moves every coordinate of a mesh to a grid, for the compact profile. A build does this right after cleaning.
#pragma once

#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Returns the step of a grid with 2^bits positions along the longest side of the bounds. `mesh` must be clean and have
/// faces. Throws ModelError if the mesh has no extent, or is so far from the origin that floats are coarser than the
/// grid.
[[nodiscard]] double step_of_grid(const TriangleMesh& mesh, unsigned bits);

/// Moves each coordinate of a clean mesh to the nearest position of a grid, and cleans the mesh again. The grid has
/// this step and begins at the lower bounds of the mesh (ModelSummary::position_step). A second call changes nothing.
CleanReport snap(TriangleMesh& mesh, double step, unsigned threads = 0);

}  // namespace tactus::spm::offline
