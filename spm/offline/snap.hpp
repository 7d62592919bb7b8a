/// The compact profile: every coordinate moved to a grid, once, before anything else is made of the mesh.
#pragma once

#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Step of a grid with 2^bits places along the longest side of the bounds. `mesh` is clean and has faces. Throws
/// ModelError when the mesh has no extent, or lies so far from its origin that floats are coarser than that grid.
[[nodiscard]] double step_of_grid(const TriangleMesh& mesh, unsigned bits);

/// Moves each coordinate of a clean mesh to the nearest place of the grid of that step that begins at the lower bounds,
/// as ModelSummary::position_step has it, and cleans what became one. Doing it again changes nothing.
CleanReport snap(TriangleMesh& mesh, double step, unsigned threads = 0);

}  // namespace tactus::spm::offline
