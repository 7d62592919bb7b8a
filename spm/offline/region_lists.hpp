/// Computes the closed list of each region, and an order of the records in which each list has few intervals.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "spm/offline/closure.hpp"
#include "spm/offline/partition.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// One list of collapses for each cell of the partition, in the order of the cells. A collapse stands for the record
/// that undoes it.
class RegionLists {
 public:
  /// Finds, for each cell, the collapses that the corners of its faces need, directly or indirectly. Calls `progress`
  /// with the finished share, 0 to 1. `threads`: 0: one per processor.
  RegionLists(const TriangleMesh& mesh, const Partition& cells, const Dependencies& needs, unsigned threads,
              const std::function<void(double)>& progress);

  /// Number of lists.
  [[nodiscard]] std::size_t size() const noexcept { return cells_; }
  /// The list of a cell; sorted after `renumber`.
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t cell) const {
    const Group& group = groups_[cell / kGroup];
    const std::size_t i = cell % kGroup, first = i == 0 ? 0 : group.ends[i - 1];
    return {group.collapses.data() + first, group.ends[i] - first};
  }

  /// Returns all collapses in an order in which each collapse comes after those that it needs.
  ///
  /// The key of a collapse is the ascending list of the cells that need it. Keys are compared in lexicographic order,
  /// with a longer key before its own prefixes. If collapse B needs collapse A, every cell that needs B also needs A,
  /// so A comes first. Collapses with equal keys form one interval in the list of each of their cells.
  ///
  /// Within such an interval, the order is greedy. The next collapse is one whose dependencies are already placed.
  /// Among these, it is the one whose anchor has the face number nearest to that of the previous anchor, because a
  /// small difference takes few bits. The anchor of a collapse is its first face; `anchors` has the anchors by
  /// collapse.
  [[nodiscard]] std::vector<std::uint32_t> order(const Dependencies& needs, const std::vector<std::uint32_t>& anchors,
                                                 unsigned threads) const;

  /// Replaces each collapse c by `number[c]`, and sorts each list.
  void renumber(const std::vector<std::uint32_t>& number, unsigned threads);

 private:
  static constexpr std::size_t kGroup = 64;
  /// The lists of kGroup consecutive cells.
  struct Group {
    std::vector<std::size_t> ends;  // end of each list, as an index into `collapses`
    std::vector<std::uint32_t> collapses;
  };

  std::size_t cells_;  // number of cells
  std::vector<Group> groups_;
};

}  // namespace tactus::spm::offline
