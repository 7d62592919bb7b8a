/// The most urgent of the regions that are added, each of them once, in fixed memory.
///
/// An Entry has `region`; `before(other)`, which puts the more urgent of two first and any two different regions in an
/// order; and `merge(other)`, which takes in a further entry of the same region and never makes it less urgent. When
/// there are more regions than fit, the least urgent ones are dropped, in whatever order they come. Realtime after
/// construction: `add` takes constant time on average, `sort` O(n log n).
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "spm/ids.hpp"
#include "spm/span.hpp"

namespace tactus::spm {

template <class Entry>
class RegionTable {
 public:
  /// `capacity`: regions at most, at least 1. Allocates.
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

  /// Not after `sort` until `clear`.
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
  /// Some region that should be here could not be found.
  void miss() noexcept { complete_ = false; }

  /// Puts the most urgent first.
  void sort() noexcept {
    if (count_ > capacity_) reduce();
    std::sort(entries_.begin(), entries_.begin() + count_, [](const Entry& a, const Entry& b) { return a.before(b); });
  }

  /// At most the capacity once sorted.
  [[nodiscard]] Span<const Entry> entries() const noexcept { return {entries_.data(), count_}; }
  /// False when a region was dropped or missed.
  [[nodiscard]] bool complete() const noexcept { return complete_; }

 private:
  /// The region's place in the open hash table, or the free one where it would stand.
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
  /// Drops all but the most urgent ones. Twice as many fit, so this is seldom.
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
  std::vector<std::uint32_t> place_of_;  // of each entry, in places_
  std::vector<std::uint32_t> places_;    // numbers of entries by open addressing
  unsigned bits_ = 1;                    // of a place
  std::uint32_t count_ = 0;
  bool full_ = false;  // then at least `capacity_` regions are as urgent as last_
  Entry last_{};
  bool complete_ = true;
};

}  // namespace tactus::spm
