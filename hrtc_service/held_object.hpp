/// What a hand has closed on: a place of an object, to which the device is coupled until the hand opens.
///
/// World frame, SI. The haptic thread's. Realtime.
#pragma once

#include "hrtc_service/probe.hpp"

namespace tactus::hrtc_service {

/// What a probe held on to in the last touch.
struct Held {
  std::uint32_t object = spm::kNone;  ///< index; none: it held nothing
  haptics::Hold hold;
  haptics::Feel feel;  ///< of the object
  haptics::ToolGrip grip;
  haptics::Wrench pull;  ///< on the hand, before limits
};

class HeldObject {
 public:
  void reset() noexcept {
    grasp_ = {};
    held_.object = spm::kNone;
  }

  /// Opens the hand when its button is up. Index of the object that it holds, or kNone.
  std::uint32_t open(const haptics::DeviceState& device) noexcept;
  /// Goes along with the object, which was at `before` in the last cycle and is at `now`.
  void follow(const ProbeStep& step, const TouchObject& object, const Placement& before, const Placement& now) noexcept;
  /// The force of what is held, after `follow`. A hand lets go once it feels nothing any more, and that is when poses
  /// are `zero_by` seconds old, or what it held would be far away when it feels again.
  const haptics::ForceResult& render(const ProbeStep& step, double zero_by) noexcept;
  /// Takes hold of the object that was touched at `place`, from the next touch on, when the hand closes.
  /// `can_move`: the object. Its `placement` is of this touch.
  void close(const ProbeStep& step, const Vec3d& place, const Placement& placement, bool can_move) noexcept;

  [[nodiscard]] const Held& held() const noexcept { return held_; }

  /// As Cycle's. `can_move`: of an object index.
  template <class Visit, class CanMove>
  void for_each_carried(Visit& visit, CanMove&& can_move) noexcept {
    const auto is_possible = [&](std::uint32_t object) {
      return object == spm::kNone || (object < kMaxObjects && can_move(object));
    };
    visit.checked("object in a hand", grasp_.object, is_possible, "one that can move, or none");
    visit.flag("flag of a hand", grasp_.spent);
    visit.number("place in a hand", grasp_.place), visit.any("orientation in a hand", grasp_.orientation);
  }

 private:
  /// From one touch to the next.
  struct Grasp {
    std::uint32_t object = spm::kNone;  // index
    bool spent = false;                 // has lost it, and has to open before it can close again
    Plain3 place{};                     // where, model frame
    Plain4 orientation{};               // of the device in the object's axes
  };

  Grasp grasp_;
  Held held_;
};

}  // namespace tactus::hrtc_service
