/// The samples that participants of a session exchange, as one plain struct for each topic of idl/tactus.idl.
///
/// wire/ converts these structs to and from DDS samples. It refuses samples whose values are out of bounds or not
/// finite, so a received struct is safe to use. Unless the name or the comment says otherwise, times are nanoseconds of
/// the sender's monotonic clock, lengths are in metres and forces in newton, in the world frame.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "spm/model.hpp"
#include "spm/surface_points.hpp"

namespace tactus::session {

/// Raise this number when a change makes older programs misread newer samples.
inline constexpr std::uint32_t kProtocolVersion = 18;

// Bounds. idl/tactus.idl repeats them; a test compares both.
inline constexpr std::size_t kMaxName = 63;
inline constexpr std::size_t kMaxText = 255;
inline constexpr std::size_t kMaxUsers = 64;  ///< users in one roster entry
inline constexpr std::size_t kMaxHaveIntervals = 1024;
inline constexpr std::size_t kMaxWanted = 256;
inline constexpr std::size_t kMaxGaps = 128;
inline constexpr std::size_t kMaxPayload =
    1400;  ///< bytes of the encoded pieces of a chunk, which fill one Ethernet frame
inline constexpr std::size_t kMaxFigures = 128;
inline constexpr std::size_t kMaxShownRegions = 1024;
inline constexpr std::size_t kMaxMeshes = 64;  ///< objects of one HRTC
inline constexpr std::size_t kMaxWaypoints = 16;
inline constexpr std::uint32_t kMaxCredit = 8u << 20;  ///< bytes that a host may have in flight to one HRTC
inline constexpr std::size_t kMaxSurfacePoints = 32;
inline constexpr std::size_t kMaxTouchers = 8;  ///< HRTCs that simulate one object together
inline constexpr std::size_t kMaxStops = 32;    ///< issuers of stops and resets that one program records

/// Id of a name: XXH3-64 of its bytes. Keys in samples are ids. The roster carries the names of participants and
/// users, the catalogue those of objects.
[[nodiscard]] std::uint64_t id_of(const std::string& name) noexcept;

/// The sender of a sample, and when it was sent. Every sample except BulkChunk has one.
struct Origin {
  std::uint64_t session = 0;      ///< id_of(session name)
  std::uint64_t participant = 0;  ///< id_of(participant name)
  std::uint64_t incarnation = 0;  ///< grows with each start of the program
  std::int64_t time_ns = 0;       ///< sending time, sender's monotonic clock
};

/// Value of RosterEntry::joined_ns before the program has joined.
inline constexpr std::int64_t kNotJoined = INT64_MAX;

enum class Role : std::uint8_t { kHost = 0, kHrtc = 1, kClient = 2, kViewer = 3 };
/// The name of a role in reports and interfaces: host, hrtc, client or viewer.
[[nodiscard]] const char* role_name(Role role) noexcept;

/// A user that an HRTC has accepted, and the probe of this user.
struct UserProbe {
  std::string user;
  std::uint32_t probe = 0;  ///< probe number in that HRTC
};

/// The name of an emergency stop: its issuer and the issuer's number, from 1.
struct StopName {
  std::uint64_t participant = 0;
  std::uint64_t incarnation = 0;
  std::uint32_t number = 0;
};

/// The stops and resets that a host or an HRTC has received from one issuer (session/stop_latch.hpp).
struct StopRecord {
  std::uint64_t participant = 0;
  std::uint64_t incarnation = 0;
  std::uint32_t stop = 0;   ///< number of its newest stop; 0: none
  std::uint32_t ended = 0;  ///< number of its newest received stop that a reset has ended; 0: none
  std::uint32_t reset = 0;  ///< number of its newest reset; 0: none
};

/// Topic roster, key origin.participant: states that a program is present. Sent periodically, and at once when
/// stops, resets or served users change, when a force begins, and for a new participant.
struct RosterEntry {
  Origin origin;
  std::uint32_t protocol = kProtocolVersion;
  Role role = Role::kViewer;
  std::string name;  ///< of the participant
  std::string session;
  std::string requested_hrtc;           ///< client only: the HRTC that is to serve its users
  std::vector<std::string> users;       ///< client only
  std::vector<UserProbe> served_users;  ///< HRTC only: users accepted
  std::uint64_t heartbeat = 0;          ///< grows by one each sample
  bool leaving = false;
  std::vector<StopRecord> stops{};  ///< host and HRTC only: acknowledge stops and resets, and forward standing stops
  /// Id of the time reference that this program follows; its own id if it is the reference itself; 0: none.
  std::uint64_t reference = 0;
  std::int64_t session_time_ns = 0;     ///< session time at sending, by the program's own clock
  std::int64_t joined_ns = kNotJoined;  ///< session time at which the program joined
  bool force_on = false;                ///< HRTC only: a force is on, so session time must not step
  /// When the authority has made the sender's list of revoked keys, s since 1970; 0: no keys. `wire` sets it.
  std::int64_t revoked_made_s = 0;
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

/// The rigid body of a movable object. Its axes are those of the model. Its centre of mass is the centre of the bounds.
struct Body {
  double mass = 0;                  ///< kg; 0: the object is static, and the other fields are not used
  std::array<double, 3> inertia{};  ///< kg m^2, about the axes of the model
  double friction = 0.5;            ///< coefficient, against the ground and static objects
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
  Pose pose;                    ///< model frame (scaled) to world; the start pose of a movable object
  Material material;
  Body body;
  std::uint32_t base_bytes = 0;  ///< size of the encoded base mesh
  spm::SurfacePoints surface;    ///< points that can be touched, at most kMaxSurfacePoints; model frame, file units
  bool withdrawn = false;
};

/// The content of a chunk.
enum class BulkKind : std::uint8_t {
  kBase = 0,    ///< an encoded base mesh
  kRegion = 1,  ///< an encoded region: its list of records, and those records that the HRTC lacks
  kEcho = 2     ///< no payload: the chunk reports only epoch, sequence and sending time
};

/// The part of a message that one chunk carries.
struct BulkPiece {
  std::uint32_t region = spm::kNone;   ///< kNone: a base mesh
  std::uint32_t index = 0, count = 1;  ///< index of this piece, and number of pieces of the message
  std::uint32_t checksum = 0;          ///< `checksum_of` the payloads of all pieces, joined
  std::vector<std::uint8_t> payload;
};

/// Max encoded size of the header of a piece, bytes; counts towards kMaxPayload.
[[nodiscard]] std::size_t header_bytes(std::uint32_t region, std::uint32_t count) noexcept;

/// Topics base and records: pieces of messages, or an echo. One chunk can carry the end of a message and the beginning
/// of the next, so that frames are full. `stream` is the stream_id of the host, the HRTC and the object.
struct BulkChunk {
  std::uint32_t stream = 0;
  std::uint32_t sequence = 0;  ///< number of the chunk in the stream, from 1
  std::uint32_t epoch = 0;     ///< newest epoch of a demand that the host has received from this HRTC for this object
  std::uint32_t sent_us = 0;   ///< sender's monotonic clock, modulo 2^32
  std::vector<BulkPiece> pieces;  ///< pieces of base meshes or of regions, not both; empty: an echo
  // Set by the receiver, not sent:
  bool is_from_member = false;  ///< the session has keys, so `senders` counts
  std::vector<std::uint64_t>
      senders;  ///< ids of the programs of the member that has sent the chunk; empty: none is known

  [[nodiscard]] BulkKind kind() const noexcept {
    return pieces.empty() ? BulkKind::kEcho : pieces.front().region == spm::kNone ? BulkKind::kBase : BulkKind::kRegion;
  }
  /// Sum of the payloads, without the headers of pieces.
  [[nodiscard]] std::size_t payload_bytes() const noexcept;
};

/// Identifies the chunks that one incarnation of a host sends to one incarnation of an HRTC about one object.
[[nodiscard]] std::uint32_t stream_id(const Origin& host, const Origin& hrtc, std::uint64_t object_id) noexcept;
[[nodiscard]] std::uint32_t checksum_of(std::span<const std::uint8_t> payload) noexcept;

/// A message of the topic records contains a region, whose number is below kFirstPage, or a part of the directory: a
/// page, with the number kFirstPage + PageId, or all pages that have regions, with the number kAllPages.
inline constexpr std::uint32_t kFirstPage = 1u << 31, kAllPages = 0xfffffffe;
[[nodiscard]] constexpr bool is_of_directory(std::uint32_t number) noexcept {
  return (number >= kFirstPage && number - kFirstPage < spm::kPageIds) || number == kAllPages;
}
[[nodiscard]] constexpr std::uint32_t number_of(spm::PageId page) noexcept { return kFirstPage + spm::index(page); }

/// A region that an HRTC requests, or a part of the directory.
struct Wanted {
  std::uint32_t region = 0;
  std::uint32_t contact_in_us = 0;  ///< expected time to contact
};

/// Topic demand, keys origin.participant (the HRTC) and object_id: the regions that an HRTC has and wants. Each demand
/// replaces the one before: a region that `wanted` no longer lists is cancelled.
struct Demand {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint64_t digest = 0;
  std::uint64_t serving_host = 0;  ///< the host that has to answer; other hosts do not answer
  std::uint32_t epoch = 0;         ///< a larger epoch requests a new answer
  bool need_base = false;
  std::vector<spm::Interval> have;  ///< regions held, as ascending intervals of RegionIds
  std::vector<Wanted> wanted;       ///< soonest first
  std::uint32_t stream = 0;         ///< stream_id of `received`, `newest` and `gaps`
  std::uint32_t received = 0;       ///< all chunks up to this sequence have been processed
  std::uint32_t newest = 0;         ///< `gaps` is complete up to this sequence
  std::vector<spm::Interval>
      gaps;                      ///< sequences from `received` to `newest` that did not arrive, as ascending intervals
  std::uint32_t credit = 0;      ///< bytes that the host may have in flight to this HRTC
  std::uint32_t arrivals = 0;    ///< chunks from the host since the previous demand to it
  std::uint32_t one_way_us = 0;  ///< min over these chunks of arrival time minus sent_us, modulo 2^32
};

struct Waypoint {
  std::int64_t session_time_ns = 0;
  Pose pose;
};

/// Topic intent, keys user_id and probe: the path of a simulated hand. The hand moves linearly between waypoints and
/// stays at the last one.
struct Intent {
  Origin origin;
  std::uint64_t user_id = 0;
  std::uint32_t probe = 0;
  std::uint32_t sequence = 0;
  std::uint32_t buttons = 0;   ///< haptics::Button, pressed during the path
  std::vector<Waypoint> path;  ///< ascending times, 1..kMaxWaypoints
};

// Status bits of probe states and device commands.
enum StatusBit : std::uint32_t {
  kInContact = 1u << 0,
  kExact = 1u << 1,  ///< every labelled cell that the query overlapped was at full resolution
  kStalePose = 1u << 2,
  kForceSaturated = 1u << 3,
  kForceRamped = 1u << 4,  ///< changed by a soft start, a stale pose, a surface ramp or the slew limit
  kContactsTruncated = 1u << 5,
  kPoolFull = 1u << 6,
  kBudgetSpent = 1u << 7,    ///< refinement continues in the next cycle
  kFault = 1u << 8,          ///< latched
  kSurfaceMoved = 1u << 9,   ///< a changed surface moved the proxy in this cycle, or pushes the tool out
  kStiffnessCut = 1u << 10,  ///< the material is stiffer than the device or the round trip to it allows
  kHolding = 1u << 11,       ///< the hand holds the object
  kHoldRefused = 1u << 12,   ///< the hand cannot hold the touched object (docs/reference/status-bits.md)
  /// More regions near the probe need refinement than the HRTC refines at a time; the least urgent stay coarse.
  kTargetsDropped = 1u << 13,
  kFaultReason = 0xfu << 24  ///< reason of kFault: a haptics::Fault; fault_reason returns its text
};
constexpr unsigned kFaultReasonShift = 24;

/// The reason why the forces of a probe with this status are off; static text, empty without kFault.
[[nodiscard]] const char* fault_reason(std::uint32_t status) noexcept;

/// Topic probe_state, keys user_id and probe: written by HRTCs only, each cycle or deadband-coded.
struct ProbeState {
  Origin origin;
  std::uint64_t user_id = 0;
  std::uint32_t probe = 0;
  std::uint32_t sequence = 0;
  std::int64_t session_time_ns = 0;
  std::uint32_t time_bound_us = 0;  ///< max error of session_time_ns
  Pose device;
  std::array<double, 3> proxy{0, 0, 0};
  std::array<double, 3> velocity{0, 0, 0};
  std::array<double, 3> force{0, 0, 0};  ///< on the user's hand
  double radius = 0;
  std::uint64_t object_id = 0;    ///< touched object; 0: none
  std::uint32_t status = 0;       ///< StatusBit
  float error_bound = 0;          ///< m; max distance of the shown surface from the true one; 0 when exact
  std::uint32_t data_age_us = 0;  ///< age of the device pose used
  float stiffness = 0;            ///< N/m, of the contact that caused the force; 0 without contact
};

/// Topic device_pose, keys user_id and probe: the pose of a remote device, for its HRTC.
struct DevicePose {
  Origin origin;
  std::uint64_t user_id = 0;
  std::uint32_t probe = 0;
  std::uint32_t sequence = 0;
  std::int64_t session_time_ns = 0;
  Pose pose;
  std::array<double, 3> velocity{0, 0, 0};
  double radius = 0;
  std::uint32_t buttons = 0;          ///< haptics::Button
  std::uint32_t command_applied = 0;  ///< sequence of the newest device_command applied
};

/// Topic device_command, keys user_id and probe: the force of an HRTC for a remote device.
struct DeviceCommand {
  Origin origin;
  std::uint64_t user_id = 0;
  std::uint32_t probe = 0;
  std::uint32_t sequence = 0;
  std::uint32_t pose_answered = 0;        ///< sequence of the device_pose from which the force was computed
  std::array<double, 3> force{0, 0, 0};   ///< N, on the user's hand
  std::array<double, 3> torque{0, 0, 0};  ///< N m, on the user's hand
  std::array<double, 3> normal{0, 0, 0};
  // These three are as in ProbeState.
  std::uint32_t status = 0;
  float error_bound = 0;
  std::uint32_t data_age_us = 0;
};

/// Topic object_pose, key object_id: the pose of a movable object, written by one program: the host, or the owner or
/// leader that the host has granted (session/ownership.hpp).
struct ObjectPose {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t fencing = 0;  ///< fencing number of the writer; receivers ignore later poses with a smaller number
  std::int64_t session_time_ns = 0;
  Pose pose;                                        ///< model frame (scaled) to world
  std::array<double, 3> velocity{0, 0, 0};          ///< of the model's origin
  std::array<double, 3> angular_velocity{0, 0, 0};  ///< rad/s
};

/// Topic object_claim, keys origin.participant and object_id: states that a user of an HRTC touches a movable object,
/// or has released it (session/ownership.hpp).
struct ObjectClaim {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint32_t sequence = 0;
  bool touching = false;
  std::uint64_t fencing = 0;  ///< largest fencing number received; 0: none
  /// Estimate, with a margin, of the longest transit of nearly all samples between this HRTC and other programs. It is
  /// measured on the poses, probe states and copies that the HRTC receives. The lease time assumes that neither claim
  /// nor grant takes longer. The channel delay assumes the same of copies.
  std::int64_t one_way_ns = 0;
};

/// An HRTC whose user touches an object.
struct Toucher {
  std::uint64_t participant = 0, incarnation = 0;
  std::uint32_t claim = 0;  ///< sequence of the newest claim that the host has received from it
};

/// Topic object_grant, keys origin.participant (the host) and object_id: the programs that simulate the object.
struct ObjectGrant {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t fencing = 0;
  std::int64_t channel_delay_ns = 0;  ///< delay of the wave-variable channels, equal for all copies
  std::vector<Toucher> touchers;      ///< in the order in which they began to touch; empty: the host simulates
};

/// Output of a copy into the wave-variable channel to one peer, since the first grant with this
/// ObjectCopy::fencing.
struct CopyChannel {
  std::array<double, 6>
      wave{};         ///< integral of the departing wave: m in the world frame, then rad about the body's axes
  double energy = 0;  ///< J put into the channel, never decreases
};

/// Topic object_copy, keys origin.participant and object_id: the state of one copy of an object, for its peers. Sent in
/// each cycle while there are several copies (haptics/coupling.hpp).
struct ObjectCopy {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t fencing = 0;     ///< of the grant that lists the copies
  std::uint32_t copy_index = 0;  ///< index in the grant's list
  std::int64_t session_time_ns = 0;
  Pose body;                                        ///< pose of the centre of mass, with the model's axes
  std::array<double, 3> velocity{0, 0, 0};          ///< of the centre of mass
  std::array<double, 3> angular_velocity{0, 0, 0};  ///< rad/s
  std::array<double, 3> user_force{0, 0, 0};        ///< N, force of the copy's own users on it
  std::vector<CopyChannel> channels;  ///< by index in the grant's list; the entry of this copy itself is not used
};

/// Topic clock, keys origin.participant and peer: a request or an answer of the four-stamp exchange. An answer repeats
/// sequence and t0 of the request. The stamps are of the requester's monotonic clock and the responder's session time.
struct ClockSample {
  Origin origin;
  std::uint64_t peer = 0;  ///< participant to which the sample is addressed
  std::uint32_t sequence = 0;
  bool answer = false;
  std::int64_t t0_ns = 0;  ///< request sent, requester's clock
  std::int64_t t1_ns = 0;  ///< request received, responder's session time
  std::int64_t t2_ns = 0;  ///< answer sent, responder's session time
};

struct Figure {
  std::string name;
  double value = 0;
};

/// Identifies the active mesh of an object in an HRTC. `hash` depends on the set of split vertices, not on the order of
/// the splits; 0: the base mesh.
struct MeshHash {
  std::uint64_t object_id = 0;
  std::uint64_t hash = 0;
};

/// Topic metrics, key origin.participant: the figures of a host or an HRTC, sent at 1 to 2 Hz.
struct Metrics {
  Origin origin;
  std::vector<Figure> figures;
  std::vector<MeshHash> meshes{};  ///< HRTC only: one for each object
  std::uint64_t scene = 0;         ///< scene_hash of the program's roster (session/roster.hpp)
};

/// A region of a shown mesh, and how many entries of its list are applied, from the beginning of the list.
struct ShownRegion {
  std::uint32_t region = 0;
  std::uint32_t applied = 0;
};

/// Topic shown_regions, without key: the mesh of an object that an HRTC shows, as the regions
/// that determine it. Sent only while a reader is matched.
struct ShownRegions {
  Origin origin;
  std::uint64_t object_id = 0;
  std::uint64_t digest = 0;          ///< of the model
  std::uint64_t mesh_hash = 0;       ///< of the mesh, see MeshHash
  bool complete = true;              ///< false: there are more regions, so that the list does not determine the mesh
  std::vector<ShownRegion> regions;  ///< at most kMaxShownRegions, each once
};

enum class ControlKind : std::uint8_t { kStart = 0, kMode = 1 };

/// Topic control, key origin.participant: a command for all participants of the session.
struct Control {
  Origin origin;
  std::uint32_t sequence = 0;
  ControlKind kind = ControlKind::kStart;
  std::string text;  ///< kStart: name of the scenario; kMode: the mode command (session/modes.hpp)
};

/// Topic stop: all forces are off until a reset names this stop. The sender repeats the sample until all hosts and
/// HRTCs have acknowledged it.
struct EmergencyStop {
  Origin origin;
  std::uint32_t number = 0;  ///< names the stop, together with participant and incarnation
  std::string text;          ///< reason

  [[nodiscard]] StopName name() const noexcept { return {origin.participant, origin.incarnation, number}; }
};

/// Topic reset: ends the stops that it names, and the faults of devices. The sender repeats it like a stop.
struct ForceReset {
  Origin origin;
  std::uint32_t number = 0;  ///< the sender's number of this reset, from 1
  std::vector<StopName> stops;
  std::string text;  ///< reason
};

/// Topic end: the programs of the session write their reports and leave.
struct SessionEnd {
  Origin origin;
  std::string text;  ///< reason
};

}  // namespace tactus::session
