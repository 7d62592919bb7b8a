/// Passes the newest value of one process to others, in memory that they share; a newer value overwrites an older one.
///
///     writer:   post(a) post(b)            post(c)
///     reader:                  take -> b         take -> c   take -> nothing new
///
/// Value n is in slot n modulo kSlots. A reader copies the newest slot, and then checks that the writer cannot have
/// overwritten it during the copy. Each end stores the number of its newest value in its own memory. A wrong number in
/// the mailbox therefore cannot cause an access outside it. A reader must check the value, because it may have any
/// bits. If a writer dies during a post, that value is lost and the next writer continues.
///
/// One writer at a time, any number of readers. Realtime for all: they copy the value and never wait. A copy takes
/// about 0.1 ns per byte.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace tactus::hrtc_service {

template <class T>
struct SharedMailbox {
  // Eigen's vectors are not trivially copyable by the letter of the standard, but they consist of numbers only.
  static_assert(std::is_trivially_destructible_v<T> && std::is_standard_layout_v<T>,
                "the other process copies the bits of a value");
  static constexpr std::uint64_t kSlots = 4;
  static constexpr std::size_t kWords = (sizeof(T) + 7) / 8;
  /// Atomic words, because a reader may copy a slot while the writer fills it.
  struct alignas(64) Slot {
    std::array<std::atomic<std::uint64_t>, kWords> words{};
  };

  alignas(64) std::atomic<std::uint64_t> posted{0};  ///< number of values since the start
  std::array<Slot, kSlots> slots{};
};

/// The end that posts. Begins where an earlier writer has ended.
template <class T>
class MailboxWriter {
 public:
  explicit MailboxWriter(SharedMailbox<T>& mailbox) noexcept : mailbox_{mailbox}, posted_{mailbox.posted.load()} {}

  /// Makes `value` the newest.
  void post(const T& value) noexcept {
    auto& words = mailbox_.slots[++posted_ % SharedMailbox<T>::kSlots].words;
    const auto* const bytes = reinterpret_cast<const unsigned char*>(&value);
    for (std::size_t i = 0; i < words.size(); ++i) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes + 8 * i, std::min<std::size_t>(8, sizeof(T) - 8 * i));
      // Release: a reader that sees this word also sees that earlier values are posted.
      words[i].store(word, std::memory_order_release);
    }
    mailbox_.posted.store(posted_, std::memory_order_release);
  }

 private:
  SharedMailbox<T>& mailbox_;
  std::uint64_t posted_;
};

/// An end that reads.
template <class T>
class MailboxReader {
 public:
  /// Until the first post, `latest` returns `initial` and `take` returns false.
  explicit MailboxReader(const SharedMailbox<T>& mailbox, const T& initial = T{}) noexcept
      : mailbox_{mailbox}, latest_{initial} {}

  /// Copies the newest value if this reader has not taken it. Otherwise returns false and leaves `value` unchanged.
  [[nodiscard]] bool take(T& value) noexcept {
    constexpr int kTries = 3;  // one is enough, unless this thread is suspended for three posts
    for (int i = 0; i < kTries; ++i) {
      const std::uint64_t posted = mailbox_.posted.load(std::memory_order_acquire);
      if (posted == taken_) return false;
      T copy;
      copy_slot(posted % SharedMailbox<T>::kSlots, copy);
      // The slot is filled again for value `posted` + kSlots, after the one before it has been posted.
      const std::uint64_t passed = mailbox_.posted.load(std::memory_order_relaxed) - posted;
      if (passed >= SharedMailbox<T>::kSlots - 1) continue;
      value = copy;
      taken_ = posted;
      return true;
    }
    return false;
  }
  /// Returns the newest value, also if this reader has taken it before. Valid until the next call.
  [[nodiscard]] const T& latest() noexcept {
    (void)take(latest_);
    return latest_;
  }

 private:
  void copy_slot(std::uint64_t slot, T& copy) const noexcept {
    const auto& words = mailbox_.slots[slot].words;
    auto* const bytes = reinterpret_cast<unsigned char*>(&copy);
    for (std::size_t i = 0; i < words.size(); ++i) {
      const std::uint64_t word = words[i].load(std::memory_order_acquire);
      std::memcpy(bytes + 8 * i, &word, std::min<std::size_t>(8, sizeof(T) - 8 * i));
    }
  }

  const SharedMailbox<T>& mailbox_;
  std::uint64_t taken_ = 0;  // number of the newest value that was taken
  T latest_;
};

}  // namespace tactus::hrtc_service
