/// Numbers the faces as the leaves of a tree over the finest mesh, from left to right, and cuts a mesh into blocks.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// The old face numbers in their new order. Every aligned interval of 2^k faces is compact in space, so a tree whose
/// node at height h covers 8^h consecutive ids has small boxes. Splits at a power of two along the longest axis of the
/// centres. Positions must be finite. O(n log n).
[[nodiscard]] std::vector<std::uint32_t> face_order(const TriangleMesh& mesh, unsigned threads = 0);

/// A face and its centre.
struct PlacedFace {
  std::array<float, 3> centre;
  std::uint32_t face;
};

/// The number of a node's faces that go to its left half.
[[nodiscard]] std::size_t largest_power_below(std::size_t count);
/// Moves the `left` smallest along the longest axis to the front.
void split_along_longest_axis(PlacedFace* faces, std::size_t count, std::size_t left);

/// Sorts the faces into compact blocks of at most `max` faces and returns the start of each block, and the end. `share`
/// of a block that is too large goes to its left half, so different shares cut at different positions.
/// O(n log blocks).
[[nodiscard]] std::vector<std::size_t> divide(std::vector<PlacedFace>& faces, std::size_t max, double share,
                                              unsigned threads);

}  // namespace tactus::spm::offline
