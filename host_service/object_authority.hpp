/// Decides which programs simulate each movable object of a host, and simulates the objects that no HRTC simulates.
///
///     claims, poses of others -->  OwnershipArbiter --> grants
///                                  SharedObject, 1 kHz while it moves --> poses
///
/// For an object at rest the host sends a pose every `rest_ns` and a grant every OwnershipSettings::idle_ns, so that
/// HRTCs which join later receive them. If several hosts serve one object, the host that joined the session first is
/// its authority. When that host has left, the next one continues from the last pose. If the only host restarts while
/// no HRTC simulates the object, the object starts at its catalogue pose.
///
/// Times are arguments. Uses no DDS and no thread. One thread at a time. Not realtime.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "haptics/shared_object.hpp"
#include "host_service/scenery.hpp"
#include "session/ownership.hpp"
#include "sharing/pose_interpolator.hpp"

namespace tactus::host_service {

struct ObjectAuthoritySettings {
  session::OwnershipSettings ownership;
  std::int64_t pose_ns = 4'000'000;    ///< time between two poses of a moving object
  std::int64_t rest_ns = 200'000'000;  ///< time between two poses of an object at rest
};

class ObjectAuthority {
 public:
  explicit ObjectAuthority(const session::Origin& self, const ObjectAuthoritySettings& settings = {})
      : self_{self}, settings_{settings} {}

  /// Sets the static objects with which the bodies collide; null: only the ground. `scenery` must outlive this object.
  void set_scenery(Scenery* scenery) noexcept { scenery_ = scenery; }
  /// Adds an object of this host; ignores a static one.
  void add(const session::CatalogueEntry& entry, std::int64_t now_ns);

  /// Processes a catalogue entry of another host, which serves the object too or has withdrawn it.
  void on_catalogue(const session::CatalogueEntry& entry, std::int64_t now_ns);
  /// Records that `host`, which may be this one, joined the session at session time `joined_ns`.
  void on_host(std::uint64_t host, std::int64_t joined_ns, std::int64_t now_ns);
  void on_host_gone(std::uint64_t host, std::int64_t now_ns);
  /// Forgets the claims of the HRTC, because their numbers begin again when it returns.
  void on_hrtc_gone(std::uint64_t hrtc);
  void on_claim(const session::ObjectClaim& claim, std::int64_t now_ns);
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns);

  struct Messages {
    std::vector<session::ObjectGrant> grants;
    std::vector<session::ObjectPose> poses;
  };
  /// Simulates up to `now_ns`, 50 ms at most. The caller publishes the result, which is valid until the next tick.
  [[nodiscard]] const Messages& tick(std::int64_t now_ns, std::int64_t session_now_ns);

  /// Returns whether this host simulates a moving object; the next tick is then due after 1 ms.
  [[nodiscard]] bool busy() const noexcept { return busy_; }
  /// Returns whether an HRTC simulates an object of this host, or may do so because the host has just started. The next
  /// tick is then due after a few milliseconds.
  [[nodiscard]] bool is_any_simulated_elsewhere() const noexcept { return is_any_simulated_elsewhere_; }
  [[nodiscard]] bool empty() const noexcept { return objects_.empty(); }
  /// Returns the number of simulation steps, summed over all objects.
  [[nodiscard]] std::uint64_t steps() const noexcept { return steps_; }
  /// Returns the number of claims and poses that were dropped because a number or time was not plausible.
  [[nodiscard]] std::uint64_t implausible() const noexcept;
  /// Returns the number of claims of OwnershipArbiter::refused(), summed over all objects.
  [[nodiscard]] std::uint64_t claims_refused() const noexcept;

 private:
  struct Object {
    sharing::SharedBody body;
    std::unique_ptr<session::OwnershipArbiter> arbiter;  // null: another host is the authority
    haptics::SharedObject shared_object;
    sharing::PoseInterpolator pose_interpolator;
    session::PoseAdmission pose_admission;
    /// For each other host that serves the object: time since which that host is absent; 0: it is present.
    std::map<std::uint64_t, std::int64_t> other_hosts;
    bool is_simulated_here = false;
    std::int64_t stepped_ns = 0, published_ns = 0;
    std::uint32_t sequence = 0;
    std::uint64_t received = 0;  // number of accepted poses of other programs

    explicit Object(const sharing::SharedBody& with)
        : body{with}, shared_object{with.settings, with.start}, pose_interpolator{with.start} {}
  };

  void choose_authority(std::uint64_t id, Object& object, std::int64_t now_ns);
  void choose_authorities(std::int64_t now_ns);
  void drop_absent(Object& object, std::int64_t now_ns) const;
  void simulate(Object& object, std::int64_t now_ns, std::int64_t session_now_ns);

  session::Origin self_;
  ObjectAuthoritySettings settings_;
  Scenery* scenery_ = nullptr;
  std::vector<haptics::Vec3d> contact_points_;   // of all bodies with static objects, in this tick
  std::map<std::uint64_t, Object> objects_;      // by id
  std::map<std::uint64_t, std::int64_t> hosts_;  // session time of joining, by present host
  Messages messages_;
  bool busy_ = false, is_any_simulated_elsewhere_ = false;
  std::uint64_t steps_ = 0;
};

}  // namespace tactus::host_service
