/// A hash map of fixed capacity from keys to numbers that does not store the keys. It uses open addressing and at most
/// 5.4 bytes an entry, half of FlatIndex.
///
/// A bucket contains a number and some bits of the hash of its key. `find` first compares these bits with those of the
/// hash. If they are equal, it calls `key_of(number)` and compares the keys. So a search calls `key_of` about once.
/// `erase` calls `key_of` for each number up to the next empty bucket.
///
/// The map is at most three quarters full, so `find`, `insert` and `erase` are O(1) on average. Realtime after
/// construction. One thread at a time.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "spm/assert.hpp"
#include "spm/hash_multiplier.hpp"
#include "spm/ids.hpp"
#include "spm/prefetch.hpp"

namespace tactus::spm {

class CompactIndex {
 public:
  /// Creates a map for at most `entries` keys, with numbers below `limit`. Allocates.
  CompactIndex(std::uint32_t entries, std::uint32_t limit)
      : buckets_(buckets_for(entries), kEmpty),
        number_bits_{static_cast<int>(std::bit_width(limit))},
        number_mask_{static_cast<std::uint32_t>((1ull << number_bits_) - 1)} {
    TACTUS_CHECK(number_bits_ < 32);
  }
  /// Returns the bytes of a map for `entries` keys.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t entries) noexcept {
    return buckets_for(entries) * sizeof(std::uint32_t);
  }

  /// The number stored under `key`, or kNone. `key_of` must return the key of each number in the map.
  template <class KeyOf>
  [[nodiscard]] std::uint32_t find(std::uint64_t key, const KeyOf& key_of) const noexcept {
    const std::uint32_t hash = hash_of(key);
    for (std::size_t at = first_bucket(hash);; at = next_bucket(at)) {
      const std::uint32_t bucket = buckets_[at];
      if (bucket == kEmpty) return kNone;
      const std::uint32_t number = bucket & number_mask_;
      if (bucket == bucket_of(hash, number) && key_of(number) == key) return number;
    }
  }

  /// The first number with the right bits of the hash, or kNone. `find` returns the same, except if two keys have these
  /// bits. For prefetches.
  [[nodiscard]] std::uint32_t guess(std::uint64_t key) const noexcept {
    return find(key, [key](std::uint32_t) { return key; });
  }
  /// Prefetches the bucket at which a search for `key` starts.
  void prefetch(std::uint64_t key) const noexcept { spm::prefetch(&buckets_[first_bucket(hash_of(key))]); }

  /// `key` must be absent, and `number` below the limit.
  void insert(std::uint64_t key, std::uint32_t number) noexcept {
    TACTUS_ASSERT(number < number_mask_ && size_ + 1 < buckets_.size());
    const std::uint32_t hash = hash_of(key);
    std::size_t at = first_bucket(hash);
    while (buckets_[at] != kEmpty) at = next_bucket(at);
    buckets_[at] = bucket_of(hash, number);
    ++size_;
  }

  /// Removes a number that is stored under `key`. Moves later numbers into the bucket that becomes empty, so that every
  /// search still finds its number without a tombstone.
  template <class KeyOf>
  void erase(std::uint64_t key, std::uint32_t number, const KeyOf& key_of) noexcept {
    const std::uint32_t hash = hash_of(key), erased = bucket_of(hash, number);
    std::size_t hole = first_bucket(hash);
    while (buckets_[hole] != erased) {
      TACTUS_ASSERT(buckets_[hole] != kEmpty);
      hole = next_bucket(hole);
    }
    for (std::size_t at = next_bucket(hole); buckets_[at] != kEmpty; at = next_bucket(at)) {
      const std::size_t first = first_bucket(hash_of(key_of(buckets_[at] & number_mask_)));
      if (distance(first, at) < distance(hole, at)) continue;
      buckets_[hole] = buckets_[at];
      hole = at;
    }
    buckets_[hole] = kEmpty;
    --size_;
  }

  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }

 private:
  static constexpr std::uint32_t kEmpty = kNone;  // no bucket has it: `insert` takes no number with all bits set

  [[nodiscard]] static std::uint64_t buckets_for(std::uint32_t entries) noexcept {
    return entries + entries / 3ull + 8;
  }
  [[nodiscard]] std::uint32_t hash_of(std::uint64_t key) const noexcept {
    return static_cast<std::uint32_t>(key * multiplier_ >> 32);
  }
  /// The upper bits of the hash determine the first bucket. The bucket contains some of the lower bits.
  [[nodiscard]] std::size_t first_bucket(std::uint32_t hash) const noexcept {
    return std::uint64_t{hash} * buckets_.size() >> 32;
  }
  [[nodiscard]] std::uint32_t bucket_of(std::uint32_t hash, std::uint32_t number) const noexcept {
    return hash << number_bits_ | number;
  }
  [[nodiscard]] std::size_t next_bucket(std::size_t at) const noexcept {
    return at + 1 == buckets_.size() ? 0 : at + 1;
  }
  /// Number of buckets from `from` to `to`, wrapping around at the end.
  [[nodiscard]] std::size_t distance(std::size_t from, std::size_t to) const noexcept {
    return to >= from ? to - from : to + buckets_.size() - from;
  }

  std::vector<std::uint32_t> buckets_;
  std::uint64_t multiplier_ = hash_multiplier();
  int number_bits_;
  std::uint32_t number_mask_;
  std::uint32_t size_ = 0;
};

}  // namespace tactus::spm
