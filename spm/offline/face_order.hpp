/// The order in which faces are numbered: the leaves, left to right, of a tree over the finest mesh.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Old face numbers in their new order. Every aligned run of 2^k faces lies close together, so a tree whose node at
/// height h spans 8^h consecutive ids has small boxes. Splits at a power of two along the longest axis of the centres.
/// Needs finite positions. O(n log n).
[[nodiscard]] std::vector<std::uint32_t> face_order(const TriangleMesh& mesh);

}  // namespace tactus::spm::offline
