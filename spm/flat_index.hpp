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
  /// Room for `entries` keys; takes 12 bytes for each of the 2-4 places a key has. Allocates.
  explicit FlatIndex(std::uint32_t entries) {
    std::uint32_t places = 16;
    while (places < 2ull * entries) places *= 2;
    keys_.assign(places, kEmpty);
    values_.assign(places, kNone);
    mask_ = places - 1;
  }

  /// The number stored under `key`, or kNone.
  [[nodiscard]] std::uint32_t find(std::uint64_t key) const noexcept {
    for (std::uint32_t place = home(key);; place = (place + 1) & mask_) {
      if (keys_[place] == key) return values_[place];
      if (keys_[place] == kEmpty) return kNone;
    }
  }

  /// `key` must be absent, and not all ones.
  void insert(std::uint64_t key, std::uint32_t value) noexcept {
    TACTUS_ASSERT(key != kEmpty && find(key) == kNone && 2ull * (size_ + 1) <= keys_.size());
    std::uint32_t place = home(key);
    while (keys_[place] != kEmpty) place = (place + 1) & mask_;
    keys_[place] = key;
    values_[place] = value;
    ++size_;
  }

  /// `key` must be present. Later keys of the same chain move up, so no trace is left.
  void erase(std::uint64_t key) noexcept {
    std::uint32_t hole = home(key);
    while (keys_[hole] != key) {
      TACTUS_ASSERT(keys_[hole] != kEmpty);
      hole = (hole + 1) & mask_;
    }
    for (std::uint32_t place = (hole + 1) & mask_; keys_[place] != kEmpty; place = (place + 1) & mask_) {
      const std::uint32_t distance_home = (place - home(keys_[place])) & mask_;
      if (distance_home >= ((place - hole) & mask_)) {
        keys_[hole] = keys_[place];
        values_[hole] = values_[place];
        hole = place;
      }
    }
    keys_[hole] = kEmpty;
    --size_;
  }

  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }

 private:
  static constexpr std::uint64_t kEmpty = ~0ull;

  [[nodiscard]] std::uint32_t home(std::uint64_t key) const noexcept {
    key ^= key >> 32;
    key *= 0x9e3779b97f4a7c15ull;
    return static_cast<std::uint32_t>(key >> 32) & mask_;
  }

  std::vector<std::uint64_t> keys_;
  std::vector<std::uint32_t> values_;
  std::uint32_t mask_ = 0;
  std::uint32_t size_ = 0;
};

}  // namespace tactus::spm
