/// The core of a VE host: serves regions, and decides which programs simulate its objects.
///
///     demands                        --> DeliveryServer       --> chunks
///     claims, poses, catalogues      --> ObjectAuthority      --> grants, poses
///     roster entries, clock samples  --> Roster, SessionClock --> roster entry, clock samples
///     stops, resets                  --> StopLatch            --> roster entry
///
/// The core has no DDS, thread, clock, file or log. Samples and times are arguments, and the functions return the
/// samples to send. The caller opens the models. The service, studies, benchmarks and tests use this class. One thread
/// at a time. Not realtime.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "host_service/host_config.hpp"
#include "host_service/object_authority.hpp"
#include "host_service/scenery.hpp"
#include "session/clock.hpp"
#include "session/delivery_server.hpp"
#include "session/periodic.hpp"
#include "session/roster.hpp"
#include "session/severity.hpp"
#include "session/stop_latch.hpp"

namespace tactus::host_service {

struct HostedObject {
  ObjectConfig config;                                 ///< its model file is not read
  const spm::codec::CompressedModel* model = nullptr;  ///< outlives the host
};

struct HostCoreSettings {
  std::string name;                   ///< of the participant
  std::string session;                ///< session to join
  std::vector<HostedObject> objects;  ///< each with a different name
  std::array<double, 3> at{0, 0, 0};  ///< m, position of the first object without a pose; others follow along x
  ObjectAuthoritySettings authority;
  std::size_t chunk_bytes = session::kMaxPayload;  ///< as of session::DeliveryServer
};

/// Returns the settings of a host with one object, which is at the origin and has the scale of its model.
[[nodiscard]] HostCoreSettings host_of(const std::string& object, const spm::codec::CompressedModel& model);

/// The samples to send after a tick, in this order.
struct HostMessages {
  bool catalogue = false;  ///< true: send all entries of HostCore::catalogue()
  std::optional<session::RosterEntry> roster;
  std::optional<session::ClockSample> clock_request;
  std::optional<session::Metrics> metrics;
  std::vector<session::ObjectGrant> grants;
  std::vector<session::ObjectPose> poses;
};

/// The reason why a host has to leave.
enum class HostEnd : std::uint8_t {
  kNone,
  kSession,   ///< the session has ended
  kNameTaken  ///< an older program of the same name is in the session
};

class HostCore {
 public:
  /// The time in `self` is not used. If there are movable objects, the constructor decodes the base meshes of the
  /// static ones.
  HostCore(const session::Origin& self, const HostCoreSettings& settings, std::int64_t now_ns);
  HostCore(const HostCore&) = delete;
  HostCore& operator=(const HostCore&) = delete;

  /// Receives one line for each event that an operator should see.
  std::function<void(session::Severity, const std::string&)> on_event;
  /// Called with a new receiver of meshes: an HRTC that has joined or returned, or a viewer that requests its first
  /// object of this host. Chunks and answers for it may follow.
  std::function<void(std::uint64_t participant, const std::string& name)> on_receiver;
  /// Called when a receiver has left. No samples for it follow until the next `on_receiver`.
  std::function<void(std::uint64_t participant)> on_receiver_gone;

  void on_roster(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_demand(const session::Demand& demand, std::int64_t now_ns);
  /// Returns the answer to publish at once, if `sample` is a request that this host has to answer. `arrived_ns`: time
  /// of arrival of `sample`.
  [[nodiscard]] std::optional<session::ClockSample> on_clock(const session::ClockSample& sample,
                                                             std::int64_t arrived_ns, std::int64_t now_ns);
  /// Returns the answer to the request of an HRTC's failure detector; send the answer to that HRTC only. It shows that
  /// this host lives, even if the host has no session time yet.
  [[nodiscard]] std::optional<session::ClockSample> on_failure_detector(const session::ClockSample& request,
                                                                        std::int64_t arrived_ns, std::int64_t now_ns);
  void on_stop(const session::EmergencyStop& stop) { (void)stops_.on_stop(stop.name()); }
  void on_reset(const session::ForceReset& reset) { (void)stops_.on_reset(reset); }
  void on_end(const session::SessionEnd& end);
  void on_catalogue(const session::CatalogueEntry& entry) { authority_.on_catalogue(entry); }
  void on_claim(const session::ObjectClaim& claim, std::int64_t now_ns) { authority_.on_claim(claim, now_ns); }
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns) {
    authority_.on_pose(pose, now_ns, clock_.map().session_time(now_ns));
  }

  /// Returns the samples that are due. Call it after samples have arrived and at `due_ns`, at least every 50 ms. The
  /// result is valid until the next tick.
  [[nodiscard]] const HostMessages& tick(std::int64_t now_ns);
  /// Returns the next chunk to send. Returns none if no chunk is due before `due_ns` or the next demand. Skips each
  /// HRTC for which `can_send` is false.
  [[nodiscard]] std::optional<session::Outgoing> next_chunk(std::int64_t now_ns,
                                                            const session::DeliveryServer::CanSend& can_send = {}) {
    return delivery_.next(now_ns, can_send);
  }
  /// Returns the time at which `tick` or `next_chunk` has to be called again if no sample arrives before. Call it
  /// after `tick`, and after `next_chunk` has returned none.
  [[nodiscard]] std::int64_t due_ns() const noexcept;

  /// Returns the catalogue entries of the host's objects.
  [[nodiscard]] const std::vector<session::CatalogueEntry>& catalogue() const noexcept { return catalogue_; }
  /// Returns a roster entry with the next heartbeat number. Only for additional entries; `tick` returns the periodic
  /// ones.
  [[nodiscard]] session::RosterEntry roster_entry(std::int64_t now_ns);
  [[nodiscard]] session::Metrics metrics(std::int64_t now_ns) const;

  [[nodiscard]] HostEnd end() const noexcept { return end_; }
  [[nodiscard]] const session::DeliveryServer& delivery() const noexcept { return delivery_; }
  [[nodiscard]] const ObjectAuthority& authority() const noexcept { return authority_; }
  [[nodiscard]] const session::SessionClock& clock() const noexcept { return clock_; }

 private:
  void make_catalogue(const HostCoreSettings& settings);
  void add_receiver(const session::RosterEntry& entry);
  void make_scenery(const std::vector<HostedObject>& objects);
  void react(const session::RosterEvent& event, std::int64_t now_ns);
  void report_damage();
  void move_objects(std::int64_t now_ns);
  [[nodiscard]] session::Origin origin(std::int64_t now_ns) const;
  void report(session::Severity severity, const std::string& text) const;

  session::Origin self_;
  std::string name_, session_;
  session::DeliveryServer delivery_;
  session::Roster roster_;
  session::SessionClock clock_;
  session::StopLatch stops_;        // forwarded to HRTCs that start after a stop
  std::optional<Scenery> scenery_;  // if there are movable and static objects
  ObjectAuthority authority_;
  std::vector<session::CatalogueEntry> catalogue_;
  std::map<std::uint64_t, std::string> receivers_;  // names of present HRTCs, and of viewers that requested a mesh
  std::optional<std::int64_t> ticked_ns_;           // time of the last tick
  std::int64_t objects_due_ns_ = 0;
  session::Heartbeat heartbeat_;
  session::PeriodicTimer request_due_, metrics_due_;
  std::uint64_t beats_ = 0;            // RosterEntry::heartbeat of the last entry
  std::uint64_t stops_announced_ = 0;  // StopLatch::changes at the last tick
  std::uint64_t demands_refused_ = 0, demands_implausible_ = 0;
  HostEnd end_ = HostEnd::kNone;
  HostMessages messages_;
};

}  // namespace tactus::host_service
