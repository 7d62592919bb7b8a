/// Passes the newest value of one thread to another; a newer value overwrites an older one.
///
///     producer: post(a) post(b)            post(c)
///     consumer:                  take -> b         take -> c   take -> nothing new
///
/// Three slots: the producer owns one, the consumer owns one, and both exchange theirs with the third. One producer and
/// one consumer thread. Realtime at both ends: a copy and one atomic exchange, no wait.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace tactus::haptics {

template <class T>
class Mailbox {
  static_assert(std::is_trivially_destructible_v<T>, "a post copies the value and must not allocate");

 public:
  /// Until the first post, `latest` is `initial`.
  explicit Mailbox(const T& initial = T{}) noexcept : slots_{{{initial}, {initial}, {initial}}} {}
  Mailbox(const Mailbox&) = delete;
  Mailbox& operator=(const Mailbox&) = delete;

  /// Producer only: makes `value` the newest.
  void post(const T& value) noexcept {
    slots_[back_].value = value;
    back_ = between_.exchange(static_cast<std::uint8_t>(back_ | kNew), std::memory_order_acq_rel) & kSlot;
  }

  /// Consumer only: copies the newest value if the consumer has not seen it. Otherwise returns false and leaves `value`
  /// unchanged.
  [[nodiscard]] bool take(T& value) noexcept {
    if (!refresh()) return false;
    value = slots_[front_].value;
    return true;
  }

  /// Consumer only: returns the newest value, even if the consumer has seen it. Valid until the consumer's next call.
  [[nodiscard]] const T& latest() noexcept {
    refresh();
    return slots_[front_].value;
  }

 private:
  static constexpr std::uint8_t kSlot = 3;
  static constexpr std::uint8_t kNew = 4;  // the consumer has not seen the value in the shared slot

  bool refresh() noexcept {
    if ((between_.load(std::memory_order_relaxed) & kNew) == 0) return false;
    front_ = between_.exchange(front_, std::memory_order_acq_rel) & kSlot;
    return true;
  }

  struct alignas(64) Slot {
    T value;
  };
  std::array<Slot, 3> slots_;
  alignas(64) std::uint8_t back_ = 0;
  alignas(64) std::atomic<std::uint8_t> between_{1};
  alignas(64) std::uint8_t front_ = 2;
};

}  // namespace tactus::haptics
