/// A host's objects that can move: who simulates each of them, and the simulation while nobody holds it.
///
///     claims, poses of others -->  Arbiter  --> grants
///                                  SharedObject, 1 kHz while it moves --> poses
///
/// An object at rest that nobody holds costs a pose and a grant now and then, so that late comers learn where it is. Of
/// several hosts with one object the one that has been in the session for longest keeps it; when that is gone the next
/// goes on from where the object was last seen. An object that nobody holds when its only host starts anew stands where
/// the catalogue says.
///
/// Times come as arguments; no DDS, no thread. One thread at a time. Not realtime.
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
  std::int64_t pose_ns = 4'000'000;    ///< between poses of what moves
  std::int64_t rest_ns = 200'000'000;  ///< between those of what rests
};

class ObjectAuthority {
 public:
  explicit ObjectAuthority(const session::Origin& self, const ObjectAuthoritySettings& settings = {})
      : self_{self}, settings_{settings} {}

  /// What bodies meet beside the ground; none without. Must outlive the keeper.
  void stand_among(Scenery* scenery) noexcept { scenery_ = scenery; }
  /// What this host serves; what cannot move is passed over.
  void add(const session::CatalogueEntry& entry, std::int64_t now_ns);

  /// Other hosts' entries tell who else has an object.
  void on_catalogue(const session::CatalogueEntry& entry, std::int64_t now_ns);
  /// Session time since which another host, or this one, has been in the session.
  void on_host(std::uint64_t host, std::int64_t joined_ns, std::int64_t now_ns);
  void on_host_gone(std::uint64_t host, std::int64_t now_ns);
  /// Its claims begin anew when it comes back.
  void on_hrtc_gone(std::uint64_t hrtc);
  void on_claim(const session::ObjectClaim& claim, std::int64_t now_ns);
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns);

  struct Messages {
    std::vector<session::ObjectGrant> grants;
    std::vector<session::ObjectPose> poses;
  };
  /// Simulates up to now, 50 ms at most; what it leaves is to be published. Until the next tick.
  [[nodiscard]] const Messages& tick(std::int64_t now_ns, std::int64_t session_now_ns);

  /// Something moves here: the next tick is due within a millisecond.
  [[nodiscard]] bool busy() const noexcept { return busy_; }
  /// Somebody holds something: within some milliseconds.
  [[nodiscard]] bool held() const noexcept { return held_; }
  [[nodiscard]] bool empty() const noexcept { return objects_.empty(); }
  /// 1 kHz steps taken, over all objects.
  [[nodiscard]] std::uint64_t steps() const noexcept { return steps_; }
  /// Claims and poses dropped because they are outside their windows.
  [[nodiscard]] std::uint64_t implausible() const noexcept;

 private:
  struct Object {
    sharing::SharedBody body;
    std::unique_ptr<session::Arbiter> arbiter;  // null: another host keeps it
    haptics::SharedObject simulated;
    sharing::PoseInterpolator pose_interpolator;
    session::PoseGate gate;
    std::map<std::uint64_t, std::int64_t> others;  // hosts that serve it too; since when each is away, 0: it is here
    bool owned = false;
    std::int64_t stepped_ns = 0, published_ns = 0;
    std::uint32_t sequence = 0;
    std::uint64_t received = 0;

    explicit Object(const sharing::SharedBody& with)
        : body{with}, simulated{with.settings, with.start}, pose_interpolator{with.start} {}
  };

  void choose_authority(std::uint64_t id, Object& object, std::int64_t now_ns);
  void choose_authorities(std::int64_t now_ns);
  void forget_away(Object& object, std::int64_t now_ns) const;
  void simulate(Object& object, std::int64_t now_ns, std::int64_t session_now_ns);

  session::Origin self_;
  ObjectAuthoritySettings settings_;
  Scenery* scenery_ = nullptr;
  std::vector<haptics::Vec3d> met_;              // by all bodies, in this tick
  std::map<std::uint64_t, Object> objects_;      // by id
  std::map<std::uint64_t, std::int64_t> hosts_;  // that are here, this one too: session time of joining
  Messages messages_;
  bool busy_ = false, held_ = false;
  std::uint64_t steps_ = 0;
};

}  // namespace tactus::host_service
