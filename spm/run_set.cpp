#include "spm/run_set.hpp"

#include <algorithm>
#include <functional>

namespace tactus::spm {
namespace {

std::uint32_t end_of(const Run& run) { return run.first + run.count; }

}  // namespace

void RunSet::add(Span<const Run> added, std::size_t most) {
  std::vector<Run> all;
  all.reserve(runs_.size() + added.size());
  const auto append = [&](const Run& run) {
    if (!all.empty() && run.first <= end_of(all.back()))
      all.back().count = std::max(end_of(all.back()), end_of(run)) - all.back().first;
    else
      all.push_back(run);
  };
  auto own = runs_.begin();
  for (const Run& run : added) {
    for (; own != runs_.end() && own->first < run.first; ++own) append(*own);
    append(run);
  }
  for (; own != runs_.end(); ++own) append(*own);
  runs_.assign(all.begin(), all.end());                    // no more memory than it takes
  if (runs_.size() > most) forget_shortest(most / 4 * 3);  // so that this is seldom done
}

void RunSet::forget_shortest(std::size_t left) {
  std::vector<std::uint32_t> counts;
  for (const Run& run : runs_) counts.push_back(run.count);
  const auto kept = counts.begin() + static_cast<std::ptrdiff_t>(left - 1);
  std::nth_element(counts.begin(), kept, counts.end(), std::greater<>{});
  auto equal = std::count(counts.begin(), kept + 1, *kept);  // of those as short as the shortest that stays
  const auto forgotten = [&](const Run& run) {
    if (run.count != *kept) return run.count < *kept;
    if (equal == 0) return true;
    --equal;
    return false;
  };
  runs_.erase(std::remove_if(runs_.begin(), runs_.end(), forgotten), runs_.end());
  runs_.shrink_to_fit();
}

std::vector<Run> RunSet::missing(Span<const Run> runs) const {
  std::vector<Run> left;
  auto own = runs_.begin();
  for (const Run& run : runs) {
    std::uint32_t at = run.first;
    own = std::partition_point(own, runs_.end(), [&](const Run& held) { return end_of(held) <= at; });
    for (; at != end_of(run);) {
      const std::uint32_t next = own == runs_.end() ? end_of(run) : std::min(std::max(own->first, at), end_of(run));
      if (next != at) left.push_back({at, next - at});
      if (next == end_of(run)) break;
      at = std::min(end_of(*own), end_of(run));
      if (at == end_of(*own)) ++own;
    }
  }
  left.shrink_to_fit();  // it may be kept
  return left;
}

}  // namespace tactus::spm
