/// Receives samples of the session, loads regions for the servo, and claims objects: the half of an HRTC without
/// forces.
///
///     from the session, from the servo             to the session, to the servo
///     catalogue, chunks; probe reports  --> Loader          --> demands; arrivals, near objects
///     grants, poses; body reports       --> OwnershipClient --> claims; orders for bodies
///
/// No DDS, thread, clock, file or log: samples and times are arguments, samples to send are results. One thread at a
/// time. Not realtime.
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
#include "hrtc_service/servo/servo_link.hpp"
#include "session/clock.hpp"
#include "session/transit.hpp"

namespace tactus::hrtc_service {

struct GatewaySettings {
  LoaderSettings loader;
  session::OwnershipSettings ownership;
};

class Gateway {
 public:
  /// `pool`: settings of the intake's pool. `link` must outlive the gateway.
  Gateway(const spm::PoolSettings& pool, const session::Origin& self, const GatewaySettings& settings, ServoLink& link);

  /// Called with one line for each event that an operator should see.
  std::function<void(session::Severity, const std::string&)> on_event;
  /// Called with each object whose base mesh is requested from now on.
  std::function<void(const session::CatalogueEntry&)> on_object_found;
  /// Called with each object that is passed to the servo.
  std::function<void(const ObjectDescription&)> on_object;
  /// Called with each removed object, after the intake has returned it. A later object may get its index.
  std::function<void(const Loader::ObjectInfo&)> on_object_gone;

  void on_catalogue(const session::CatalogueEntry& entry) { loader_.on_catalogue(entry); }
  /// Call it after the stops in the host's roster entry have been passed to the servo. From the first call on, the
  /// gateway is in the session (ServoLink::set_in_session).
  void on_host_heartbeat(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns) {
    link_.set_in_session(true);
    loader_.on_host_heartbeat(host, incarnation, now_ns);
  }
  void on_host_gone(std::uint64_t host) { loader_.on_host_gone(host); }
  void on_host_left(std::uint64_t host, std::uint64_t incarnation) { loader_.on_host_left(host, incarnation); }
  void on_host_silent(std::uint64_t host) { loader_.on_host_silent(host); }
  void on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns) { loader_.on_chunk(chunk, now_ns); }
  void on_grant(const session::ObjectGrant& grant, std::int64_t now_ns) { ownership_.on_grant(grant, now_ns); }
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns);
  /// Adds the transit time of a sample of the traffic class `probe`. Ignores it until session time is known.
  void on_transit(std::int64_t transit_ns, std::int64_t session_now_ns) noexcept;
  /// Stores the arrival time of the newest sample of a peer's copy.
  void on_peer_received(std::uint32_t object_index, std::int64_t now_ns) {
    ownership_.on_peer_received(object_index, now_ns);
  }

  /// Processes the servo's reports, and ticks loader and ownership client. Call it every few milliseconds.
  void tick(std::int64_t now_ns, const session::ClockMap& clock);
  /// Sends messages to the intake that did not fit into the ring. Returns whether all are sent.
  bool send_waiting() { return loader_.send_waiting(); }
  /// Returns the claims of the last tick.
  [[nodiscard]] const std::vector<session::ObjectClaim>& claims() const noexcept { return claims_; }
  /// Returns the next demand to publish, or nothing when none is due.
  [[nodiscard]] std::optional<session::Demand> demand(std::int64_t now_ns) { return loader_.demand(now_ns); }

  /// Returns the newest reports.
  [[nodiscard]] const ProbeReports& reports() const noexcept { return probe_reports_; }
  /// Returns whether the last tick received new reports.
  [[nodiscard]] bool has_new_reports() const noexcept { return has_new_reports_; }
  [[nodiscard]] const std::array<ReportedProbe, kMaxProbes>& reported_probes() const noexcept {
    return reported_probes_;
  }
  /// Returns the objects near each probe at the last tick.
  [[nodiscard]] const std::array<NearObjects, kMaxProbes>& near_objects() const noexcept { return near_objects_; }
  [[nodiscard]] const Loader& loader() const noexcept { return loader_; }
  [[nodiscard]] const OwnershipClient& ownership() const noexcept { return ownership_; }
  /// Returns the movable objects whose pose changed since the last call, with their current poses.
  [[nodiscard]] std::vector<session::CatalogueEntry> collect_moved();

 private:
  struct Movable {
    session::CatalogueEntry entry;  // with the current pose
    bool moved = false;             // since the last collect_moved
  };

  void take_reports();
  void move_objects();

  ServoLink& link_;
  MailboxReader<ProbeReports> reports_in_;
  MailboxReader<BodyReports> body_reports_in_;
  MailboxWriter<std::array<NearObjects, kMaxProbes>> near_out_;
  Loader loader_;
  OwnershipClient ownership_;
  session::TransitEstimator transit_;
  std::map<std::uint64_t, Movable> movable_;  // by object id
  ProbeReports probe_reports_;
  BodyReports body_reports_;
  bool has_new_reports_ = false;
  std::array<ReportedProbe, kMaxProbes> reported_probes_;
  std::array<NearObjects, kMaxProbes> near_objects_;
  std::vector<session::ObjectClaim> claims_;
};

}  // namespace tactus::hrtc_service
