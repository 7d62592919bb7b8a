/// Helpers of the tests of wire/: session addresses that no other program uses, an inbox that waits for samples, and
/// samples whose fields are all set.
#pragma once

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "tests/support/test_domain.hpp"
#include "wire/endpoints.hpp"

namespace tactus::wire::test {

using namespace std::chrono_literals;
namespace ses = session;

/// Time after which a test that waits for an event fails.
inline constexpr auto kWatchdog = 20s;

using test_support::test_domain;

inline std::string unique_session(const std::string& tag) {
  static std::atomic<int> count{0};
  return "test." + tag + "." + std::to_string(getpid()) + "." + std::to_string(++count);
}

inline SessionAddress address(const std::string& session, const std::string& participant) {
  SessionAddress made;
  made.session = session;
  made.participant = participant;
  made.domain = test_domain();
  return made;
}

/// Collects the samples that a Reader receives.
template <class Sample>
class Inbox {
 public:
  auto callback() {
    return [this](Sample&& sample) {
      const std::lock_guard<std::mutex> lock{mutex_};
      samples_.push_back(std::move(sample));
      arrived_.notify_all();
    };
  }
  /// The oldest sample; waits up to `limit`.
  std::optional<Sample> next(std::chrono::nanoseconds limit = kWatchdog) {
    std::unique_lock<std::mutex> lock{mutex_};
    if (!arrived_.wait_for(lock, limit, [this] { return !samples_.empty(); })) return std::nullopt;
    Sample sample = std::move(samples_.front());
    samples_.pop_front();
    return sample;
  }
  std::size_t size() {
    const std::lock_guard<std::mutex> lock{mutex_};
    return samples_.size();
  }

 private:
  std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<Sample> samples_;
};

/// Polls `condition` until it holds. Returns false if the watchdog expires first.
template <class Condition>
bool eventually(Condition&& condition) {
  const auto end = std::chrono::steady_clock::now() + kWatchdog;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::yield();
  }
  return true;
}

/// Sends `sample` repeatedly until one arrives: with best effort, samples are lost until both endpoints have matched.
template <class Sample>
std::optional<Sample> send_until_received(Writer<Sample>& writer, Inbox<Sample>& inbox, const Sample& sample) {
  const auto end = std::chrono::steady_clock::now() + kWatchdog;
  while (std::chrono::steady_clock::now() < end) {
    if (writer.send(sample) == SendStatus::kInvalid) return std::nullopt;
    if (auto received = inbox.next(10ms)) return received;
  }
  return std::nullopt;
}

/// Returns the parts of the session in whose partitions samples of a topic travel.
template <class Sample>
std::vector<EndpointOptions> partitions_of(const TopicSpec<Sample>& topic) {
  const std::string profile = topic.profile;
  const auto is = [&](const auto&... topics) { return ((profile == topics.profile) || ...); };
  if (is(topics::kBase, topics::kRecords)) return {EndpointOptions{hrtc_partition("desk")}};
  if (is(topics::kIntent, topics::kDevicePose, topics::kDeviceCommand)) return {EndpointOptions{user_partition("ann")}};
  if (is(topics::kProbeStateFullRate, topics::kObjectCopy)) return {EndpointOptions{group_partition(7)}};
  if (is(topics::kMetrics)) return {EndpointOptions{}, EndpointOptions{kLossesPartition}};
  if (is(topics::kClock)) return {EndpointOptions{}, EndpointOptions{hrtc_partition("desk")}};
  return {EndpointOptions{}};
}

// The fields of a sample, for comparisons.

inline auto fields(const ses::Origin& o) { return std::tuple{o.session, o.participant, o.incarnation, o.time_ns}; }
inline auto fields(const ses::Pose& p) { return std::tuple{p.position, p.orientation}; }
inline auto fields(const ses::UserProbe& u) { return std::tuple{u.user, u.probe}; }
inline auto fields(const ses::Figure& f) { return std::tuple{f.name, f.value}; }
inline auto fields(const ses::MeshHash& m) { return std::tuple{m.object_id, m.hash}; }
inline auto fields(const ses::ShownRegion& r) { return std::tuple{r.region, r.applied}; }
inline auto fields(const ses::Waypoint& w) { return std::tuple{w.session_time_ns, fields(w.pose)}; }
inline auto fields(const ses::Wanted& w) { return std::tuple{w.region, w.contact_in_us}; }
inline auto fields(const ses::Toucher& t) { return std::tuple{t.participant, t.incarnation, t.claim}; }
inline auto fields(const ses::CopyChannel& l) { return std::tuple{l.wave, l.energy}; }
inline auto fields(const spm::SurfacePoint& p) { return std::tuple{p.position, p.normal}; }
inline auto fields(const spm::Interval& r) { return std::tuple{r.first, r.count}; }
inline auto fields(const ses::StopName& s) { return std::tuple{s.participant, s.incarnation, s.number}; }
inline auto fields(const ses::StopRecord& s) {
  return std::tuple{s.participant, s.incarnation, s.stop, s.ended, s.reset};
}
inline auto fields(const ses::BulkPiece& p) { return std::tuple{p.region, p.index, p.count, p.checksum, p.payload}; }
template <class T>
auto fields(const std::vector<T>& list) {
  std::vector<decltype(fields(list.front()))> all;
  for (const T& item : list) all.push_back(fields(item));
  return all;
}
inline auto fields(const ses::BulkChunk& b) {
  return std::tuple{b.stream, b.sequence, b.epoch, b.sent_us, fields(b.pieces)};
}
inline auto fields(const ses::RosterEntry& r) {
  return std::tuple{fields(r.origin),  r.protocol,       r.role,          r.name,
                    r.session,         r.requested_hrtc, r.users,         fields(r.served_users),
                    r.heartbeat,       r.leaving,        fields(r.stops), r.reference,
                    r.session_time_ns, r.joined_ns,      r.force_on,      r.revoked_made_s};
}
inline auto fields(const ses::CatalogueEntry& c) {
  const spm::ModelSummary& s = c.summary;
  return std::tuple_cat(
      std::tuple{fields(c.origin), c.host, c.object, c.object_id, c.scale, fields(c.pose), c.base_bytes, c.withdrawn},
      std::tuple{s.digest, s.vertices, s.faces, s.base_vertices, s.base_faces, s.records, s.parts, s.regions},
      std::tuple{s.max_level, s.bounds_min, s.bounds_max, s.grid.origin, s.grid.cell_size, s.metres_per_unit,
                 s.deviation, s.position_step},
      std::tuple{c.material.stiffness, c.material.damping, c.material.static_friction, c.material.dynamic_friction},
      std::tuple{c.body.mass, c.body.inertia, c.body.friction, c.body.ground},
      std::tuple{fields(c.surface.points), c.surface.spacing});
}
inline auto fields(const ses::Demand& d) {
  return std::tuple{fields(d.origin), d.object_id,    d.digest,         d.serving_host, d.epoch,
                    d.need_base,      fields(d.have), fields(d.wanted), d.stream,       d.received,
                    d.newest,         fields(d.gaps), d.credit,         d.arrivals,     d.one_way_us};
}
inline auto fields(const ses::Metrics& m) {
  return std::tuple{fields(m.origin), fields(m.figures), fields(m.meshes), m.scene};
}
inline auto fields(const ses::ShownRegions& s) {
  return std::tuple{fields(s.origin), s.object_id, s.digest, s.mesh_hash, s.complete, fields(s.regions)};
}
inline auto fields(const ses::Control& c) { return std::tuple{fields(c.origin), c.sequence, c.kind, c.text}; }
inline auto fields(const ses::EmergencyStop& s) { return std::tuple{fields(s.origin), s.number, s.text}; }
inline auto fields(const ses::ForceReset& r) { return std::tuple{fields(r.origin), r.number, fields(r.stops), r.text}; }
inline auto fields(const ses::SessionEnd& e) { return std::tuple{fields(e.origin), e.text}; }
inline auto fields(const ses::Intent& i) {
  return std::tuple{fields(i.origin), i.user_id, i.probe, i.sequence, i.buttons, fields(i.path)};
}
inline auto fields(const ses::ProbeState& p) {
  return std::tuple{fields(p.origin), p.user_id,     p.probe,       p.sequence, p.session_time_ns, p.time_bound_us,
                    fields(p.device), p.proxy,       p.velocity,    p.force,    p.radius,          p.object_id,
                    p.status,         p.error_bound, p.data_age_us, p.stiffness};
}
inline auto fields(const ses::DevicePose& d) {
  return std::tuple{fields(d.origin), d.user_id,  d.probe,  d.sequence, d.session_time_ns,
                    fields(d.pose),   d.velocity, d.radius, d.buttons,  d.command_applied};
}
inline auto fields(const ses::DeviceCommand& d) {
  return std::tuple{fields(d.origin), d.user_id, d.probe,  d.sequence,    d.pose_answered, d.force,
                    d.torque,         d.normal,  d.status, d.error_bound, d.data_age_us};
}
inline auto fields(const ses::ObjectPose& o) {
  return std::tuple{fields(o.origin),  o.object_id,    o.sequence, o.fencing,
                    o.session_time_ns, fields(o.pose), o.velocity, o.angular_velocity};
}
inline auto fields(const ses::ObjectClaim& c) {
  return std::tuple{fields(c.origin), c.object_id, c.sequence, c.touching, c.fencing, c.one_way_ns};
}
inline auto fields(const ses::ObjectGrant& g) {
  return std::tuple{fields(g.origin), g.object_id, g.sequence, g.fencing, g.channel_delay_ns, fields(g.touchers)};
}
inline auto fields(const ses::ObjectCopy& c) {
  return std::tuple{fields(c.origin),   c.object_id,       c.sequence,        c.fencing,
                    c.copy_index,       c.session_time_ns, fields(c.body),    c.velocity,
                    c.angular_velocity, c.user_force,      fields(c.channels)};
}
inline auto fields(const ses::ClockSample& c) {
  return std::tuple{fields(c.origin), c.peer, c.sequence, c.answer, c.t0_ns, c.t1_ns, c.t2_ns};
}

/// A valid sample. Most fields differ from their defaults and from each other, so that lost and swapped fields show.
template <class Sample>
Sample full_sample(const Participants& from);
template <>
ses::RosterEntry full_sample(const Participants& from);
template <>
ses::CatalogueEntry full_sample(const Participants& from);
template <>
ses::Demand full_sample(const Participants& from);
template <>
ses::Metrics full_sample(const Participants& from);
template <>
ses::ShownRegions full_sample(const Participants& from);
template <>
ses::Control full_sample(const Participants& from);
template <>
ses::EmergencyStop full_sample(const Participants& from);
template <>
ses::ForceReset full_sample(const Participants& from);
template <>
ses::SessionEnd full_sample(const Participants& from);
template <>
ses::BulkChunk full_sample(const Participants& from);
template <>
ses::Intent full_sample(const Participants& from);
template <>
ses::ProbeState full_sample(const Participants& from);
template <>
ses::DevicePose full_sample(const Participants& from);
template <>
ses::DeviceCommand full_sample(const Participants& from);
template <>
ses::ObjectPose full_sample(const Participants& from);
template <>
ses::ObjectClaim full_sample(const Participants& from);
template <>
ses::ObjectGrant full_sample(const Participants& from);
template <>
ses::ObjectCopy full_sample(const Participants& from);
template <>
ses::ClockSample full_sample(const Participants& from);

}  // namespace tactus::wire::test
