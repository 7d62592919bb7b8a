/// The set of free indices of a pool. `allocate` returns a free index near a given one, so that data that is used
/// together is on few memory pages, however long the pool has been in use.
///
/// Indices are in groups of 64. `allocate` prefers the group of `near`, then the next group that is completely free,
/// then the next group with a free index. `allocate` is O(size / 4096) in the worst case, `release` O(1). Realtime
/// after construction. One thread at a time.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "spm/assert.hpp"
#include "spm/ids.hpp"

namespace tactus::spm {

class FreeSet {
 public:
  /// Creates a set in which all indices below `size` are free. Allocates.
  explicit FreeSet(std::uint32_t size)
      : groups_(words_for(size), ~std::uint64_t{0}),
        any_free_(words_for(groups_.size()), 0),
        all_free_(any_free_),
        size_{size},
        count_{size} {
    if (size % 64 != 0) groups_.back() = (std::uint64_t{1} << size % 64) - 1;
    for (std::uint32_t group = 0; group < groups_.size(); ++group) update_group(group);
  }

  /// Returns the bytes of a set of this size.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t size) noexcept {
    return sizeof(std::uint64_t) * (words_for(size) + 2 * words_for(words_for(size)));
  }

  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }
  [[nodiscard]] std::uint32_t count() const noexcept { return count_; }

  [[nodiscard]] bool is_free(std::uint32_t number) const noexcept {
    return (groups_[number / 64] >> number % 64 & 1u) != 0;
  }

  /// Returns the index that `allocate(near)` would return. At least one index must be free, and `near` must be below
  /// the size.
  [[nodiscard]] std::uint32_t next_free(std::uint32_t near) const noexcept {
    TACTUS_ASSERT(count_ > 0 && near < size_);
    std::uint32_t group = near / 64, bit = near % 64;
    if (groups_[group] == 0) {
      const std::uint32_t whole = first_from(all_free_, group);
      group = whole != kNone ? whole : first_from(any_free_, group);
      bit = 0;
    }
    const std::uint64_t bits = groups_[group], ahead = bits >> bit;
    return 64 * group + (ahead != 0 ? bit + static_cast<std::uint32_t>(std::countr_zero(ahead))
                                    : static_cast<std::uint32_t>(std::bit_width(bits)) - 1);
  }
  std::uint32_t allocate(std::uint32_t near) noexcept {
    const std::uint32_t number = next_free(near);
    groups_[number / 64] &= ~(std::uint64_t{1} << number % 64);
    update_group(number / 64);
    --count_;
    return number;
  }

  /// Makes `number` free. It must have been allocated.
  void release(std::uint32_t number) noexcept {
    TACTUS_ASSERT(number < size_ && !is_free(number));
    groups_[number / 64] |= std::uint64_t{1} << number % 64;
    update_group(number / 64);
    ++count_;
  }

 private:
  using Words = std::vector<std::uint64_t>;  // bit array, lowest bit first

  [[nodiscard]] static std::size_t words_for(std::size_t bits) noexcept { return (bits + 63) / 64; }
  static void set(Words& words, std::uint32_t bit, bool value) noexcept {
    const std::uint64_t mask = std::uint64_t{1} << bit % 64;
    words[bit / 64] = value ? words[bit / 64] | mask : words[bit / 64] & ~mask;
  }
  void update_group(std::uint32_t group) noexcept {
    set(any_free_, group, groups_[group] != 0);
    set(all_free_, group, groups_[group] == ~std::uint64_t{0});
  }
  /// Returns the first set bit at or after `from`; if there is none, the first set bit; if no bit is set, kNone.
  [[nodiscard]] static std::uint32_t first_from(const Words& words, std::uint32_t from) noexcept {
    std::size_t at = from / 64;
    std::uint64_t bits = words[at] & ~std::uint64_t{0} << from % 64;
    for (std::size_t looked = 0; bits == 0; bits = words[at]) {
      if (++looked > words.size()) return kNone;
      at = at + 1 < words.size() ? at + 1 : 0;
    }
    return static_cast<std::uint32_t>(64 * at) + static_cast<std::uint32_t>(std::countr_zero(bits));
  }

  Words groups_;               // by index: it is free
  Words any_free_, all_free_;  // by group: at least one index is free; all are free
  std::uint32_t size_;
  std::uint32_t count_;
};

}  // namespace tactus::spm
