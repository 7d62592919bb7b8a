/// Fixed-capacity map from a 64-bit key to a 32-bit number, by open addressing.
///
/// Sized once; never allocates again. Find, insert and erase are O(1) on average at the load it allows (one half).
/// Realtime. One thread at a time.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/assert.hpp"
#include "spm/ids.hpp"

namespace tactus::spm {

class FlatIndex {
 public:
  /// Room for `entries` keys; takes 16 bytes for each of the 2-4 places a key has. Allocates.
  explicit FlatIndex(std::uint32_t entries) {
    places_.assign(places_for(entries), Place{kEmpty, kNone});
    mask_ = static_cast<std::uint32_t>(places_.size() - 1);
  }
  /// What room for so many keys takes.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t entries) noexcept {
    return places_for(entries) * sizeof(Place);
  }

  /// The number stored under `key`, or kNone.
  [[nodiscard]] std::uint32_t find(std::uint64_t key) const noexcept {
    for (std::uint32_t at = home(key);; at = (at + 1) & mask_) {
      if (places_[at].key == key) return places_[at].value;
      if (places_[at].key == kEmpty) return kNone;
    }
  }

  /// Brings the place where `key` is looked for first into the cache.
  void prefetch(std::uint64_t key) const noexcept { __builtin_prefetch(&places_[home(key)]); }

  /// `key` must be absent, and not all ones.
  void insert(std::uint64_t key, std::uint32_t value) noexcept {
    TACTUS_ASSERT(key != kEmpty && find(key) == kNone && 2ull * (size_ + 1) <= places_.size());
    std::uint32_t at = home(key);
    while (places_[at].key != kEmpty) at = (at + 1) & mask_;
    places_[at] = {key, value};
    ++size_;
  }

  /// `key` must be present. Later keys of the same chain move up, so no trace is left.
  void erase(std::uint64_t key) noexcept {
    std::uint32_t hole = home(key);
    while (places_[hole].key != key) {
      TACTUS_ASSERT(places_[hole].key != kEmpty);
      hole = (hole + 1) & mask_;
    }
    for (std::uint32_t at = (hole + 1) & mask_; places_[at].key != kEmpty; at = (at + 1) & mask_) {
      const std::uint32_t distance_home = (at - home(places_[at].key)) & mask_;
      if (distance_home >= ((at - hole) & mask_)) {
        places_[hole] = places_[at];
        hole = at;
      }
    }
    places_[hole].key = kEmpty;
    --size_;
  }

  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }

 private:
  static constexpr std::uint64_t kEmpty = ~0ull;
  struct Place {
    std::uint64_t key;
    std::uint32_t value;
  };

  [[nodiscard]] static std::uint64_t places_for(std::uint32_t entries) noexcept {
    std::uint64_t places = 16;
    while (places < 2ull * entries) places *= 2;
    return places;
  }
  [[nodiscard]] std::uint32_t home(std::uint64_t key) const noexcept {
    key ^= key >> 32;
    key *= 0x9e3779b97f4a7c15ull;
    return static_cast<std::uint32_t>(key >> 32) & mask_;
  }

  std::vector<Place> places_;
  std::uint32_t mask_ = 0;
  std::uint32_t size_ = 0;
};

}  // namespace tactus::spm
