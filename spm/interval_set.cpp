#include "spm/interval_set.hpp"

#include <algorithm>
#include <functional>

namespace tactus::spm {
namespace {

std::uint32_t end_of(const Interval& interval) { return interval.first + interval.count; }

}  // namespace

void IntervalSet::add(std::span<const Interval> added, std::size_t max) {
  std::vector<Interval> all;
  all.reserve(intervals_.size() + added.size());
  const auto append = [&](const Interval& interval) {
    if (!all.empty() && interval.first <= end_of(all.back()))
      all.back().count = std::max(end_of(all.back()), end_of(interval)) - all.back().first;
    else
      all.push_back(interval);
  };
  auto own = intervals_.begin();
  for (const Interval& interval : added) {
    for (; own != intervals_.end() && own->first < interval.first; ++own) append(*own);
    append(interval);
  }
  for (; own != intervals_.end(); ++own) append(*own);
  intervals_.assign(all.begin(), all.end());                  // releases unused memory
  if (intervals_.size() > max) remove_shortest(max / 4 * 3);  // removes a quarter more than necessary, so it is rare
}

void IntervalSet::remove_shortest(std::size_t remaining) {
  std::vector<std::uint32_t> counts;
  for (const Interval& interval : intervals_) counts.push_back(interval.count);
  const auto shortest = counts.begin() + static_cast<std::ptrdiff_t>(remaining - 1);  // of the remaining intervals
  std::nth_element(counts.begin(), shortest, counts.end(), std::greater<>{});
  auto equal = std::count(counts.begin(), shortest + 1, *shortest);  // remaining intervals of this length
  const auto is_removed = [&](const Interval& interval) {
    if (interval.count != *shortest) return interval.count < *shortest;
    if (equal == 0) return true;
    --equal;
    return false;
  };
  intervals_.erase(std::remove_if(intervals_.begin(), intervals_.end(), is_removed), intervals_.end());
  intervals_.shrink_to_fit();
}

std::vector<Interval> IntervalSet::missing(std::span<const Interval> intervals) const {
  std::vector<Interval> missing;
  auto own = intervals_.begin();
  for (const Interval& interval : intervals) {
    std::uint32_t at = interval.first;
    own = std::partition_point(own, intervals_.end(), [&](const Interval& present) { return end_of(present) <= at; });
    for (; at != end_of(interval);) {
      const std::uint32_t next =
          own == intervals_.end() ? end_of(interval) : std::min(std::max(own->first, at), end_of(interval));
      if (next != at) missing.push_back({at, next - at});
      if (next == end_of(interval)) break;
      at = std::min(end_of(*own), end_of(interval));
      if (at == end_of(*own)) ++own;
    }
  }
  missing.shrink_to_fit();  // the caller may store the result
  return missing;
}

}  // namespace tactus::spm
