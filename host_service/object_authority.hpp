/// Decides which programs simulate each movable object of a host, and simulates the objects that no HRTC simulates.
///
///     claims, poses of others -->  OwnershipArbiter --> grants
///                                  SharedObject, 1 kHz while it moves --> poses
///
/// For an object at rest the host sends a pose every `rest_ns` and a grant every OwnershipSettings::idle_ns, so that
/// HRTCs which join later receive them. If several hosts serve one object, the host that joined the session first is
/// its authority. When that host has left or is silent, the next one takes over from the last pose. If the only host
/// restarts while no HRTC simulates the object, the object starts at its catalogue pose.
///
/// A host is silent if neither a heartbeat nor a pose of it has arrived for `silence_ns`. If only its samples were lost,
/// it is the authority again when its next heartbeat arrives. Until then both hosts simulate, and receivers accept the
/// poses with the larger fencing number. A host that was suspended does not know what happened meanwhile, so it waits
/// for one lease time and takes over from the last pose too.
///
/// Times are arguments. Uses no DDS and no thread. One thread at a time. Not realtime.
#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "haptics/shared_object.hpp"
#include "host_service/scenery.hpp"
#include "session/ownership.hpp"
#include "sharing/pose_interpolator.hpp"

namespace tactus::host_service {

/// Period of the heartbeats of a host while another host serves one of its movable objects too.
inline constexpr std::int64_t kSharedHeartbeatNs = 30'000'000;

struct ObjectAuthoritySettings {
  session::OwnershipSettings ownership;
  std::int64_t pose_ns = 4'000'000;    ///< time between two poses of a moving object
  std::int64_t rest_ns = 200'000'000;  ///< time between two poses of an object at rest
  /// Time without a sample after which another host is silent. If it sends a heartbeat every kSharedHeartbeatNs, seven
  /// consecutive ones are lost.
  std::int64_t silence_ns = 220'000'000;
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
  void on_catalogue(const session::CatalogueEntry& entry);
  /// Processes a heartbeat of `host`; `host` may be this program. `joined_ns`: session time at which it joined.
  void on_host(const session::Origin& host, std::int64_t joined_ns, std::int64_t now_ns);
  void on_host_gone(std::uint64_t host);
  /// Forgets the claims of the HRTC, because their numbers begin again when it returns.
  void on_hrtc_gone(std::uint64_t hrtc);
  void on_claim(const session::ObjectClaim& claim, std::int64_t now_ns);
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns);

  struct Messages {
    std::vector<session::ObjectGrant> grants;
    std::vector<session::ObjectPose> poses;
  };
  /// Simulates up to `now_ns`, 50 ms at most. The caller publishes the result, which is valid until the next tick. If
  /// more than 50 ms have passed since the last tick, only 50 ms count as silence of others, because a suspended
  /// program cannot process samples.
  [[nodiscard]] const Messages& tick(std::int64_t now_ns, std::int64_t session_now_ns);

  /// Returns whether this host simulates a moving object; the next tick is then due after 1 ms.
  [[nodiscard]] bool busy() const noexcept { return busy_; }
  /// Returns whether an HRTC simulates an object of this host, or may do so because the host has just started or has
  /// just taken the object over. The next tick is then due after a few milliseconds.
  [[nodiscard]] bool is_any_simulated_elsewhere() const noexcept { return is_any_simulated_elsewhere_; }
  [[nodiscard]] bool empty() const noexcept { return objects_.empty(); }
  /// Returns whether another host serves one of these objects. A host counts until it has been absent for 10 s.
  [[nodiscard]] bool shares_objects() const noexcept;
  /// Returns the number of simulation steps, summed over all objects.
  [[nodiscard]] std::uint64_t steps() const noexcept { return steps_; }
  /// Returns the number of claims and poses that were dropped because a number or time was not plausible.
  [[nodiscard]] std::uint64_t implausible() const noexcept;
  /// Returns the number of claims of OwnershipArbiter::refused(), summed over all objects.
  [[nodiscard]] std::uint64_t claims_refused() const noexcept;

 private:
  struct OtherHost {
    std::uint64_t incarnation;   // of its catalogue entry
    std::int64_t absent_ns = 0;  // time since which it is absent; 0: it is present
  };
  struct PresentHost {
    std::uint64_t incarnation;
    std::int64_t joined_ns;  // session time
    /// Arrival of its last heartbeat or pose, plus the time since then in which this program did not run.
    std::int64_t received_ns;
  };
  struct Object {
    sharing::SharedBody body;
    session::OwnershipArbiter arbiter;  // stands by while another host is the authority
    haptics::SharedObject shared_object;
    sharing::PoseInterpolator pose_interpolator;
    session::PoseAdmission pose_admission;
    std::map<std::uint64_t, OtherHost> other_hosts;  // other hosts that serve the object
    std::int64_t unknown_leases_end_ns = 0;          // until then a lease that another host granted may be unknown here
    bool is_simulated_here = false;
    std::int64_t stepped_ns = 0, published_ns = 0;
    std::uint32_t sequence = 0;
    std::uint64_t received = 0;  // number of accepted poses of other programs

    Object(const sharing::SharedBody& with, const session::OwnershipArbiter& arbiter_to_use)
        : body{with},
          arbiter{arbiter_to_use},
          shared_object{with.settings, with.start},
          pose_interpolator{with.start} {}
    void stop_simulating() {
      if (is_simulated_here) shared_object.follow();
      is_simulated_here = false;
    }
  };

  /// Returns the present host of an entry; null: it is absent, or has restarted without the object.
  [[nodiscard]] const PresentHost* find_present(std::uint64_t id, const OtherHost& other) const;
  /// Returns the other host that is the authority of the object; null: this host is.
  [[nodiscard]] const PresentHost* other_authority(const Object& object) const;
  void choose_authority(Object& object);
  void choose_authorities();
  /// Records until when the leases may be valid that others have granted. Call it before a host is removed.
  void note_leases();
  void drop_silent_hosts(std::int64_t now_ns);
  void wait_after_pause(std::int64_t now_ns);
  void drop_absent(Object& object, std::int64_t now_ns) const;
  void simulate(Object& object, std::int64_t now_ns, std::int64_t session_now_ns);

  session::Origin self_;
  ObjectAuthoritySettings settings_;
  Scenery* scenery_ = nullptr;
  std::vector<haptics::Vec3d> contact_points_;  // of all bodies with static objects, in this tick
  std::map<std::uint64_t, Object> objects_;     // by id
  std::map<std::uint64_t, PresentHost> hosts_;  // by participant
  std::int64_t ticked_ns_ = 0;
  Messages messages_;
  bool busy_ = false, is_any_simulated_elsewhere_ = false;
  std::uint64_t steps_ = 0;
};

}  // namespace tactus::host_service
