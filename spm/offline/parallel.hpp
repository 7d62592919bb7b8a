/// Runs independent work on several threads. The results do not depend on the number of threads.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <vector>

namespace tactus::spm::offline {

/// Returns `threads`, or the number of processors if `threads` is 0.
[[nodiscard]] unsigned thread_count(unsigned threads);

/// Calls `work(item, worker)` once for each item below `count`, on `threads` threads (0: one per processor). The calls
/// begin in ascending order of the items. Worker 0 is the calling thread. A call must not write data that another call
/// uses. If calls throw, rethrows the exception of the first such item; the work of later items may be missing.
void parallel_for(std::size_t count, unsigned threads,
                  const std::function<void(std::size_t item, unsigned worker)>& work);

inline constexpr std::size_t kGrain = 1 << 16;  ///< items of a range if an item takes less than a microsecond

/// Like parallel_for, but calls `work(first, last)` for ranges of `grain` items that together are [0, count).
void parallel_ranges(std::size_t count, std::size_t grain, unsigned threads,
                     const std::function<void(std::size_t first, std::size_t last)>& work);

/// Like parallel_ranges, but no range begins with an item for which `continues_group(item)` is true: such an item is in
/// the range of the item before it. So all items of a group are in one range.
void parallel_groups(std::size_t count, std::size_t grain, unsigned threads,
                     const std::function<bool(std::size_t item)>& continues_group,
                     const std::function<void(std::size_t first, std::size_t last)>& work);

/// The number of the range in which a hash is, if all 32-bit hashes are divided into `parts` equal ranges.
[[nodiscard]] constexpr std::uint32_t range_of_hash(std::uint32_t hash, std::uint32_t parts) noexcept {
  return static_cast<std::uint32_t>(std::uint64_t{hash} * parts >> 32);  // a size_t may have 32 bits only
}

/// Runs two functions in parallel, or one after the other if there is a single thread.
void parallel_both(unsigned threads, const std::function<void()>& one, const std::function<void()>& other);

/// Returns the sum of `value(item)` over all items below `count`. Adds the values in the order of the items, so that
/// the rounding does not depend on the number of threads.
[[nodiscard]] double parallel_sum(std::size_t count, unsigned threads,
                                  const std::function<double(std::size_t item)>& value);

/// Sorts by a strict total order. No two items may be equal, so that the result is unique.
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
