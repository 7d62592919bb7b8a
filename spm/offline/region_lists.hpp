/// The closed lists of records that regions need, and the order of records in which these lists are few intervals.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "spm/offline/closure.hpp"
#include "spm/offline/partition.hpp"
#include "spm/offline/triangle_mesh.hpp"
#include "spm/span.hpp"

namespace tactus::spm::offline {

/// By cell of the partition, in its order.
class RegionLists {
 public:
  /// Collapses that the corners of a cell's faces need, and all that these need. `progress` gets the share done.
  RegionLists(const TriangleMesh& mesh, const Partition& cells, const Dependencies& needs, unsigned threads,
              const std::function<void(double)>& progress);

  [[nodiscard]] std::size_t size() const noexcept { return cells_; }
  /// In no order until `renumber`.
  [[nodiscard]] Span<const std::uint32_t> of(std::size_t cell) const {
    const Chunk& chunk = chunks_[cell / kChunk];
    const std::size_t i = cell % kChunk, first = i == 0 ? 0 : chunk.ends[i - 1];
    return {chunk.collapses.data() + first, chunk.ends[i] - first};
  }

  /// All collapses in an order in which each comes after those that it needs. They ascend by the cells that need them,
  /// as words do by their letters, but with a longer word before those that it begins with: what needs a record is
  /// needed by no other cells than the record is, so the record comes first, and what the same cells need is one run in
  /// each of their lists. In such a run, what comes next is of all that may the one whose anchor, its first face, has
  /// the number nearest to the last one's: it takes the fewest bits to tell. `anchors` by collapse.
  [[nodiscard]] std::vector<std::uint32_t> order(const Dependencies& needs, const std::vector<std::uint32_t>& anchors,
                                                 unsigned threads) const;

  /// Turns collapses into `number[collapse]`, ascending in each list.
  void renumber(const std::vector<std::uint32_t>& number, unsigned threads);

 private:
  static constexpr std::size_t kChunk = 64;
  struct Chunk {
    std::vector<std::size_t> ends;  // of each of its lists in `collapses`
    std::vector<std::uint32_t> collapses;
  };

  std::size_t cells_;
  std::vector<Chunk> chunks_;
};

}  // namespace tactus::spm::offline
