/// A ring in memory that two processes share: one process pushes, the other pops.
///
///     RingWriter --push--> SharedRing --pop--> RingReader
///
/// Each end has its own position in its own memory and publishes only a copy. So neither end can make the other one
/// access memory outside the ring, whatever it writes. A reader must check the entries, because they may have any bits.
/// One writer and one reader at a time. Realtime for both: they copy entries and never wait.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <span>
#include <type_traits>

namespace tactus::hrtc_service {

template <class T, std::uint32_t kCapacity>
struct SharedRing {
  // As for SharedMailbox.
  static_assert(std::is_trivially_destructible_v<T> && std::is_standard_layout_v<T>,
                "the other process copies the bits of an entry");
  static_assert((kCapacity & (kCapacity - 1)) == 0, "positions stay correct when the counter overflows");

  alignas(64) std::atomic<std::uint64_t> pushed{0};  ///< number of entries since the start
  alignas(64) std::atomic<std::uint64_t> popped{0};
  alignas(64) std::array<T, kCapacity> entries{};
};

/// The end that pushes. Begins where an earlier writer has ended.
template <class T, std::uint32_t kCapacity>
class RingWriter {
 public:
  explicit RingWriter(SharedRing<T, kCapacity>& ring) noexcept : ring_{ring}, pushed_{ring.pushed.load()} {}

  /// Returns the number of free entries.
  [[nodiscard]] std::uint32_t space() const noexcept {
    const std::uint64_t used = pushed_ - ring_.popped.load(std::memory_order_acquire);
    return used < kCapacity ? static_cast<std::uint32_t>(kCapacity - used) : 0;
  }
  /// Pushes the first entries of `entries` that fit, and returns their number.
  std::uint32_t push(std::span<const T> entries) noexcept {
    const auto count = static_cast<std::uint32_t>(std::min<std::size_t>(entries.size(), space()));
    const auto at = static_cast<std::uint32_t>(pushed_ % kCapacity);
    const std::uint32_t until_end = std::min(count, kCapacity - at);
    std::copy_n(entries.data(), until_end, ring_.entries.data() + at);
    std::copy_n(entries.data() + until_end, count - until_end, ring_.entries.data());
    pushed_ += count;
    ring_.pushed.store(pushed_, std::memory_order_release);
    return count;
  }
  /// Returns the number of entries pushed since the ring was made, by this and earlier writers.
  [[nodiscard]] std::uint64_t position() const noexcept { return pushed_; }
  /// Returns false if the ring is full.
  [[nodiscard]] bool push(const T& entry) noexcept { return push(std::span{&entry, 1}) == 1; }

 private:
  SharedRing<T, kCapacity>& ring_;
  std::uint64_t pushed_;
};
template <class T, std::uint32_t kCapacity>
RingWriter(SharedRing<T, kCapacity>&) -> RingWriter<T, kCapacity>;

/// The end that pops. Begins where an earlier reader has ended.
template <class T, std::uint32_t kCapacity>
class RingReader {
 public:
  explicit RingReader(SharedRing<T, kCapacity>& ring) noexcept : ring_{ring}, popped_{ring.popped.load()} {}

  /// Returns the number of entries that wait.
  [[nodiscard]] std::uint32_t waiting() const noexcept {
    return static_cast<std::uint32_t>(
        std::min<std::uint64_t>(ring_.pushed.load(std::memory_order_acquire) - popped_, kCapacity));
  }
  /// Copies waiting entries to `entries`, at most its size, and returns their number.
  std::uint32_t pop(std::span<T> entries) noexcept {
    const auto count = static_cast<std::uint32_t>(std::min<std::size_t>(entries.size(), waiting()));
    const auto at = static_cast<std::uint32_t>(popped_ % kCapacity);
    const std::uint32_t until_end = std::min(count, kCapacity - at);
    std::copy_n(ring_.entries.data() + at, until_end, entries.data());
    std::copy_n(ring_.entries.data(), count - until_end, entries.data() + until_end);
    popped_ += count;
    ring_.popped.store(popped_, std::memory_order_release);
    return count;
  }
  /// Discards all entries that wait.
  void discard() noexcept { skip_to(ring_.pushed.load(std::memory_order_acquire)); }
  /// Continues at a position of the writer (RingWriter::position).
  void skip_to(std::uint64_t position) noexcept {
    popped_ = position;
    ring_.popped.store(popped_, std::memory_order_release);
  }
  /// Returns false if no entry waits.
  [[nodiscard]] bool pop(T& entry) noexcept {
    if (waiting() == 0) return false;
    entry = ring_.entries[popped_ % kCapacity];
    skip_to(popped_ + 1);
    return true;
  }

 private:
  SharedRing<T, kCapacity>& ring_;
  std::uint64_t popped_;
};
template <class T, std::uint32_t kCapacity>
RingReader(SharedRing<T, kCapacity>&) -> RingReader<T, kCapacity>;

}  // namespace tactus::hrtc_service
