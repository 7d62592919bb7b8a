/// Decides which program simulates each movable object of a host, and simulates the objects that nobody holds.
///
///     claims, poses of others -->  Arbiter  --> grants
///                                  SharedObject, 1 kHz while it moves --> poses
///
/// An object at rest that nobody holds costs a pose and a grant every `rest_ns`, so that HRTCs which join later receive
/// its pose. If several hosts serve one object, the one that joined the session first is its authority. When that host
/// is gone, the next one continues from the last pose. If the only host restarts while nobody holds the object, the
/// object starts at its catalogue pose.
///
/// Times are arguments; no DDS, no thread. One thread at a time. Not realtime.
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
  std::int64_t pose_ns = 4'000'000;    ///< between poses of a moving object
  std::int64_t rest_ns = 200'000'000;  ///< between poses of an object at rest
};

class ObjectAuthority {
 public:
  explicit ObjectAuthority(const session::Origin& self, const ObjectAuthoritySettings& settings = {})
      : self_{self}, settings_{settings} {}

  /// Static objects that the bodies collide with; null: only the ground. Must outlive this object.
  void set_scenery(Scenery* scenery) noexcept { scenery_ = scenery; }
  /// Adds an object of this host; ignores a static one.
  void add(const session::CatalogueEntry& entry, std::int64_t now_ns);

  /// An entry of another host: that host serves the object too.
  void on_catalogue(const session::CatalogueEntry& entry, std::int64_t now_ns);
  /// `joined_ns`: session time at which this host or another one joined the session.
  void on_host(std::uint64_t host, std::int64_t joined_ns, std::int64_t now_ns);
  void on_host_gone(std::uint64_t host, std::int64_t now_ns);
  /// Claims of the HRTC are numbered anew when it returns.
  void on_hrtc_gone(std::uint64_t hrtc);
  void on_claim(const session::ObjectClaim& claim, std::int64_t now_ns);
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns);

  struct Messages {
    std::vector<session::ObjectGrant> grants;
    std::vector<session::ObjectPose> poses;
  };
  /// Simulates up to `now_ns`, 50 ms at most. The caller publishes the result, which is valid until the next tick.
  [[nodiscard]] const Messages& tick(std::int64_t now_ns, std::int64_t session_now_ns);

  /// This host simulates a moving object: the next tick is due within a millisecond.
  [[nodiscard]] bool busy() const noexcept { return busy_; }
  /// An HRTC holds an object: the next tick is due within some milliseconds.
  [[nodiscard]] bool held() const noexcept { return held_; }
  [[nodiscard]] bool empty() const noexcept { return objects_.empty(); }
  /// 1 kHz steps, summed over all objects.
  [[nodiscard]] std::uint64_t steps() const noexcept { return steps_; }
  /// Claims and poses that were dropped because they are outside their windows.
  [[nodiscard]] std::uint64_t implausible() const noexcept;

 private:
  struct Object {
    sharing::SharedBody body;
    std::unique_ptr<session::Arbiter> arbiter;  // null: another host is the authority
    haptics::SharedObject simulated;
    sharing::PoseInterpolator pose_interpolator;
    session::PoseGate gate;
    std::map<std::uint64_t, std::int64_t> others;  // other hosts that serve it: absent since; 0: present
    bool owned = false;
    std::int64_t stepped_ns = 0, published_ns = 0;
    std::uint32_t sequence = 0;
    std::uint64_t received = 0;

    explicit Object(const sharing::SharedBody& with)
        : body{with}, simulated{with.settings, with.start}, pose_interpolator{with.start} {}
  };

  void choose_authority(std::uint64_t id, Object& object, std::int64_t now_ns);
  void choose_authorities(std::int64_t now_ns);
  void drop_absent(Object& object, std::int64_t now_ns) const;
  void simulate(Object& object, std::int64_t now_ns, std::int64_t session_now_ns);

  session::Origin self_;
  ObjectAuthoritySettings settings_;
  Scenery* scenery_ = nullptr;
  std::vector<haptics::Vec3d> contact_points_;   // contact points of all bodies, in this tick
  std::map<std::uint64_t, Object> objects_;      // by id
  std::map<std::uint64_t, std::int64_t> hosts_;  // present hosts, including this one: session time of joining
  Messages messages_;
  bool busy_ = false, held_ = false;
  std::uint64_t steps_ = 0;
};

}  // namespace tactus::host_service
