/// Passes a list of borrowed objects from an owner thread to a user thread, and reports when the user no longer uses
/// the earlier lists.
///
///     owner   post(list 7) ... post(list 8, without w)     passed(8)? not yet     passed(8)? yes: destroys w
///     user                 latest -> list 7, uses w                    latest -> list 8
///
/// So the user takes no lock, and the owner does the slow work, such as destroying a DDS writer, when the user can no
/// longer use the object. One owner thread, one user thread. Realtime for the user.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <utility>

#include "haptics/mailbox.hpp"

namespace tactus::hrtc_service {

/// `List` is trivially copyable; the user gets a copy.
template <class List>
class Handover {
 public:
  /// Owner: replaces the list and returns its number.
  std::uint64_t post(const List& list) noexcept {
    mailbox_.post({++posted_, list});
    return posted_;
  }
  /// Owner: whether the user has taken this list or a later one. Then it uses nothing that only earlier lists name.
  [[nodiscard]] bool passed(std::uint64_t number) const noexcept {
    return taken_.load(std::memory_order_acquire) >= number;
  }

  /// User: the newest list, until the next call.
  [[nodiscard]] const List& latest() noexcept {
    const Numbered& newest = mailbox_.latest();
    taken_.store(newest.number, std::memory_order_release);
    return newest.list;
  }

 private:
  struct Numbered {
    std::uint64_t number = 0;
    List list{};
  };
  haptics::Mailbox<Numbered> mailbox_;
  std::uint64_t posted_ = 0;
  std::atomic<std::uint64_t> taken_{0};
};

/// Objects that are destroyed once the user has passed their number.
template <class Thing>
class Retired {
 public:
  void add(std::uint64_t number, Thing&& thing) { waiting_.emplace_back(number, std::move(thing)); }
  /// Destroys those for which `passed(number)` is true. Numbers ascend.
  template <class Passed>
  void collect(Passed&& passed) {
    while (!waiting_.empty() && passed(waiting_.front().first)) waiting_.pop_front();
  }
  [[nodiscard]] std::size_t size() const noexcept { return waiting_.size(); }

 private:
  std::deque<std::pair<std::uint64_t, Thing>> waiting_;
};

}  // namespace tactus::hrtc_service
