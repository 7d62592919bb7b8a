#include "session/check.hpp"

#include <gmock/gmock.h>

#include <limits>
#include <string>

#include "session/printable.hpp"

namespace tactus::session {
namespace {

using testing::HasSubstr;
using testing::IsNull;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

// Valid samples.

RosterEntry roster() {
  RosterEntry entry;
  entry.name = "p";
  entry.session = "s";
  entry.origin.participant = id_of("p");
  entry.origin.session = id_of("s");
  return entry;
}

CatalogueEntry catalogue() {
  CatalogueEntry c{};
  c.host = "h";
  c.object = "o";
  c.origin.participant = id_of("h");
  c.object_id = id_of("o");
  c.summary.vertices = 8;
  c.summary.faces = 12;
  c.summary.base_vertices = 4;
  c.summary.base_faces = 4;
  c.summary.records = 4;
  c.summary.parts = 4;
  c.summary.grid.cell_size = 1;
  c.summary.metres_per_unit = 1;
  return c;
}

CatalogueEntry body() {
  CatalogueEntry c = catalogue();
  c.scale = 1;
  c.body = {0.5, {1e-3, 2e-3, 3e-3}, 0.5, 0};
  return c;
}

ObjectGrant grant_with_touchers(std::uint64_t count) {
  ObjectGrant g;
  for (std::uint64_t i = 1; i <= count; ++i) g.touchers.push_back({i, 1, 1});
  return g;
}

ObjectCopy copy() {
  ObjectCopy c;
  c.copy_index = 1;
  c.channels.resize(2);
  return c;
}

BulkChunk chunk() {
  BulkChunk b;
  b.sequence = 1;
  b.pieces = {{3, 0, 1, 0, {1}}};
  return b;
}

/// `invalidate` makes a valid sample invalid; the reason must name `field`.
template <class Sample, class Invalidate>
void expect_invalid(Sample sample, const char* field, Invalidate&& invalidate) {
  ASSERT_THAT(invalid_field(sample), IsNull());
  invalidate(sample);
  const char* reason = invalid_field(sample);
  ASSERT_NE(reason, nullptr) << field;
  EXPECT_THAT(reason, HasSubstr(field));
}

TEST(Check, NamesTheWrongFieldOfARosterEntry) {
  expect_invalid(roster(), "role", [](auto& r) { r.role = static_cast<Role>(4); });
  expect_invalid(roster(), "name", [](auto& r) { r.name.clear(); });
  expect_invalid(roster(), "name", [](auto& r) { r.name = "q"; });
  for (const char* name : {"a*b", "a?", "a[b", "a]", "a\\b"}) {
    expect_invalid(roster(), "name: ", [&](auto& r) {
      r.name = name;
      r.origin.participant = id_of(name);
    });
    expect_invalid(roster(), "users: ", [&](auto& r) { r.users = {name}; });
  }
  expect_invalid(roster(), "session", [](auto& r) { r.session = "t"; });
  expect_invalid(roster(), "requested_hrtc", [](auto& r) { r.requested_hrtc.assign(64, 'c'); });
  expect_invalid(roster(), "requested_hrtc", [](auto& r) { r.requested_hrtc = std::string("a\0b", 3); });
  expect_invalid(roster(), "users", [](auto& r) { r.users.assign(65, "u"); });
  expect_invalid(roster(), "users", [](auto& r) { r.users = {""}; });
  expect_invalid(roster(), "served_users", [](auto& r) { r.served_users.assign(65, {"u", 0}); });
  expect_invalid(roster(), "served_users.probe", [](auto& r) { r.served_users = {{"u", 64}}; });
  expect_invalid(roster(), "stops", [](auto& r) { r.stops.assign(33, {1, 2, 3, 4, 5}); });
  expect_invalid(roster(), "session_time_ns", [](auto& r) { r.session_time_ns = -1; });
  expect_invalid(roster(), "session_time_ns", [](auto& r) { r.session_time_ns = INT64_MAX; });
  expect_invalid(roster(), "joined_ns", [](auto& r) { r.joined_ns = kNotJoined - 1; });
}

TEST(Check, RefusesNamesWithControlCharacters) {
  for (const char* name : {"a\nb", "\x1b[2J", "\x01", "a\x7f", "a\xc2\x80", "\xc2\x9f-"}) {
    EXPECT_TRUE(has_control_character(name));
    expect_invalid(roster(), "name: expected 1..63 bytes", [&](auto& r) {
      r.name = name;
      r.origin.participant = id_of(name);
    });
    expect_invalid(roster(), "session: expected 1..63 bytes", [&](auto& r) {
      r.session = name;
      r.origin.session = id_of(name);
    });
    expect_invalid(roster(), "requested_hrtc: ", [&](auto& r) { r.requested_hrtc = name; });
    expect_invalid(roster(), "users: ", [&](auto& r) { r.users = {name}; });
    expect_invalid(roster(), "served_users.user: ", [&](auto& r) { r.served_users = {{name, 0}}; });
    expect_invalid(catalogue(), "object: expected 1..63 bytes", [&](auto& c) {
      c.object = name;
      c.object_id = id_of(name);
    });
  }
  for (const char* name : {"\xc2\xa0", "Zo\xc3\xab", "\xc2", "a b", "\xe2\x80\x9c"})
    EXPECT_FALSE(has_control_character(name)) << name;
}

TEST(Check, AcceptsAStopWithAnyText) {
  EmergencyStop stop;
  stop.number = 1;
  stop.text = "needle bent\n\x1b[2J\xc2\x9b";
  EXPECT_THAT(invalid_field(stop), IsNull());
}

TEST(Check, LeavesTheProtocolVersionToTheSession) {
  auto r = roster();
  r.protocol = kProtocolVersion + 1;
  EXPECT_THAT(invalid_field(r), IsNull());
}

TEST(Check, NamesTheWrongFieldOfACatalogueEntry) {
  expect_invalid(catalogue(), "object", [](auto& c) { c.object_id = 1; });
  expect_invalid(catalogue(), "host", [](auto& c) { c.origin.participant = 1; });
  expect_invalid(catalogue(), "scale", [](auto& c) { c.scale = 0; });
  expect_invalid(catalogue(), "scale", [](auto& c) { c.scale = kInf; });
  expect_invalid(catalogue(), "orientation", [](auto& c) { c.pose.orientation = {0, 0, 0, 1.01}; });
  expect_invalid(catalogue(), "orientation", [](auto& c) { c.pose.orientation[0] = kNan; });
  expect_invalid(catalogue(), "position", [](auto& c) { c.pose.position[0] = kInf; });
  expect_invalid(catalogue(), "scale: expected scaled bounds", [](auto& c) {
    c.summary.bounds_max[1] = 1e30f;
    c.scale = 1e-20;
  });
  expect_invalid(catalogue(), "records", [](auto& c) { c.summary.records = 5; });
  expect_invalid(catalogue(), "records", [](auto& c) { c.summary.base_vertices = 9; });
  expect_invalid(catalogue(), "faces", [](auto& c) { c.summary.base_faces = 13; });
  expect_invalid(catalogue(), "faces", [](auto& c) { c.summary.faces = spm::kMaxFaces; });
  expect_invalid(catalogue(), "parts", [](auto& c) { c.summary.parts = 3; });
  expect_invalid(catalogue(), "bounds", [](auto& c) { c.summary.bounds_min[1] = 1; });
  expect_invalid(catalogue(), "cell_size", [](auto& c) { c.summary.grid.cell_size = -1; });
  expect_invalid(catalogue(), "metres_per_unit", [](auto& c) { c.summary.metres_per_unit = kNan; });
  expect_invalid(catalogue(), "surface.points", [](auto& c) { c.surface.points.resize(33); });
  expect_invalid(catalogue(), "surface.points.position", [](auto& c) {
    c.surface.points.resize(1);
    c.surface.points[0].position[2] = std::numeric_limits<float>::quiet_NaN();
  });
  expect_invalid(catalogue(), "surface.points.normal", [](auto& c) {
    c.surface.points.resize(2);
    c.surface.points[1].normal[0] = std::numeric_limits<float>::infinity();
  });
  expect_invalid(catalogue(), "surface.spacing", [](auto& c) { c.surface.spacing = -1; });
  expect_invalid(catalogue(), "stiffness", [](auto& c) { c.material.stiffness = -1; });
  expect_invalid(catalogue(), "dynamic_friction", [](auto& c) { c.material.dynamic_friction = 0.1; });
}

TEST(Check, ChecksOnlyTheNamesOfAWithdrawnObject) {
  auto c = catalogue();
  c.withdrawn = true;
  c.scale = 0;
  EXPECT_THAT(invalid_field(c), IsNull());
  c.object = "x";
  EXPECT_NE(invalid_field(c), nullptr);
}

TEST(Check, NamesTheWrongFieldOfADemand) {
  expect_invalid(Demand{}, "have", [](auto& d) { d.have = {{0, 0}}; });
  expect_invalid(Demand{}, "have", [](auto& d) { d.have = {{5, 2}, {6, 1}}; });
  expect_invalid(Demand{}, "have", [](auto& d) { d.have = {{0xfffffff0u, 0x20}}; });
  expect_invalid(Demand{}, "wanted", [](auto& d) { d.wanted.resize(257); });
  Demand of_largest_credit;
  of_largest_credit.credit = 8u << 20;
  expect_invalid(of_largest_credit, "credit: expected at most 8388608", [](auto& d) { ++d.credit; });
  expect_invalid(Demand{}, "gaps", [](auto& d) { d.gaps = {{5, 1}, {5, 1}}; });
  expect_invalid(Demand{}, "gaps", [](auto& d) {
    for (std::uint32_t i = 0; i < 129; ++i) d.gaps.push_back({2 * i, 1});
  });
  expect_invalid(Demand{}, "have", [](auto& d) {
    for (std::uint32_t i = 0; i < 1025; ++i) d.have.push_back({2 * i, 1});
  });
}

TEST(Check, NamesTheWrongFieldOfABulkChunk) {
  expect_invalid(chunk(), "sequence", [](auto& b) { b.sequence = 0; });
  expect_invalid(chunk(), "pieces.index", [](auto& b) { b.pieces[0].index = 1; });
  expect_invalid(chunk(), "pieces.index", [](auto& b) { b.pieces[0].count = 0; });
  expect_invalid(chunk(), "pieces", [](auto& b) { b.pieces[0].payload.resize(kMaxPayload - 2); });
  expect_invalid(chunk(), "pieces.payload", [](auto& b) { b.pieces[0].payload.clear(); });
  expect_invalid(chunk(), "pieces.region", [](auto& b) { b.pieces.push_back({spm::kNone, 0, 1, 0, {1}}); });
}

TEST(Check, NamesTheWrongFieldOfProbeSamples) {
  Intent intent;
  intent.path = {{1, {}}, {2, {}}};
  expect_invalid(intent, "path", [](auto& i) { i.path.clear(); });
  const auto with_waypoints = [](Intent& i, std::int64_t count) {
    i.path.clear();
    for (std::int64_t time = 1; time <= count; ++time) i.path.push_back({time, {}});
  };
  with_waypoints(intent, 16);
  expect_invalid(intent, "path", [&](auto& i) { with_waypoints(i, 17); });
  expect_invalid(intent, "path", [](auto& i) { i.path[1].session_time_ns = 1; });
  expect_invalid(intent, "position", [](auto& i) { i.path[0].pose.position[1] = kNan; });
  expect_invalid(intent, "orientation", [](auto& i) { i.path[1].pose.orientation = {0, 0, 0, 1.1}; });
  expect_invalid(ProbeState{}, "orientation", [](auto& p) { p.device.orientation = {0, 0, 0, 0}; });
  expect_invalid(ProbeState{}, "proxy", [](auto& p) { p.proxy[0] = kNan; });
  expect_invalid(ProbeState{}, "velocity", [](auto& p) { p.velocity[1] = kInf; });
  expect_invalid(ProbeState{}, "velocity: expected at most 1000 m/s", [](auto& p) { p.velocity[1] = 1001; });
  expect_invalid(ProbeState{}, "position", [](auto& p) { p.device.position[0] = 2e9; });
  expect_invalid(ProbeState{}, "force", [](auto& p) { p.force[2] = -kInf; });
  expect_invalid(ProbeState{}, "radius", [](auto& p) { p.radius = -1e-9; });
  expect_invalid(ProbeState{}, "error_bound", [](auto& p) { p.error_bound = -1; });
  expect_invalid(DevicePose{}, "position", [](auto& d) { d.pose.position[2] = kNan; });
  expect_invalid(DevicePose{}, "velocity", [](auto& d) { d.velocity[0] = kNan; });
  expect_invalid(DevicePose{}, "velocity: expected at most 1000 m/s", [](auto& d) { d.velocity[2] = -1001; });
  expect_invalid(DevicePose{}, "radius", [](auto& d) { d.radius = kNan; });
  expect_invalid(DeviceCommand{}, "force", [](auto& d) { d.force[0] = kNan; });
  expect_invalid(DeviceCommand{}, "torque", [](auto& d) { d.torque[0] = kNan; });
  expect_invalid(DeviceCommand{}, "normal", [](auto& d) { d.normal[0] = kNan; });
  expect_invalid(DeviceCommand{}, "error_bound", [](auto& d) { d.error_bound = -1; });
  expect_invalid(ObjectPose{}, "velocity", [](auto& o) { o.velocity[0] = kNan; });
  expect_invalid(ObjectPose{}, "angular_velocity", [](auto& o) { o.angular_velocity[0] = kNan; });
  expect_invalid(ObjectPose{}, "orientation", [](auto& o) { o.pose.orientation[3] = -1.002; });
}

TEST(Check, NamesTheWrongFieldOfSharedObjectSamples) {
  expect_invalid(body(), "body.mass", [](auto& c) { c.body.mass = -1; });
  expect_invalid(body(), "body.mass", [](auto& c) { c.body.mass = kNan; });
  expect_invalid(body(), "body.mass", [](auto& c) { c.body.mass = 1e-300; });
  expect_invalid(body(), "body.inertia", [](auto& c) { c.body.inertia[1] = 0; });
  expect_invalid(body(), "body.inertia", [](auto& c) { c.body.inertia[2] = 0.01; });
  expect_invalid(body(), "body.friction", [](auto& c) { c.body.friction = -0.1; });
  expect_invalid(body(), "body.ground", [](auto& c) { c.body.ground = kInf; });
  expect_invalid(ObjectClaim{}, "one_way_ns", [](auto& c) { c.one_way_ns = -1; });
  expect_invalid(ObjectGrant{}, "channel_delay_ns", [](auto& g) { g.channel_delay_ns = std::int64_t{1} << 50; });
  expect_invalid(grant_with_touchers(8), "touchers: expected at most 8", [](auto& g) { g = grant_with_touchers(9); });
  expect_invalid(ObjectGrant{}, "touchers", [](auto& g) { g.touchers = {{1, 2, 3}, {1, 3, 3}}; });
  expect_invalid(copy(), "session_time_ns", [](auto& c) { c.session_time_ns = -1; });
  expect_invalid(copy(), "channels", [](auto& c) {
    c.channels.resize(8);
    EXPECT_THAT(invalid_field(c), IsNull());
    c.channels.resize(9);
  });
  expect_invalid(copy(), "copy_index", [](auto& c) { c.copy_index = 2; });
  expect_invalid(copy(), "orientation", [](auto& c) { c.body.orientation[3] = 0; });
  expect_invalid(copy(), "velocity", [](auto& c) { c.velocity[2] = kNan; });
  expect_invalid(copy(), "angular_velocity", [](auto& c) { c.angular_velocity[2] = kNan; });
  expect_invalid(copy(), "user_force", [](auto& c) { c.user_force[1] = kInf; });
  expect_invalid(copy(), "channels.wave", [](auto& c) { c.channels[0].wave[5] = kInf; });
  expect_invalid(copy(), "channels.wave", [](auto& c) { c.channels[1].wave[0] = -1e308; });
  expect_invalid(copy(), "channels.energy", [](auto& c) { c.channels[1].energy = 1e10; });
  expect_invalid(copy(), "channels.energy", [](auto& c) { c.channels[1].energy = -1e-9; });
}

TEST(Check, IgnoresTheBodyOfAStaticObject) {
  CatalogueEntry c = body();
  c.body = {0, {-1, kNan, 0}, -1, kNan};
  EXPECT_THAT(invalid_field(c), IsNull());
}

TEST(Check, AcceptsAQuaternionWithinTheTolerance) {
  ObjectPose o;
  o.pose.orientation = {0, 0, 0, -1.0009};
  EXPECT_THAT(invalid_field(o), IsNull());
}

TEST(Check, NamesTheWrongFieldOfMetricsAndControl) {
  expect_invalid(Metrics{}, "figures", [](auto& m) { m.figures.assign(129, {"f", 0}); });
  expect_invalid(Metrics{}, "figures.name", [](auto& m) { m.figures = {{"", 0}}; });
  expect_invalid(Metrics{}, "figures.value", [](auto& m) { m.figures = {{"f", kNan}}; });
  expect_invalid(Metrics{}, "meshes", [](auto& m) { m.meshes.assign(65, {1, 2}); });
  expect_invalid(ShownRegions{}, "regions", [](auto& s) { s.regions.assign(1025, {1, 2}); });
  expect_invalid(Control{}, "kind", [](auto& c) { c.kind = static_cast<ControlKind>(2); });
  expect_invalid(Control{}, "text", [](auto& c) { c.text.assign(256, 't'); });
}

TEST(Check, NamesTheWrongFieldOfStopsResetsAndEnds) {
  EmergencyStop stop;
  EXPECT_THAT(invalid_field(stop), HasSubstr("number"));
  stop.number = 1;
  EXPECT_THAT(invalid_field(stop), IsNull());
  expect_invalid(stop, "text", [](auto& s) { s.text.assign(256, 't'); });
  ForceReset reset;
  EXPECT_THAT(invalid_field(reset), HasSubstr("number"));
  reset.number = 1;
  EXPECT_THAT(invalid_field(reset), IsNull());
  expect_invalid(reset, "stops", [](auto& r) { r.stops.assign(33, {1, 2, 3}); });
  expect_invalid(reset, "stops.number", [](auto& r) { r.stops = {{1, 2, 0}}; });
  expect_invalid(reset, "text", [](auto& r) { r.text.assign(256, 't'); });
  expect_invalid(SessionEnd{}, "text", [](auto& e) { e.text.assign(256, 't'); });
}

}  // namespace
}  // namespace tactus::session
