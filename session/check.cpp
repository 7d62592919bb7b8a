#include "session/check.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "session/printable.hpp"

namespace tactus::session {
namespace {

constexpr double kUnitTolerance = 1e-3;  // covers the rounding of a few products in float

template <class Array>
bool all_finite(const Array& values) noexcept {
  for (const auto v : values) {
    if (!std::isfinite(v)) return false;
  }
  return true;
}

/// Sums and products of larger numbers could overflow.
constexpr double kMaxNumber = 1e9;
template <class Array>
bool all_moderate(const Array& values) noexcept {
  return std::all_of(values.begin(), values.end(),
                     [](double v) { return std::abs(v) <= kMaxNumber; });  // false for NaN
}

/// A hand does not move faster, m/s.
constexpr double kMaxHandSpeed = 1000;
template <class Array>
bool is_speed_of_hand(const Array& velocity) noexcept {
  return std::all_of(velocity.begin(), velocity.end(), [](double v) { return std::abs(v) <= kMaxHandSpeed; });
}
constexpr char kTooFast[] = "velocity: expected at most 1000 m/s";

/// True for a time whose difference from another such time, or from a local clock, does not overflow.
bool is_time(std::int64_t ns) noexcept { return ns > -(std::int64_t{1} << 61) && ns < std::int64_t{1} << 61; }
constexpr char kNoTime[] = "session_time_ns: expected within 2^61 ns of zero";

bool not_negative(double v) noexcept { return std::isfinite(v) && v >= 0; }
bool positive(double v) noexcept { return std::isfinite(v) && v > 0; }

/// A zero byte would end the string in CDR.
bool fits(const std::string& text, std::size_t bound) noexcept {
  return text.size() <= bound && text.find('\0') == std::string::npos;
}
/// Programs print names in lines of logs and tables, which control characters could forge.
bool is_name(const std::string& text) noexcept {
  return !text.empty() && text.size() <= kMaxName && !has_control_character(text);
}

bool ascending(const std::vector<spm::Interval>& intervals) noexcept {
  std::uint64_t next = 0;
  for (const spm::Interval& interval : intervals) {
    if (interval.count == 0 || interval.first < next) return false;
    next = std::uint64_t{interval.first} + interval.count;
    if (next > spm::kNone) return false;
  }
  return true;
}

}  // namespace

const char* invalid_field(const Pose& pose) noexcept {
  if (!all_moderate(pose.position)) return "pose.position: expected at most 1e9";
  double square = 0;
  for (const double v : pose.orientation) square += v * v;
  if (!(std::abs(std::sqrt(square) - 1) <= kUnitTolerance)) return "pose.orientation: expected a unit quaternion";
  return nullptr;
}

const char* invalid_field(const Material& m) noexcept {
  if (!not_negative(m.stiffness)) return "material.stiffness: expected finite, at least 0";
  if (!not_negative(m.damping)) return "material.damping: expected finite, at least 0";
  if (!not_negative(m.static_friction)) return "material.static_friction: expected finite, at least 0";
  if (!not_negative(m.dynamic_friction) || m.dynamic_friction > m.static_friction) {
    return "material.dynamic_friction: expected 0 up to static_friction";
  }
  return nullptr;
}

const char* invalid_field(const Body& b) noexcept {
  if (b.mass == 0) return nullptr;  // the other fields have no meaning
  // The inverse of a smaller one, multiplied by other numbers within their bounds, could overflow.
  constexpr double kMinMass = 1e-6, kMinInertia = 1e-12;
  if (!(b.mass >= kMinMass && b.mass <= kMaxNumber)) return "body.mass: expected 0, or 1e-6 to 1e9";
  const auto& i = b.inertia;
  for (const double about : i) {
    if (!(about >= kMinInertia && about <= kMaxNumber)) return "body.inertia: expected 1e-12 to 1e9";
  }
  constexpr double kRelativeTolerance = 1e-9;
  if (i[0] + i[1] + i[2] < (2 - kRelativeTolerance) * std::max({i[0], i[1], i[2]})) {
    return "body.inertia: expected no moment larger than the other two together";
  }
  if (!(b.friction >= 0 && b.friction <= kMaxNumber)) return "body.friction: expected 0 to 1e9";
  if (!(std::abs(b.ground) <= kMaxNumber)) return "body.ground: expected at most 1e9";
  return nullptr;
}

const char* invalid_scale(double scale, const spm::ModelSummary& summary) noexcept {
  if (!positive(scale)) return "scale: expected finite, above 0";
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const double bound : {double{summary.bounds_min[axis]}, double{summary.bounds_max[axis]}})
      if (!(std::abs(scale * bound) <= kMaxNumber)) return "scale: expected scaled bounds of at most 1e9 m";
  return nullptr;
}

namespace {

const char* invalid_field(const spm::ModelSummary& s) noexcept {
  if (s.base_vertices > s.vertices || s.records != s.vertices - s.base_vertices) {
    return "summary.records: expected vertices - base_vertices";
  }
  if (s.faces == 0 || s.base_faces > s.faces || s.faces >= spm::kMaxFaces)
    return "summary.faces: expected at least 1 and base_faces, below 2^30";
  if (s.parts < s.records) return "summary.parts: expected at least records";
  if (!all_finite(s.bounds_min) || !all_finite(s.bounds_max)) return "summary.bounds: expected finite numbers";
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (s.bounds_min[axis] > s.bounds_max[axis]) return "summary.bounds: expected min at most max";
  }
  if (!all_finite(s.grid.origin)) return "summary.grid.origin: expected finite numbers";
  if (!positive(s.grid.cell_size)) return "summary.grid.cell_size: expected finite, above 0";
  if (!positive(s.metres_per_unit)) return "summary.metres_per_unit: expected finite, above 0";
  if (!(std::isfinite(s.position_step) && s.position_step >= 0)) {
    return "summary.position_step: expected finite, at least 0";
  }
  if (!(std::isfinite(s.deviation) && s.deviation >= 0)) return "summary.deviation: expected finite, at least 0";
  return nullptr;
}

}  // namespace

bool is_partition(const std::string& name) noexcept {
  return is_name(name) && name.find_first_of("*?[]\\") == std::string::npos;
}

const char* invalid_field(const RosterEntry& r) noexcept {
  if (r.role > Role::kViewer) return "role: expected 0..3";
  if (!is_partition(r.name)) return "name: expected 1..63 bytes without control characters and * ? [ ] \\";
  if (!is_name(r.session)) return "session: expected 1..63 bytes without control characters";
  if (id_of(r.name) != r.origin.participant) return "name: expected the name with id origin.participant";
  if (id_of(r.session) != r.origin.session) return "session: expected the name with id origin.session";
  if (!r.requested_hrtc.empty() && !is_name(r.requested_hrtc))
    return "requested_hrtc: expected at most 63 bytes without control characters";
  if (r.users.size() > kMaxUsers) return "users: expected at most 64";
  for (const std::string& user : r.users) {
    if (!is_partition(user)) return "users: expected names of 1..63 bytes without control characters and * ? [ ] \\";
  }
  if (r.served_users.size() > kMaxUsers) return "served_users: expected at most 64";
  for (const UserProbe& probe : r.served_users) {
    if (!is_name(probe.user)) return "served_users.user: expected 1..63 bytes without control characters";
    if (probe.probe >= kMaxUsers) return "served_users.probe: expected 0..63";
  }
  if (r.stops.size() > kMaxStops) return "stops: expected at most 32";
  constexpr std::int64_t kMaxSessionNs = INT64_C(1) << 60;  // 36 years; differences do not overflow
  const auto in_session = [](std::int64_t time_ns) { return time_ns >= 0 && time_ns <= kMaxSessionNs; };
  if (!in_session(r.session_time_ns)) return "session_time_ns: expected 0..2^60";
  if (r.joined_ns != kNotJoined && !in_session(r.joined_ns)) return "joined_ns: expected 0..2^60, or 2^63 - 1";
  constexpr std::int64_t kMaxDate = INT64_C(253402300799);  // the end of the year 9999
  if (r.revoked_made_s < 0 || r.revoked_made_s > kMaxDate)
    return "revoked_made_s: expected a time before the year 10000";
  return nullptr;
}

const char* invalid_field(const CatalogueEntry& c) noexcept {
  if (!is_name(c.host)) return "host: expected 1..63 bytes without control characters";
  if (!is_name(c.object)) return "object: expected 1..63 bytes without control characters";
  if (id_of(c.host) != c.origin.participant) return "host: expected the name with id origin.participant";
  if (id_of(c.object) != c.object_id) return "object: expected the name with id object_id";
  if (c.withdrawn) return nullptr;  // the other fields have no meaning
  if (const char* f = invalid_field(c.summary)) return f;
  if (const char* f = invalid_scale(c.scale, c.summary)) return f;
  if (const char* f = invalid_field(c.pose)) return f;
  if (const char* f = invalid_field(c.material)) return f;
  if (c.surface.points.size() > kMaxSurfacePoints) return "surface.points: expected at most 32";
  for (const spm::SurfacePoint& point : c.surface.points) {
    if (!all_finite(point.position)) return "surface.points.position: expected finite numbers";
    if (!all_finite(point.normal)) return "surface.points.normal: expected finite numbers";
  }
  if (!not_negative(c.surface.spacing)) return "surface.spacing: expected finite, at least 0";
  return invalid_field(c.body);
}

const char* invalid_field(const Demand& d) noexcept {
  if (d.have.size() > kMaxHaveIntervals) return "have: expected at most 1024 intervals";
  if (!ascending(d.have)) return "have: expected ascending intervals of regions below 0xffffffff";
  if (d.gaps.size() > kMaxGaps) return "gaps: expected at most 128 intervals";
  if (!ascending(d.gaps)) return "gaps: expected ascending intervals of sequences below 0xffffffff";
  if (d.wanted.size() > kMaxWanted) return "wanted: expected at most 256 regions";
  if (d.credit > kMaxCredit) return "credit: expected at most 8388608";
  return nullptr;
}

const char* invalid_field(const ShownRegions& s) noexcept {
  if (s.regions.size() > kMaxShownRegions) return "regions: expected at most 1024";
  return nullptr;
}

const char* invalid_field(const Metrics& m) noexcept {
  if (m.figures.size() > kMaxFigures) return "figures: expected at most 128";
  for (const Figure& figure : m.figures) {
    if (!is_name(figure.name)) return "figures.name: expected 1..63 bytes without control characters";
    if (!std::isfinite(figure.value)) return "figures.value: expected a finite number";
  }
  if (m.meshes.size() > kMaxMeshes) return "meshes: expected at most 64";
  return nullptr;
}

const char* invalid_field(const Control& c) noexcept {
  if (c.kind > ControlKind::kMode) return "kind: expected 0..1";
  if (!fits(c.text, kMaxText)) return "text: expected at most 255 bytes";
  return nullptr;
}

const char* invalid_field(const EmergencyStop& s) noexcept {
  if (s.number == 0) return "number: expected at least 1";
  if (!fits(s.text, kMaxText)) return "text: expected at most 255 bytes";
  return nullptr;
}

const char* invalid_field(const ForceReset& r) noexcept {
  if (r.number == 0) return "number: expected at least 1";
  if (r.stops.size() > kMaxStops) return "stops: expected at most 32";
  for (const StopName& stop : r.stops) {
    if (stop.number == 0) return "stops.number: expected at least 1";
  }
  if (!fits(r.text, kMaxText)) return "text: expected at most 255 bytes";
  return nullptr;
}

const char* invalid_field(const SessionEnd& e) noexcept {
  if (!fits(e.text, kMaxText)) return "text: expected at most 255 bytes";
  return nullptr;
}

const char* invalid_field(const BulkChunk& b) noexcept {
  if (b.sequence == 0) return "sequence: expected at least 1";
  std::size_t bytes = 0;
  for (const BulkPiece& piece : b.pieces) {
    if (piece.index >= piece.count) return "pieces.index: expected below count";
    if (piece.payload.empty()) return "pieces.payload: expected at least one byte";
    if ((piece.region == spm::kNone) != (b.kind() == BulkKind::kBase))
      return "pieces.region: expected base meshes and regions in different chunks";
    bytes += header_bytes(piece.region, piece.count) + piece.payload.size();
  }
  if (bytes > kMaxPayload) return "pieces: expected at most 1400 bytes with their headers";
  return nullptr;
}

const char* invalid_field(const Intent& i) noexcept {
  if (i.path.empty() || i.path.size() > kMaxWaypoints) return "path: expected 1..16 waypoints";
  for (std::size_t k = 0; k < i.path.size(); ++k) {
    if (!is_time(i.path[k].session_time_ns)) return "path.session_time_ns: expected within 2^61 ns of zero";
    if (const char* f = invalid_field(i.path[k].pose)) return f;
    if (k > 0 && i.path[k].session_time_ns <= i.path[k - 1].session_time_ns) return "path: expected ascending times";
  }
  return nullptr;
}

const char* invalid_field(const ProbeState& p) noexcept {
  if (!is_time(p.session_time_ns)) return kNoTime;
  if (const char* f = invalid_field(p.device)) return f;
  if (!all_moderate(p.proxy)) return "proxy: expected at most 1e9";
  if (!is_speed_of_hand(p.velocity)) return kTooFast;
  if (!all_moderate(p.force)) return "force: expected at most 1e9";
  if (!not_negative(p.radius)) return "radius: expected finite, at least 0";
  if (!not_negative(p.error_bound)) return "error_bound: expected finite, at least 0";
  if (!not_negative(p.stiffness)) return "stiffness: expected finite, at least 0";
  return nullptr;
}

const char* invalid_field(const DevicePose& d) noexcept {
  if (!is_time(d.session_time_ns)) return kNoTime;
  if (const char* f = invalid_field(d.pose)) return f;
  if (!is_speed_of_hand(d.velocity)) return kTooFast;
  if (!not_negative(d.radius)) return "radius: expected finite, at least 0";
  return nullptr;
}

const char* invalid_field(const DeviceCommand& d) noexcept {
  if (!all_moderate(d.force)) return "force: expected at most 1e9";
  if (!all_moderate(d.torque)) return "torque: expected at most 1e9";
  if (!all_moderate(d.normal)) return "normal: expected at most 1e9";
  if (!not_negative(d.error_bound)) return "error_bound: expected finite, at least 0";
  return nullptr;
}

const char* invalid_field(const ObjectPose& o) noexcept {
  if (!is_time(o.session_time_ns)) return kNoTime;
  if (const char* f = invalid_field(o.pose)) return f;
  if (!all_moderate(o.velocity)) return "velocity: expected at most 1e9";
  if (!all_moderate(o.angular_velocity)) return "angular_velocity: expected at most 1e9";
  return nullptr;
}

const char* invalid_field(const ObjectClaim& c) noexcept {
  constexpr std::int64_t kMaxDelayNs = std::int64_t{1} << 40;  // 18 minutes
  if (c.one_way_ns < 0 || c.one_way_ns > kMaxDelayNs) return "one_way_ns: expected 0 up to 2^40";
  return nullptr;
}

const char* invalid_field(const ObjectGrant& g) noexcept {
  constexpr std::int64_t kMaxDelayNs = std::int64_t{1} << 40;
  if (g.channel_delay_ns < 0 || g.channel_delay_ns > kMaxDelayNs) return "channel_delay_ns: expected 0 up to 2^40";
  if (g.touchers.size() > kMaxTouchers) return "touchers: expected at most 8";
  for (std::size_t i = 0; i < g.touchers.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (g.touchers[k].participant == g.touchers[i].participant) return "touchers: expected each participant once";
    }
  }
  return nullptr;
}

const char* invalid_field(const ObjectCopy& c) noexcept {
  if (c.session_time_ns < 0 || !is_time(c.session_time_ns)) return "session_time_ns: expected 0 up to 2^61";
  if (c.channels.size() < 2 || c.channels.size() > kMaxTouchers) return "channels: expected 2 to 8";
  if (c.copy_index >= c.channels.size()) return "copy_index: expected below the number of channels";
  if (const char* f = invalid_field(c.body)) return f;
  if (!all_moderate(c.body.position)) return "body.position: expected at most 1e9";
  if (!all_moderate(c.velocity)) return "velocity: expected at most 1e9";
  if (!all_moderate(c.angular_velocity)) return "angular_velocity: expected at most 1e9";
  if (!all_moderate(c.user_force)) return "user_force: expected at most 1e9";
  for (const CopyChannel& channel : c.channels) {
    if (!all_moderate(channel.wave)) return "channels.wave: expected at most 1e9";
    if (!not_negative(channel.energy) || channel.energy > kMaxNumber) return "channels.energy: expected 0 up to 1e9";
  }
  return nullptr;
}

const char* invalid_field(const ClockSample&) noexcept { return nullptr; }  // SessionClock checks the times

}  // namespace tactus::session
