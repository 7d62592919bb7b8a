/// The half of an HRTC that faces the session: it manages the regions, the simulators and the poses of the objects.
///
///     catalogue, chunks           --> Loader           --> demands           link: arrivals, near
///     grants, poses of others     --> OwnershipClient  --> claims            link: orders of bodies
///     link: reports of the servo  --> both
///
/// Policy without DDS, thread, clock, file or log: samples and times are arguments, samples to send are results. One
/// thread at a time. Not realtime.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "hrtc_service/loader.hpp"
#include "hrtc_service/ownership_client.hpp"
#include "hrtc_service/servo_link.hpp"
#include "session/clock.hpp"
#include "session/transit.hpp"

namespace tactus::hrtc_service {

struct GatewaySettings {
  LoaderSettings loader;
  session::OwnershipSettings ownership;
};

class Gateway {
 public:
  /// `pool`, `nodes` and `link` must outlive it, and it the servo's last cycle.
  Gateway(spm::Pool& pool, spm::NodePool& nodes, const session::Origin& self, const GatewaySettings& settings,
          ServoLink& link);

  /// One line for each event that an operator should see.
  std::function<void(const std::string&)> on_event;
  /// An object that is wanted from now on.
  std::function<void(const session::CatalogueEntry&)> on_object_found;
  /// An object that is shown from now on.
  std::function<void(const TouchObject&)> on_object;
  /// An object that was forgotten because no host offers it any more: one that was shown, once the servo has given it
  /// back; its index may come again.
  std::function<void(const Loader::ObjectInfo&)> on_object_gone;

  void on_catalogue(const session::CatalogueEntry& entry) { loader_.on_catalogue(entry); }
  void on_host_seen(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns) {
    loader_.on_host_seen(host, incarnation, now_ns);
  }
  void on_host_gone(std::uint64_t host) { loader_.on_host_gone(host); }
  void on_host_left(std::uint64_t host, std::uint64_t incarnation) { loader_.on_host_left(host, incarnation); }
  void on_host_silent(std::uint64_t host) { loader_.on_host_silent(host); }
  void on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns) { loader_.on_chunk(chunk, now_ns); }
  void on_grant(const session::ObjectGrant& grant, std::int64_t now_ns) { ownership_.on_grant(grant, now_ns); }
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns);
  /// The time that any sample of a peer's probe class took, ns. Counts only while the clock is set.
  void on_transit(std::int64_t transit_ns, std::int64_t session_now_ns) noexcept;
  /// When the newest copy of a peer came.
  void on_peer_received(std::uint32_t object_index, std::int64_t now_ns) {
    ownership_.on_peer_received(object_index, now_ns);
  }

  /// Every few milliseconds: takes the servo's reports, moves objects, predicts, evicts, hands regions over.
  void tick(std::int64_t now_ns, const session::ClockMap& clock);
  /// The claims that the last tick made.
  [[nodiscard]] const std::vector<session::ObjectClaim>& claims() const noexcept { return claims_; }
  /// The next demand to publish, until none is due.
  [[nodiscard]] std::optional<session::Demand> demand(std::int64_t now_ns) { return loader_.demand(now_ns); }

  /// The newest reports; `fresh` when the last tick took them.
  [[nodiscard]] const ProbeReports& reports() const noexcept { return reports_; }
  [[nodiscard]] bool fresh() const noexcept { return fresh_; }
  [[nodiscard]] const std::array<ProbeSight, kMaxProbes>& sights() const noexcept { return sights_; }
  /// Objects near each probe, as of the last tick.
  [[nodiscard]] const std::array<NearObjects, kMaxProbes>& near() const noexcept { return near_; }
  [[nodiscard]] const Loader& loader() const noexcept { return loader_; }
  [[nodiscard]] const OwnershipClient& ownership() const noexcept { return ownership_; }
  /// Movable objects whose pose changed since the last call, where they stand now.
  [[nodiscard]] std::vector<session::CatalogueEntry> take_moved();

 private:
  struct Movable {
    session::CatalogueEntry entry;  // where it stands
    bool moved = false;             // since take_moved
  };

  void take_reports();
  void move_objects();

  ServoLink& link_;
  Loader loader_;
  OwnershipClient ownership_;
  session::TransitEstimator transit_;
  bool clock_is_set_ = false;                 // before, differences to the session time of others are not transits
  std::map<std::uint64_t, Movable> movable_;  // by object
  ProbeReports reports_;
  BodyReports body_reports_;
  bool fresh_ = false;
  std::array<ProbeSight, kMaxProbes> sights_;
  std::array<NearObjects, kMaxProbes> near_;
  std::vector<session::ObjectClaim> claims_;
};

}  // namespace tactus::hrtc_service
