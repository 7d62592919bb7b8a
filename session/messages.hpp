/// What the participants of a session tell each other: one plain struct for each topic of idl/tactus.idl.
///
/// wire/ turns these into DDS samples and back and refuses what is out of bounds or not finite, so that a struct
/// received is safe to use. Times are nanoseconds of the sender's monotonic clock unless the name says `session`.
/// Lengths in metres, forces in newton, world frame unless the name says otherwise.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "spm/model.hpp"
#include "spm/span.hpp"
#include "spm/surface_points.hpp"

namespace tactus::session {

/// Raised when a change makes older programs misread newer samples.
inline constexpr std::uint32_t kProtocolVersion = 16;

// Bounds, also stated in idl/tactus.idl; a test compares the two.
inline constexpr std::size_t kMaxName = 63;
inline constexpr std::size_t kMaxText = 255;
inline constexpr std::size_t kMaxSlots = 64;  ///< users in one HRTC
inline constexpr std::size_t kMaxHaveIntervals = 1024;
inline constexpr std::size_t kMaxWanted = 256;
inline constexpr std::size_t kMaxGaps = 128;
inline constexpr std::size_t kMaxPayload = 1400;  ///< pieces of a chunk as they travel: they fill one Ethernet frame
inline constexpr std::size_t kMaxFigures = 128;
inline constexpr std::size_t kMaxMeshes = 64;  ///< objects of one HRTC
inline constexpr std::size_t kMaxWaypoints = 16;
inline constexpr std::size_t kMaxSurfacePoints = 32;
inline constexpr std::size_t kMaxTouchers = 8;  ///< controllers that simulate one object together
inline constexpr std::size_t kMaxStops = 32;    ///< issuers of stops and resets that one program records

/// Stable 64-bit name of a name: XXH3-64 of its bytes. Keys on the wire are these; the roster carries the text.
[[nodiscard]] std::uint64_t id_of(const std::string& name) noexcept;

/// Who sent a sample, in every sample.
struct Origin {
  std::uint64_t session = 0;      ///< id_of(session name)
  std::uint64_t participant = 0;  ///< id_of(participant name)
  std::uint64_t incarnation = 0;  ///< differs at each start of the program, grows
  std::int64_t time_ns = 0;       ///< sender's monotonic clock when sent
};

/// Session time of joining, of a program that has not joined yet.
inline constexpr std::int64_t kNotJoined = INT64_MAX;

enum class Role : std::uint8_t { kHost = 0, kHrtc = 1, kClient = 2, kViewer = 3 };

/// A user that an HRTC has accepted.
struct UserSlot {
  std::string user;
  std::uint32_t slot = 0;  ///< probe number in that HRTC
};

/// Names an emergency stop. The issuer numbers its stops from 1.
struct StopName {
  std::uint64_t participant = 0;
  std::uint64_t incarnation = 0;
  std::uint32_t number = 0;
};

/// What a host or an HRTC has received from one issuer of stops and resets (session/stop_latch.hpp).
struct StopRecord {
  std::uint64_t participant = 0;
  std::uint64_t incarnation = 0;
  std::uint32_t stop = 0;   ///< number of its newest stop; 0: none
  std::uint32_t ended = 0;  ///< largest number of a stop of it that a reset has named; 0: none
  std::uint32_t reset = 0;  ///< number of its newest reset; 0: none
};

/// Topic roster, key origin.participant: presence and heartbeat, also at once on every change.
struct RosterEntry {
  Origin origin;
  std::uint32_t protocol = kProtocolVersion;
  Role role = Role::kViewer;
  std::string name;  ///< participant
  std::string session;
  std::string controller;          ///< client only: the HRTC it asks to serve its users
  std::vector<std::string> users;  ///< client only: users it brings
  std::vector<UserSlot> slots;     ///< HRTC only: users accepted
  std::uint64_t heartbeat = 0;     ///< grows by one each sample
  bool leaving = false;
  std::vector<StopRecord> stops{};      ///< host and HRTC: acknowledges stops and resets, passes standing stops on
  std::uint64_t reference = 0;          ///< participant whose clock it follows; its own: it is the reference; 0: none
  std::int64_t session_time_ns = 0;     ///< when sent, by its clock; a session begins at 0
  std::int64_t joined_ns = kNotJoined;  ///< session time since which it has been in the session
  bool force_on = false;                ///< HRTC only: a force is on, so session time must not step
};

struct Pose {
  std::array<double, 3> position{0, 0, 0};
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< unit quaternion x, y, z, w
};

struct Material {
  double stiffness = 1000;      ///< N/m
  double damping = 1;           ///< N s/m, along the normal
  double static_friction = 0;   ///< coefficient
  double dynamic_friction = 0;  ///< coefficient, at most the static one
};

/// What an object is to those who simulate it: its axes are the model's, its centre of mass that of its bounds.
struct Body {
  double mass = 0;                  ///< kg; 0: the object never moves, and the rest says nothing
  std::array<double, 3> inertia{};  ///< kg m^2, about these axes
  double friction = 0.5;            ///< coefficient, against the ground
  double ground = 0;                ///< m, height of the ground plane
};

/// Topic catalogue, keys origin.participant (the host) and object_id: a model in the world.
struct CatalogueEntry {
  Origin origin;
  std::string host;
  std::string object;           ///< unique in the session; two hosts may serve the same object
  std::uint64_t object_id = 0;  ///< id_of(object)
  spm::ModelSummary summary;    ///< digest, counts, bounds, grid
  double scale = 1;             ///< metres per file unit
  Pose pose;                    ///< model frame (scaled) to world; of an object that moves, where it stood at first
  Material material;
  Body body;
  std::uint32_t base_bytes = 0;  ///< size of the encoded base mesh
  spm::SurfacePoints surface;    ///< where it can be touched, at most kMaxSurfacePoints; model frame, file units
  bool withdrawn = false;
};

/// What the joined payload of a message is.
enum class BulkKind : std::uint8_t {
  kBase = 0,    ///< an encoded base mesh
  kRegion = 1,  ///< an encoded region list with the records that the HRTC lacks
  kEcho = 2     ///< no payload: only tells epoch and sequence
};

/// A part of a message.
struct BulkPiece {
  std::uint32_t region = spm::kNone;  ///< kNone: a base mesh
  std::uint32_t part = 0, parts = 1;  ///< which of the message, and how many there are
  std::uint32_t checksum = 0;         ///< `checksum_of` the whole joined payload
  std::vector<std::uint8_t> payload;
};

/// What a piece takes of kMaxPayload beside its payload, at most.
[[nodiscard]] std::size_t head_bytes(std::uint32_t region, std::uint32_t parts) noexcept;

/// Topics base and records: pieces of messages, or an echo. A frame holds the end of one message and the beginning of
/// the next, so that it is full however long they are. What all chunks from one host to one HRTC about one object have
/// in common is one number, `stream_id`.
struct BulkChunk {
  std::uint32_t stream = 0;
  std::uint32_t sequence = 0;     ///< of the stream, from 1; what is sent again gets a new one
  std::uint32_t epoch = 0;        ///< newest demand epoch that the host had seen of this HRTC and object
  std::uint32_t sent_us = 0;      ///< sender's monotonic clock, modulo 2^32
  std::vector<BulkPiece> pieces;  ///< of base meshes or of regions, not both; none: an echo

  [[nodiscard]] BulkKind kind() const noexcept {
    return pieces.empty() ? BulkKind::kEcho : pieces.front().region == spm::kNone ? BulkKind::kBase : BulkKind::kRegion;
  }
  /// Of messages, without heads.
  [[nodiscard]] std::size_t payload_bytes() const noexcept;
};

/// Names the chunks that one life of a host sends to one life of an HRTC about one object.
[[nodiscard]] std::uint32_t stream_id(const Origin& host, const Origin& hrtc, std::uint64_t object_id) noexcept;
[[nodiscard]] std::uint32_t checksum_of(spm::Span<const std::uint8_t> payload) noexcept;

/// A wanted region and how soon: smaller is sooner.
struct Wanted {
  std::uint32_t region = 0;
  std::uint32_t contact_in_us = 0;  ///< expected time to contact
};

/// Topic demand, keys origin.participant (the HRTC) and object_id: state, not a command. What it omits is cancelled.
struct Demand {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint64_t digest = 0;
  std::uint64_t serving_host = 0;  ///< participant that shall answer; others stay silent
  std::uint32_t epoch = 0;         ///< grows with every change
  bool need_base = false;
  std::vector<spm::Interval> have;  ///< regions held, as ascending runs of RegionIds
  std::vector<Wanted> wanted;       ///< soonest first
  std::uint32_t stream = 0;         ///< stream_id that the following is about
  std::uint32_t received = 0;       ///< all chunks up to this sequence have been dealt with
  std::uint32_t newest = 0;         ///< highest sequence that came, or as far as `gaps` tell
  std::vector<spm::Interval> gaps;  ///< sequences between these two that did not come, as ascending runs
  std::uint32_t credit = 0;         ///< bytes the host may have under way to this HRTC
  std::uint32_t arrivals = 0;       ///< chunks of the host since the last demand that it is told of
  std::uint32_t one_way_us = 0;     ///< the least of their arrival - sent_us, modulo 2^32
};

struct Waypoint {
  std::int64_t session_time_ns = 0;
  Pose pose;
};

/// Topic intent, keys user_id and probe: where a simulated hand wants to be. Even between waypoints; holds the last.
struct Intent {
  Origin origin;
  std::uint64_t user_id = 0;
  std::uint32_t probe = 0;
  std::uint32_t sequence = 0;
  std::uint32_t buttons = 0;   ///< of the hand's device, as in DevicePose
  std::vector<Waypoint> path;  ///< ascending times, 1..kMaxWaypoints
};

// Status bits of probe states and device commands.
enum StatusBit : std::uint32_t {
  kInContact = 1u << 0,
  kExact = 1u << 1,  ///< every labelled cell that the query met was fully refined
  kStalePose = 1u << 2,
  kForceSaturated = 1u << 3,
  kForceRamped = 1u << 4,  ///< soft start, stale data or a surface that moved past the proxy
  kContactsTruncated = 1u << 5,
  kPoolFull = 1u << 6,
  kBudgetSpent = 1u << 7,    ///< refinement goes on next cycle
  kFault = 1u << 8,          ///< latched
  kSurfaceMoved = 1u << 9,   ///< refinement moved the surface past the proxy this cycle
  kStiffnessCut = 1u << 10,  ///< the material is stiffer than the device, or the loop to a remote one, can bear
  kHolding = 1u << 11,       ///< the hand holds on to the object, which goes where it goes
  kHoldRefused = 1u << 12,   ///< it would, but what it touches does not move, or the force is off
  /// More regions near the probe were to be refined than the HRTC refines at a time; the least urgent stay coarse.
  kTargetsDropped = 1u << 13,
  kFaultReason = 0xfu << 24  ///< why kFault is set: haptics::Fault; fault_reason says it in words
};
constexpr unsigned kFaultReasonShift = 24;

/// Why the forces of a probe with this status are off; static text, empty without kFault.
[[nodiscard]] const char* fault_reason(std::uint32_t status) noexcept;

/// Topic probe_state, keys user_id and probe: written by HRTCs only, each cycle or as the rate allows.
struct ProbeState {
  Origin origin;
  std::uint64_t user_id = 0;
  std::uint32_t probe = 0;
  std::uint32_t sequence = 0;
  std::int64_t session_time_ns = 0;
  std::uint32_t time_bound_us = 0;  ///< the session time is right to this
  Pose device;
  std::array<double, 3> proxy{0, 0, 0};
  std::array<double, 3> velocity{0, 0, 0};
  std::array<double, 3> force{0, 0, 0};  ///< on the user's hand
  double radius = 0;
  std::uint64_t object_id = 0;    ///< touched; 0 when none
  std::uint32_t status = 0;       ///< StatusBit
  float error_bound = 0;          ///< m; how far the shown surface may be from the true one; 0 when exact
  std::uint32_t data_age_us = 0;  ///< age of the device pose used
  float stiffness = 0;            ///< N/m, with which the force was made; 0 without contact
};

/// Topic device_pose, keys user_id and probe: a remote device to its HRTC.
struct DevicePose {
  Origin origin;
  std::uint64_t user_id = 0;
  std::uint32_t probe = 0;
  std::uint32_t sequence = 0;
  std::int64_t session_time_ns = 0;
  Pose pose;
  std::array<double, 3> velocity{0, 0, 0};
  double radius = 0;
  std::uint32_t buttons = 0;       ///< haptics::Button
  std::uint32_t command_felt = 0;  ///< sequence of the newest device_command felt
};

/// Topic device_command, keys user_id and probe: an HRTC to a remote device.
struct DeviceCommand {
  Origin origin;
  std::uint64_t user_id = 0;
  std::uint32_t probe = 0;
  std::uint32_t sequence = 0;
  std::uint32_t pose_answered = 0;
  std::array<double, 3> force{0, 0, 0};
  std::array<double, 3> torque{0, 0, 0};
  std::array<double, 3> normal{0, 0, 0};
  std::uint32_t status = 0;
  float error_bound = 0;
  std::uint32_t data_age_us = 0;
};

/// Topic object_pose, key object_id: written by the object's one simulator.
struct ObjectPose {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t fencing = 0;  ///< a larger number takes over; smaller ones are ignored from then on
  std::int64_t session_time_ns = 0;
  Pose pose;                                        ///< model frame (scaled) to world
  std::array<double, 3> velocity{0, 0, 0};          ///< of that frame's origin
  std::array<double, 3> angular_velocity{0, 0, 0};  ///< rad/s
};

/// Topic object_claim, keys origin.participant and object_id: of a controller whose user touches an object that can
/// move, or has let go (session/ownership.hpp).
struct ObjectClaim {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint32_t sequence = 0;
  bool touching = false;
  std::uint64_t fencing = 0;    ///< largest that it has seen
  std::int64_t one_way_ns = 0;  ///< it measures from its peers at most, jitter included
};

struct Toucher {
  std::uint64_t participant = 0, incarnation = 0;
  std::uint32_t claim = 0;  ///< newest of its claims that arrived
};

/// Topic object_grant, keys origin.participant (the host) and object_id: who simulates the object.
struct ObjectGrant {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t fencing = 0;
  std::int64_t line_ns = 0;       ///< delay of the line between copies, the same for all
  std::vector<Toucher> touchers;  ///< longest holder first; none: the host simulates
};

/// Between a copy and one of its peers, since the group began.
struct CopyLine {
  std::array<double, 6> wave{};  ///< what leaves for it, as an integral: m in the world, then rad about the body's axes
  double energy = 0;             ///< J put into the line, never falls
};

/// Topic object_copy, keys origin.participant and object_id: one of several simulations of an object to the others,
/// each cycle while there are several (haptics/coupling.hpp).
struct ObjectCopy {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t fencing = 0;  ///< of the grant that made the group
  std::uint32_t place = 0;    ///< its own in the grant's list
  std::int64_t session_time_ns = 0;
  Pose body;                                        ///< of the centre of mass, with the model's axes
  std::array<double, 3> velocity{0, 0, 0};          ///< of that centre
  std::array<double, 3> angular_velocity{0, 0, 0};  ///< rad/s
  std::array<double, 3> pressed{0, 0, 0};           ///< N, by its own users
  std::vector<CopyLine> lines;                      ///< one for each place of the grant's list; its own says nothing
};

/// Topic clock, keys origin.participant and peer: four-stamp exchange. An answer repeats the request's sequence and t0.
/// Never wall clocks: the asker's monotonic clock, and the answerer's session time, which is its own plus a constant.
struct ClockSample {
  Origin origin;
  std::uint64_t peer = 0;  ///< participant it is for
  std::uint32_t sequence = 0;
  bool answer = false;
  std::int64_t t0_ns = 0;  ///< request sent, asker's clock
  std::int64_t t1_ns = 0;  ///< request received, answerer's session time
  std::int64_t t2_ns = 0;  ///< answer sent, answerer's session time
};

struct Figure {
  std::string name;
  double value = 0;
};

/// Which mesh an HRTC shows of an object: equal for equal sets of vertices split, however they were reached; 0 for the
/// base mesh.
struct MeshHash {
  std::uint64_t object_id = 0;
  std::uint64_t hash = 0;
};

/// Topic metrics, key origin.participant: 1-2 Hz.
struct Metrics {
  Origin origin;
  std::vector<Figure> figures;
  std::vector<MeshHash> meshes{};  ///< HRTC only: one for each object
  std::uint64_t scene = 0;         ///< scene_hash of its roster (session/roster.hpp)
};

enum class ControlKind : std::uint8_t { kStart = 0, kMode = 1 };

/// Topic control, key origin.participant: to everyone in the session.
struct Control {
  Origin origin;
  std::uint32_t sequence = 0;
  ControlKind kind = ControlKind::kStart;
  std::string text;  ///< mode name
};

/// Topic stop: forces are off until a reset names this stop. Its sender repeats it until all have acknowledged it.
struct EmergencyStop {
  Origin origin;
  std::uint32_t number = 0;  ///< with the origin, its name
  std::string text;          ///< reason

  [[nodiscard]] StopName name() const noexcept { return {origin.participant, origin.incarnation, number}; }
};

/// Topic reset: ends the stops that it names, and the faults of devices. Repeated as a stop is.
struct ForceReset {
  Origin origin;
  std::uint32_t number = 0;  ///< of the sender's resets, from 1
  std::vector<StopName> stops;
  std::string text;  ///< reason
};

/// Topic end: the programs of the session write their reports and leave.
struct SessionEnd {
  Origin origin;
  std::string text;  ///< reason
};

}  // namespace tactus::session
