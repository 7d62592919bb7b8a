/// Fixed-capacity map from a 37-bit key to a 27-bit number, by open addressing, 12 bytes an entry.
///
/// Sized once; never allocates again. Find, insert and erase are O(1) on average at the load it allows (two thirds).
/// Realtime. One thread at a time.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/assert.hpp"
#include "spm/ids.hpp"
#include "spm/prefetch.hpp"

namespace tactus::spm {

class FlatIndex {
 public:
  static constexpr int kKeyBits = 37;
  static constexpr int kValueBits = 64 - kKeyBits;

  /// Room for `entries` keys. Allocates.
  explicit FlatIndex(std::uint32_t entries) : places_(places_for(entries), kEmpty) {}
  /// Bytes for so many keys.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t entries) noexcept {
    return places_for(entries) * sizeof(std::uint64_t);
  }

  /// The number stored under `key`, or kNone.
  [[nodiscard]] std::uint32_t find(std::uint64_t key) const noexcept {
    for (std::size_t at = home(key);; at = after(at)) {
      const std::uint64_t place = places_[at];
      if (place >> kValueBits == key) return static_cast<std::uint32_t>(place & kValueMask);
      if (place == kEmpty) return kNone;
    }
  }

  /// Prefetches the first position of `key`.
  void prefetch(std::uint64_t key) const noexcept { spm::prefetch(&places_[home(key)]); }

  /// `key` must be absent. Key and value must fit their bits; a key of all ones is not allowed.
  void insert(std::uint64_t key, std::uint32_t value) noexcept {
    TACTUS_ASSERT(key < kEmpty >> kValueBits && value <= kValueMask);
    TACTUS_ASSERT(find(key) == kNone && size_ + 1 < places_.size());
    std::size_t at = home(key);
    while (places_[at] != kEmpty) at = after(at);
    places_[at] = key << kValueBits | value;
    ++size_;
  }

  /// `key` must be present. Moves later keys of the same chain up, so no tombstone remains.
  void erase(std::uint64_t key) noexcept {
    std::size_t hole = home(key);
    while (places_[hole] >> kValueBits != key) {
      TACTUS_ASSERT(places_[hole] != kEmpty);
      hole = after(hole);
    }
    for (std::size_t at = after(hole); places_[at] != kEmpty; at = after(at)) {
      if (distance(home(places_[at] >> kValueBits), at) < distance(hole, at)) continue;
      places_[hole] = places_[at];
      hole = at;
    }
    places_[hole] = kEmpty;
    --size_;
  }

  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }

 private:
  static constexpr std::uint64_t kEmpty = ~0ull;
  static constexpr std::uint64_t kValueMask = (1ull << kValueBits) - 1;

  [[nodiscard]] static std::uint64_t places_for(std::uint32_t entries) noexcept { return entries + entries / 2ull + 8; }
  [[nodiscard]] std::size_t home(std::uint64_t key) const noexcept {
    return (key * 0x9e3779b97f4a7c15ull >> 32) * places_.size() >> 32;
  }
  [[nodiscard]] std::size_t after(std::size_t at) const noexcept { return at + 1 == places_.size() ? 0 : at + 1; }
  /// Positions from `from` to `to`, wrapping around at the end.
  [[nodiscard]] std::size_t distance(std::size_t from, std::size_t to) const noexcept {
    return to >= from ? to - from : to + places_.size() - from;
  }

  std::vector<std::uint64_t> places_;
  std::uint32_t size_ = 0;
};

}  // namespace tactus::spm
