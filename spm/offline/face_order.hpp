/// Orders the faces of a mesh so that neighbours in space have close numbers, and cuts a mesh into blocks.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Returns the old face numbers in their new order. In this order, every aligned interval of 2^k faces is compact in
/// space. So a tree has small boxes if each node at height h has 8^h consecutive faces. Splits the faces recursively
/// along the axis on which their centres extend furthest; the number of faces in the left part is a power of two.
/// Positions must be finite. O(n log n).
[[nodiscard]] std::vector<std::uint32_t> face_order(const TriangleMesh& mesh, unsigned threads = 0);

/// A face with its centre.
struct PlacedFace {
  std::array<float, 3> centre;
  std::uint32_t face;
};

/// The largest power of two below `count`; 1 if `count` is at most 2.
[[nodiscard]] std::size_t largest_power_below(std::size_t count);
/// Moves to the front the `left` faces whose centres have the smallest coordinates on the axis on which the centres
/// extend furthest.
void split_along_longest_axis(PlacedFace* faces, std::size_t count, std::size_t left);

/// Sorts the faces into compact blocks of at most `max` faces. Returns the start of each block and the end of the last.
/// Splits a larger block so that the left part has the share `share` (0 to 1) of its faces. With another share, the
/// blocks have other borders. O(n log blocks).
[[nodiscard]] std::vector<std::size_t> divide(std::span<PlacedFace> faces, std::size_t max, double share,
                                              unsigned threads);

}  // namespace tactus::spm::offline
