/// Independent pieces of work on several threads, in a way that the result cannot depend on how many there are.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <vector>

namespace tactus::spm::offline {

/// `threads`, or as many as this process may run at once when that is 0.
[[nodiscard]] unsigned thread_count(unsigned threads);

/// Calls `work(item, worker)` once for each item below `count`, on `threads` threads (0: all there are), items taken in
/// ascending order. Worker 0 is the calling thread. An item may write only what no other item reads or writes. When
/// items throw, rethrows what the first of them in order threw; items after it may not have run.
void parallel_for(std::size_t count, unsigned threads,
                  const std::function<void(std::size_t item, unsigned worker)>& work);

/// The same in ranges: `work(first, last)` for ranges of about `grain` items that together are [0, count).
void parallel_ranges(std::size_t count, std::size_t grain, unsigned threads,
                     const std::function<void(std::size_t first, std::size_t last)>& work);

/// The same with ranges that begin only where `joined(item)` does not hold, which says that an item belongs with the
/// one before it.
void parallel_groups(std::size_t count, std::size_t grain, unsigned threads,
                     const std::function<bool(std::size_t item)>& joined,
                     const std::function<void(std::size_t first, std::size_t last)>& work);

/// To which of `parts` equal ranges of 32-bit hashes this one belongs.
[[nodiscard]] constexpr std::uint32_t range_of_hash(std::uint32_t hash, std::uint32_t parts) noexcept {
  return static_cast<std::uint32_t>(std::uint64_t{hash} * parts >> 32);  // a size_t may have 32 bits only
}

/// Two pieces of work at once, the first in the calling thread unless there is one thread only.
void parallel_both(unsigned threads, const std::function<void()>& one, const std::function<void()>& other);

/// Sum of `value(item)` for items below `count`, added one after the other in their order.
[[nodiscard]] double parallel_sum(std::size_t count, unsigned threads,
                                  const std::function<double(std::size_t item)>& value);

/// Sorts by a strict total order: no two items may be equal, so that there is one result.
template <class Item, class Less>
void parallel_sort(std::vector<Item>& items, unsigned threads, Less less) {
  constexpr std::size_t kChunk = std::size_t{1} << 16;
  const auto at = [&](std::size_t i) { return items.begin() + static_cast<std::ptrdiff_t>(std::min(i, items.size())); };
  parallel_ranges(items.size(), kChunk, threads,
                  [&](std::size_t first, std::size_t last) { std::sort(at(first), at(last), less); });
  std::vector<Item> merged(items.size() > kChunk ? items.size() : 0);
  for (std::size_t width = kChunk; width < items.size(); width *= 2) {
    parallel_ranges(items.size(), 2 * width, threads, [&](std::size_t first, std::size_t last) {
      std::merge(at(first), at(first + width), at(first + width), at(last),
                 merged.begin() + static_cast<std::ptrdiff_t>(first), less);
    });
    items.swap(merged);
  }
}

}  // namespace tactus::spm::offline
