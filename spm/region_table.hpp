/// The most urgent of the added regions, each of them once, in fixed memory.
///
/// An Entry has `region`; `before(other)`, a strict order of different regions with the more urgent first; and
/// `merge(other)`, which combines two entries of one region and never makes it less urgent. If there are more regions
/// than fit, the least urgent ones are dropped. The result does not depend on the order of the calls. Realtime after
/// construction: `add` is O(1) on average, `sort` O(n log n).
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/ids.hpp"

namespace tactus::spm {

template <class Entry>
class RegionTable {
 public:
  /// `capacity`: max regions, at least 1. Allocates.
  explicit RegionTable(std::uint32_t capacity)
      : capacity_{std::max(capacity, 1u)}, entries_(2 * std::size_t{capacity_}), place_of_(entries_.size()) {
    while (std::size_t{1} << bits_ < 2 * entries_.size()) ++bits_;
    places_.assign(std::size_t{1} << bits_, kNone);
  }

  void clear() noexcept {
    free_places();
    count_ = 0;
    full_ = false;
    complete_ = true;
  }

  /// Do not call between `sort` and `clear`.
  void add(const Entry& entry) noexcept {
    const std::uint32_t place = find(entry.region);
    if (places_[place] != kNone) return entries_[places_[place]].merge(entry);
    if (full_ && !entry.before(last_)) {
      complete_ = false;
      return;
    }
    entries_[count_] = entry;
    take_place(place, count_++);
    if (count_ == entries_.size()) reduce();
  }
  /// Notes that the caller could not find all regions.
  void miss() noexcept { complete_ = false; }

  /// Puts the most urgent first.
  void sort() noexcept {
    if (count_ > capacity_) reduce();
    std::sort(entries_.begin(), entries_.begin() + count_, [](const Entry& a, const Entry& b) { return a.before(b); });
  }

  /// After `sort`, at most the capacity.
  [[nodiscard]] std::span<const Entry> entries() const noexcept { return {entries_.data(), count_}; }
  /// False if a region was dropped or `miss` was called.
  [[nodiscard]] bool complete() const noexcept { return complete_; }

 private:
  /// The region's position in the hash table, or the free position for it.
  [[nodiscard]] std::uint32_t find(RegionId region) const noexcept {
    const auto mask = static_cast<std::uint32_t>(places_.size() - 1);
    std::uint32_t place = index(region) * 0x9e3779b9u >> (32 - bits_);
    while (places_[place] != kNone && entries_[places_[place]].region != region) place = (place + 1) & mask;
    return place;
  }
  void take_place(std::uint32_t place, std::uint32_t number) noexcept {
    places_[place] = number;
    place_of_[number] = place;
  }
  void free_places() noexcept {
    for (std::uint32_t i = 0; i < count_; ++i) places_[place_of_[i]] = kNone;
  }
  /// Drops all but the most urgent entries. Rare, because twice the capacity fits.
  void reduce() noexcept {
    const auto last = entries_.begin() + (capacity_ - 1);
    free_places();
    std::nth_element(entries_.begin(), last, entries_.begin() + count_,
                     [](const Entry& a, const Entry& b) { return a.before(b); });
    last_ = *last;
    full_ = true;
    complete_ = false;
    count_ = capacity_;
    for (std::uint32_t i = 0; i < count_; ++i) take_place(find(entries_[i].region), i);
  }

  std::uint32_t capacity_;
  std::vector<Entry> entries_;           // the first count_
  std::vector<std::uint32_t> place_of_;  // by entry: position in places_
  std::vector<std::uint32_t> places_;    // hash table with open addressing: entry numbers
  unsigned bits_ = 1;                    // log2 of the size of places_
  std::uint32_t count_ = 0;
  bool full_ = false;  // true: `capacity_` regions are at least as urgent as last_
  Entry last_{};
  bool complete_ = true;
};

}  // namespace tactus::spm
