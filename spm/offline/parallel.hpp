/// Independent work on several threads, with a result that does not depend on their number.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <vector>

namespace tactus::spm::offline {

/// `threads`, or the number of processors of this process if `threads` is 0.
[[nodiscard]] unsigned thread_count(unsigned threads);

/// Calls `work(item, worker)` once for each item below `count`, on `threads` threads (0: all processors), in ascending
/// order of the items. Worker 0 is the calling thread. Items must not share data that one of them writes. If items
/// throw, rethrows the exception of the first of them in order; later items may not have run.
void parallel_for(std::size_t count, unsigned threads,
                  const std::function<void(std::size_t item, unsigned worker)>& work);

/// The same in ranges: `work(first, last)` for ranges of about `grain` items that together are [0, count).
void parallel_ranges(std::size_t count, std::size_t grain, unsigned threads,
                     const std::function<void(std::size_t first, std::size_t last)>& work);

/// The same, but no range begins at an item for which `joined(item)` is true: the item belongs to the previous one.
void parallel_groups(std::size_t count, std::size_t grain, unsigned threads,
                     const std::function<bool(std::size_t item)>& joined,
                     const std::function<void(std::size_t first, std::size_t last)>& work);

/// The range of a hash if all 32-bit hashes are divided into `parts` equal ranges.
[[nodiscard]] constexpr std::uint32_t range_of_hash(std::uint32_t hash, std::uint32_t parts) noexcept {
  return static_cast<std::uint32_t>(std::uint64_t{hash} * parts >> 32);  // a size_t may have 32 bits only
}

/// Runs two functions in parallel, or one after the other with a single thread.
void parallel_both(unsigned threads, const std::function<void()>& one, const std::function<void()>& other);

/// Sum of `value(item)` for items below `count`, added in order.
[[nodiscard]] double parallel_sum(std::size_t count, unsigned threads,
                                  const std::function<double(std::size_t item)>& value);

/// Sorts by a strict total order. Items must be different, so that the result is unique.
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
