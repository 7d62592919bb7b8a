/// Passes lists of borrowed objects from an owner thread to a user thread, and reports when the user no longer uses the
/// earlier lists.
///
///     owner   post(list 7) ... post(list 8, without w)     is_adopted(8)? not yet     is_adopted(8)? yes: destroys w
///     user                 latest -> list 7, uses w                    latest -> list 8
///
///     w: an object, for example a writer, to which list 7 points and list 8 does not
///
/// The user takes no lock. The owner, not the user, destroys w, because destruction is slow. One owner thread, one user
/// thread. Realtime for the user.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <utility>

#include "haptics/mailbox.hpp"

namespace tactus::hrtc_service {

/// `List` must be trivially copyable. The user gets a copy.
template <class List>
class Handover {
 public:
  /// Replaces the list and returns its number. Owner thread.
  std::uint64_t post(const List& list) noexcept {
    mailbox_.post({++posted_, list});
    return posted_;
  }
  /// Returns whether the user has adopted this list or a later one, and so no longer uses earlier lists. Owner thread.
  [[nodiscard]] bool is_adopted(std::uint64_t number) const noexcept {
    return adopted_.load(std::memory_order_acquire) >= number;
  }

  /// Adopts the newest list. The result is valid until the next call. User thread.
  [[nodiscard]] const List& latest() noexcept {
    const Numbered& newest = mailbox_.latest();
    adopted_.store(newest.number, std::memory_order_release);
    return newest.list;
  }

 private:
  struct Numbered {
    std::uint64_t number = 0;
    List list{};
  };
  haptics::Mailbox<Numbered> mailbox_;
  std::uint64_t posted_ = 0;
  std::atomic<std::uint64_t> adopted_{0};
};

/// Holds objects of an earlier list until the user has adopted a later list.
template <class Thing>
class DeferredDestruction {
 public:
  void add(std::uint64_t number, Thing&& thing) { waiting_.emplace_back(number, std::move(thing)); }
  /// Destroys the objects for which `is_adopted(number)` is true. Requires calls of `add` with ascending numbers.
  template <class IsAdopted>
  void collect(IsAdopted&& is_adopted) {
    while (!waiting_.empty() && is_adopted(waiting_.front().first)) waiting_.pop_front();
  }
  [[nodiscard]] std::size_t size() const noexcept { return waiting_.size(); }

 private:
  std::deque<std::pair<std::uint64_t, Thing>> waiting_;
};

}  // namespace tactus::hrtc_service
