/// Passes the newest value of one thread to another; a newer value overwrites an older one.
///
///     producer: post(a) post(b)            post(c)
///     consumer:                  take -> b         take -> c   take -> nothing new
///
/// There are three slots. The producer owns one, the consumer owns one, and each exchanges its slot for the third. Only
/// one producer thread and one consumer thread may use a mailbox. Realtime for both: they copy the value and make one
/// atomic exchange, and never wait.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace tactus::haptics {

template <class T>
class Mailbox {
  static_assert(std::is_trivially_destructible_v<T>, "T may own no memory: its copies must not allocate");

 public:
  /// Until the first post, `latest` returns `initial` and `take` returns false.
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
  static constexpr std::uint8_t kSlot = 3;  // mask of the slot's number in `between_`
  static constexpr std::uint8_t kNew = 4;   // bit in `between_`: the consumer has not seen the value in that slot

  /// Exchanges slots, so that `front_` has the newest value. Returns false if it already had.
  bool refresh() noexcept {
    if ((between_.load(std::memory_order_relaxed) & kNew) == 0) return false;
    front_ = between_.exchange(front_, std::memory_order_acq_rel) & kSlot;
    return true;
  }

  struct alignas(64) Slot {
    T value;
  };
  std::array<Slot, 3> slots_;
  alignas(64) std::uint8_t back_ = 0;                 // slot of the producer
  alignas(64) std::atomic<std::uint8_t> between_{1};  // the third slot, and kNew
  alignas(64) std::uint8_t front_ = 2;                // slot of the consumer
};

}  // namespace tactus::haptics
