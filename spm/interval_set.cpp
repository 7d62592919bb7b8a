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
  if (intervals_.size() > max) forget_shortest(max / 4 * 3);  // a quarter more, so that this is rare
}

void IntervalSet::forget_shortest(std::size_t left) {
  std::vector<std::uint32_t> counts;
  for (const Interval& interval : intervals_) counts.push_back(interval.count);
  const auto kept = counts.begin() + static_cast<std::ptrdiff_t>(left - 1);
  std::nth_element(counts.begin(), kept, counts.end(), std::greater<>{});
  auto equal = std::count(counts.begin(), kept + 1, *kept);  // how many as short as the shortest remaining one may stay
  const auto forgotten = [&](const Interval& interval) {
    if (interval.count != *kept) return interval.count < *kept;
    if (equal == 0) return true;
    --equal;
    return false;
  };
  intervals_.erase(std::remove_if(intervals_.begin(), intervals_.end(), forgotten), intervals_.end());
  intervals_.shrink_to_fit();
}

std::vector<Interval> IntervalSet::missing(std::span<const Interval> intervals) const {
  std::vector<Interval> left;
  auto own = intervals_.begin();
  for (const Interval& interval : intervals) {
    std::uint32_t at = interval.first;
    own = std::partition_point(own, intervals_.end(), [&](const Interval& held) { return end_of(held) <= at; });
    for (; at != end_of(interval);) {
      const std::uint32_t next =
          own == intervals_.end() ? end_of(interval) : std::min(std::max(own->first, at), end_of(interval));
      if (next != at) left.push_back({at, next - at});
      if (next == end_of(interval)) break;
      at = std::min(end_of(*own), end_of(interval));
      if (at == end_of(*own)) ++own;
    }
  }
  left.shrink_to_fit();  // the caller may store it
  return left;
}

}  // namespace tactus::spm
