/// The order in which faces are numbered: the leaves, left to right, of a tree over the finest mesh; and its use to cut
/// a mesh into blocks.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Old face numbers in their new order. Every aligned run of 2^k faces lies close together, so a tree whose node at
/// height h spans 8^h consecutive ids has small boxes. Splits at a power of two along the longest axis of the centres.
/// Needs finite positions. O(n log n).
[[nodiscard]] std::vector<std::uint32_t> face_order(const TriangleMesh& mesh, unsigned threads = 0);

/// A face somewhere in space.
struct PlacedFace {
  std::array<float, 3> centre;
  std::uint32_t face;
};

/// How many of a node's faces go to its left half.
[[nodiscard]] std::size_t largest_power_below(std::size_t count);
/// Moves the `left` smallest along the longest axis to the front.
void split_along_longest_axis(PlacedFace* faces, std::size_t count, std::size_t left);

/// Moves the faces into blocks of `most` at most, each close together, and returns where each begins, and the end.
/// `share` of a block too large goes to its left half: other shares cut elsewhere. O(n log blocks).
[[nodiscard]] std::vector<std::size_t> divide(std::vector<PlacedFace>& faces, std::size_t max, double share,
                                              unsigned threads);

}  // namespace tactus::spm::offline
