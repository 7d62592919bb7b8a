/// A table of regions that stores each region once. If there are more regions than fit, the least urgent are dropped.
///
/// An Entry has three members. `region` is the RegionId. `precedes(other)` is a strict order of the entries of
/// different regions; it is true if this entry is more urgent. `merge(other)` combines two entries of one region and
/// never makes the entry less urgent. The remaining regions and their order do not depend on the order of the calls of
/// `add`. Memory is fixed. Realtime after construction: `add` is O(1) on average, `sort` O(n log n).
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/hash_multiplier.hpp"
#include "spm/ids.hpp"

namespace tactus::spm {

template <class Entry>
class RegionTable {
 public:
  /// `capacity` is the max number of regions, at least 1. Allocates.
  explicit RegionTable(std::uint32_t capacity)
      : capacity_{std::max(capacity, 1u)}, entries_(2 * std::size_t{capacity_}), bucket_of_(entries_.size()) {
    while (std::size_t{1} << bits_ < 2 * entries_.size()) ++bits_;
    buckets_.assign(std::size_t{1} << bits_, kNone);
  }

  void clear() noexcept {
    free_buckets();
    count_ = 0;
    has_limit_ = false;
    complete_ = true;
  }

  /// Do not call between `sort` and `clear`.
  void add(const Entry& entry) noexcept {
    const std::uint32_t bucket = find(entry.region);
    if (buckets_[bucket] != kNone) return entries_[buckets_[bucket]].merge(entry);
    if (has_limit_ && !entry.precedes(limit_)) {
      complete_ = false;
      return;
    }
    entries_[count_] = entry;
    fill_bucket(bucket, count_++);
    if (count_ == entries_.size()) reduce();
  }
  /// Makes complete() false, for a caller that could not find all regions.
  void mark_incomplete() noexcept { complete_ = false; }

  /// Sorts the entries, the most urgent first, and drops the least urgent ones beyond the capacity.
  void sort() noexcept {
    if (count_ > capacity_) reduce();
    std::sort(entries_.begin(), entries_.begin() + count_,
              [](const Entry& a, const Entry& b) { return a.precedes(b); });
  }

  /// The entries. After `sort` at most `capacity`; before, in no order and at most twice as many.
  [[nodiscard]] std::span<const Entry> entries() const noexcept { return {entries_.data(), count_}; }
  /// False if a region was dropped or `mark_incomplete` was called since `clear`.
  [[nodiscard]] bool complete() const noexcept { return complete_; }

 private:
  /// The region's position in the hash table, or the free position for it.
  [[nodiscard]] std::uint32_t find(RegionId region) const noexcept {
    const auto mask = static_cast<std::uint32_t>(buckets_.size() - 1);
    auto bucket = static_cast<std::uint32_t>(index(region) * multiplier_ >> (64 - bits_));
    while (buckets_[bucket] != kNone && entries_[buckets_[bucket]].region != region) bucket = (bucket + 1) & mask;
    return bucket;
  }
  void fill_bucket(std::uint32_t bucket, std::uint32_t number) noexcept {
    buckets_[bucket] = number;
    bucket_of_[number] = bucket;
  }
  void free_buckets() noexcept {
    for (std::uint32_t i = 0; i < count_; ++i) buckets_[bucket_of_[i]] = kNone;
  }
  /// Drops all entries but the `capacity` most urgent ones. Rare, because there is memory for twice the capacity.
  void reduce() noexcept {
    const auto least_urgent = entries_.begin() + (capacity_ - 1);
    free_buckets();
    std::nth_element(entries_.begin(), least_urgent, entries_.begin() + count_,
                     [](const Entry& a, const Entry& b) { return a.precedes(b); });
    limit_ = *least_urgent;
    has_limit_ = true;
    complete_ = false;
    count_ = capacity_;
    for (std::uint32_t i = 0; i < count_; ++i) fill_bucket(find(entries_[i].region), i);
  }

  std::uint32_t capacity_;
  std::vector<Entry> entries_;            // only the first count_ are valid
  std::vector<std::uint32_t> bucket_of_;  // by entry: index in buckets_
  std::vector<std::uint32_t> buckets_;    // hash table with open addressing: indices in entries_, or kNone
  std::uint64_t multiplier_ = hash_multiplier();
  unsigned bits_ = 1;  // log2 of the size of buckets_
  std::uint32_t count_ = 0;
  bool has_limit_ = false;  // `reduce` has set limit_: `capacity_` entries are at least as urgent as limit_
  Entry limit_{};
  bool complete_ = true;
};

}  // namespace tactus::spm
