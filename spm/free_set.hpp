/// The free numbers below a fixed size, such that a number can be taken next to another one.
///
/// Things that are used together are then on few pages, however long a pool has been in use. Numbers are in groups of
/// 64. `take` prefers the group of `near`, then the next group that is completely free, then the next group with a free
/// number. Sized once; never allocates again. `take` is O(size / 4096) in the worst case, `give` O(1). Realtime. One
/// thread at a time.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "spm/assert.hpp"
#include "spm/ids.hpp"

namespace tactus::spm {

class FreeSet {
 public:
  /// All are free. Allocates.
  explicit FreeSet(std::uint32_t size)
      : groups_(words_for(size), ~std::uint64_t{0}),
        some_(words_for(groups_.size()), 0),
        whole_(some_),
        size_{size},
        count_{size} {
    if (size % 64 != 0) groups_.back() = (std::uint64_t{1} << size % 64) - 1;
    for (std::uint32_t group = 0; group < groups_.size(); ++group) note(group);
  }

  /// Bytes of a set of this size.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t size) noexcept {
    return sizeof(std::uint64_t) * (words_for(size) + 2 * words_for(words_for(size)));
  }

  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }
  [[nodiscard]] std::uint32_t count() const noexcept { return count_; }

  [[nodiscard]] bool has(std::uint32_t number) const noexcept {
    return (groups_[number / 64] >> number % 64 & 1u) != 0;
  }

  /// The result of `take`. A number must be free, and `near` must be below the size.
  [[nodiscard]] std::uint32_t next(std::uint32_t near) const noexcept {
    TACTUS_ASSERT(count_ > 0 && near < size_);
    std::uint32_t group = near / 64, place = near % 64;
    if (groups_[group] == 0) {
      const std::uint32_t whole = first_from(whole_, group);
      group = whole != kNone ? whole : first_from(some_, group);
      place = 0;
    }
    const std::uint64_t bits = groups_[group], ahead = bits >> place;
    return 64 * group + (ahead != 0 ? place + static_cast<std::uint32_t>(std::countr_zero(ahead))
                                    : static_cast<std::uint32_t>(std::bit_width(bits)) - 1);
  }
  std::uint32_t take(std::uint32_t near) noexcept {
    const std::uint32_t number = next(near);
    groups_[number / 64] &= ~(std::uint64_t{1} << number % 64);
    note(number / 64);
    --count_;
    return number;
  }

  /// `number` must have been taken.
  void give(std::uint32_t number) noexcept {
    TACTUS_ASSERT(number < size_ && !has(number));
    groups_[number / 64] |= std::uint64_t{1} << number % 64;
    note(number / 64);
    ++count_;
  }

 private:
  using Words = std::vector<std::uint64_t>;  // one bit each, lowest first

  [[nodiscard]] static std::size_t words_for(std::size_t bits) noexcept { return (bits + 63) / 64; }
  static void set(Words& words, std::uint32_t bit, bool value) noexcept {
    const std::uint64_t mask = std::uint64_t{1} << bit % 64;
    words[bit / 64] = value ? words[bit / 64] | mask : words[bit / 64] & ~mask;
  }
  void note(std::uint32_t group) noexcept {
    set(some_, group, groups_[group] != 0);
    set(whole_, group, groups_[group] == ~std::uint64_t{0});
  }
  /// The first set bit at or after `from`, else the first from the start, else kNone.
  [[nodiscard]] static std::uint32_t first_from(const Words& words, std::uint32_t from) noexcept {
    std::size_t at = from / 64;
    std::uint64_t bits = words[at] & ~std::uint64_t{0} << from % 64;
    for (std::size_t looked = 0; bits == 0; bits = words[at]) {
      if (++looked > words.size()) return kNone;
      at = at + 1 < words.size() ? at + 1 : 0;
    }
    return static_cast<std::uint32_t>(64 * at) + static_cast<std::uint32_t>(std::countr_zero(bits));
  }

  Words groups_;        // by number: free
  Words some_, whole_;  // by group: a number is free; all are free
  std::uint32_t size_;
  std::uint32_t count_;
};

}  // namespace tactus::spm
