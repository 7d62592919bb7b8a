/// The object that a hand holds: the device is coupled to a point of it until the hand opens.
///
/// World frame, SI. The haptic thread's. Realtime.
#pragma once

#include "hrtc_service/probe.hpp"

namespace tactus::hrtc_service {

/// The object that a probe held in the last touch.
struct Held {
  std::uint32_t object = spm::kNone;  ///< index; kNone: it held no object
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

  /// Opens the hand when its button is up. Returns the index of the object that it holds, or kNone.
  std::uint32_t open(const haptics::DeviceState& device) noexcept;
  /// Follows the object, whose placement was `before` in the last cycle and is `now`.
  void follow(const ProbeStep& step, const TouchObject& object, const Placement& before, const Placement& now) noexcept;
  /// The force of the held object, after `follow`. The hand releases the object when its force has faded to zero, that
  /// is, when poses are `zero_by` seconds old: the object could be far away when the force returned.
  const haptics::ForceResult& render(const ProbeStep& step, double zero_by) noexcept;
  /// When the hand closes, holds the object that it touches at `place`, from the next touch on.
  /// `can_move`: the object. Its `placement` is of this touch.
  void close(const ProbeStep& step, const Vec3d& place, const Placement& placement, bool can_move) noexcept;

  /// What it holds is gone: the hand has to open before it can hold anything again. True when it held that object.
  bool lose(std::uint32_t object) noexcept {
    if (grasp_.object != object) return false;
    grasp_ = {};
    grasp_.spent = true;
    held_.object = spm::kNone;
    return true;
  }

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
    bool spent = false;                 // it lost the object, and must open before it can hold again
    Plain3 place{};                     // of the coupling, model frame
    Plain4 orientation{};               // of the device in the object's axes
  };

  Grasp grasp_;
  Held held_;
};

}  // namespace tactus::hrtc_service
