/// A hash map of fixed capacity from a 37-bit key to a 27-bit number. It uses open addressing and 12 bytes an entry.
///
/// The map is at most two thirds full, so `find`, `insert` and `erase` are O(1) on average. Realtime after
/// construction. One thread at a time.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/assert.hpp"
#include "spm/hash_multiplier.hpp"
#include "spm/ids.hpp"
#include "spm/prefetch.hpp"

namespace tactus::spm {

class FlatIndex {
 public:
  static constexpr int kKeyBits = 37;
  static constexpr int kValueBits = 64 - kKeyBits;

  /// Creates a map for at most `entries` keys. Allocates.
  explicit FlatIndex(std::uint32_t entries) : buckets_(buckets_for(entries), kEmpty) {}
  /// Returns the bytes of a map for `entries` keys.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t entries) noexcept {
    return buckets_for(entries) * sizeof(std::uint64_t);
  }

  /// The number stored under `key`, or kNone.
  [[nodiscard]] std::uint32_t find(std::uint64_t key) const noexcept {
    for (std::size_t at = first_bucket(key);; at = next_bucket(at)) {
      const std::uint64_t bucket = buckets_[at];
      if (bucket >> kValueBits == key) return static_cast<std::uint32_t>(bucket & kValueMask);
      if (bucket == kEmpty) return kNone;
    }
  }

  /// Prefetches the bucket at which a search for `key` starts.
  void prefetch(std::uint64_t key) const noexcept { spm::prefetch(&buckets_[first_bucket(key)]); }

  /// `key` must be absent. Key and value must fit their bits; a key of all ones is not allowed.
  void insert(std::uint64_t key, std::uint32_t value) noexcept {
    TACTUS_ASSERT(key < kEmpty >> kValueBits && value <= kValueMask);
    TACTUS_ASSERT(find(key) == kNone && size_ + 1 < buckets_.size());
    std::size_t at = first_bucket(key);
    while (buckets_[at] != kEmpty) at = next_bucket(at);
    buckets_[at] = key << kValueBits | value;
    ++size_;
  }

  /// `key` must be present. Moves later keys into the bucket that becomes empty, so that every search still finds its
  /// key without a tombstone.
  void erase(std::uint64_t key) noexcept {
    std::size_t hole = first_bucket(key);
    while (buckets_[hole] >> kValueBits != key) {
      TACTUS_ASSERT(buckets_[hole] != kEmpty);
      hole = next_bucket(hole);
    }
    for (std::size_t at = next_bucket(hole); buckets_[at] != kEmpty; at = next_bucket(at)) {
      if (distance(first_bucket(buckets_[at] >> kValueBits), at) < distance(hole, at)) continue;
      buckets_[hole] = buckets_[at];
      hole = at;
    }
    buckets_[hole] = kEmpty;
    --size_;
  }

  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }

 private:
  static constexpr std::uint64_t kEmpty = ~0ull;
  static constexpr std::uint64_t kValueMask = (1ull << kValueBits) - 1;

  [[nodiscard]] static std::uint64_t buckets_for(std::uint32_t entries) noexcept {
    return entries + entries / 2ull + 8;
  }
  [[nodiscard]] std::size_t first_bucket(std::uint64_t key) const noexcept {
    return (key * multiplier_ >> 32) * buckets_.size() >> 32;
  }
  [[nodiscard]] std::size_t next_bucket(std::size_t at) const noexcept {
    return at + 1 == buckets_.size() ? 0 : at + 1;
  }
  /// Number of buckets from `from` to `to`, wrapping around at the end.
  [[nodiscard]] std::size_t distance(std::size_t from, std::size_t to) const noexcept {
    return to >= from ? to - from : to + buckets_.size() - from;
  }

  std::vector<std::uint64_t> buckets_;
  std::uint64_t multiplier_ = hash_multiplier();
  std::uint32_t size_ = 0;
};

}  // namespace tactus::spm
