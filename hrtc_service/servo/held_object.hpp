/// Couples a device to the object that the hand holds, from the closing of the hand until it opens.
///
/// World frame, SI. Haptic thread. Realtime.
#pragma once

#include "hrtc_service/servo/probe.hpp"

namespace tactus::hrtc_service {

/// State of a probe's hold in the last touch.
struct HoldState {
  std::uint32_t object = spm::kNone;  ///< index of the held object; kNone: none
  haptics::Hold hold;
  haptics::ContactImpedance impedance;  ///< of the object
  haptics::ToolGrip grip;
  haptics::Wrench pull;  ///< wrench on the hand, before limits
};

class HeldObject {
 public:
  void reset() noexcept {
    grasp_ = {};
    held_.object = spm::kNone;
  }

  /// Releases the object if the grab button is up. Returns the index of the held object, or kNone.
  std::uint32_t release_if_open(const haptics::DeviceState& device) noexcept;
  /// Moves the hold with the object, from its placement `before` in the last cycle to `now`.
  void follow_object(const ProbeStep& step, const TouchObject& object, const Placement& before,
                     const Placement& now) noexcept;
  /// Computes the force of the hold, after `follow_object`. Releases the object after a fault, or if the pose is
  /// `zero_force_age` seconds old. The force is zero then. It must not return later, when the object may be far away.
  const haptics::ForceResult& render(const ProbeStep& step, double zero_force_age) noexcept;
  /// If the grab button is down, holds the touched object from the next touch on. `point`: where it is held, world;
  /// `placement`: of the object in this touch; `can_move`: whether the object is movable.
  void hold_if_closed(const ProbeStep& step, const Vec3d& point, const Placement& placement, bool can_move) noexcept;

  /// Releases a withdrawn object. Returns true if the hand held it; the hand must then open before it can hold again.
  bool lose_object(std::uint32_t object) noexcept {
    if (grasp_.object != object) return false;
    grasp_ = {};
    grasp_.must_open = true;
    held_.object = spm::kNone;
    return true;
  }

  [[nodiscard]] const HoldState& state() const noexcept { return held_; }

  /// As Cycle::for_each_carried. `can_move(object)`: whether the object of that index is movable.
  template <class Visit, class CanMove>
  void for_each_carried(Visit& visit, CanMove&& can_move) noexcept {
    const auto is_possible = [&](std::uint32_t object) {
      return object == spm::kNone || (object < kMaxObjects && can_move(object));
    };
    visit.checked("object in a hand", grasp_.object, is_possible, "one that can move, or none");
    visit.flag("flag of a hand", grasp_.must_open);
    visit.number("point in a hand", grasp_.point), visit.any("orientation in a hand", grasp_.orientation);
  }

 private:
  /// The hold from one touch to the next.
  struct Grasp {
    std::uint32_t object = spm::kNone;  // index
    bool must_open = false;             // the hand lost the object, and must open before it can hold again
    Plain3 point{};                     // of the coupling, model frame
    Plain4 orientation{};               // of the device in the object's axes
  };

  Grasp grasp_;
  HoldState held_;
};

}  // namespace tactus::hrtc_service
