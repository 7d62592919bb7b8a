#include "support.hpp"

namespace tactus::wire::test {
namespace {

const ses::Pose kPose{{0.1, -0.2, 0.3}, {0.5, -0.5, 0.5, 0.5}};

spm::ModelSummary summary() {
  spm::ModelSummary s{};
  s.digest = 0x1122334455667788u;
  s.vertices = 1000;
  s.faces = 1996;
  s.base_vertices = 100;
  s.base_faces = 196;
  s.records = 900;
  s.parts = 905;
  s.regions = 8;
  s.max_level = 21;
  s.bounds_min = {-1.5f, -2.5f, -3.5f};
  s.bounds_max = {1.25f, 2.25f, 3.25f};
  s.grid = {{-1.5, -2.5, -3.5}, 0.75};
  s.metres_per_unit = 0.001;
  s.deviation = 0.5;
  s.position_step = 0.0625;
  return s;
}

}  // namespace

template <>
ses::RosterEntry full_sample(const Participants& from) {
  return {from.origin(),
          ses::kProtocolVersion,
          ses::Role::kClient,
          from.address().participant,
          from.address().session,
          "hrtc 1",
          {"alice", "bob"},
          {{"carol", 3}, {"dave", 63}},
          77,
          true,
          {{11, 12, 3, 2, 0}, {13, 14, 0, 0, 5}},
          0x8877665544332211u,
          78'000'000'000,
          79'000'000'000,
          true};
}

template <>
ses::CatalogueEntry full_sample(const Participants& from) {
  ses::CatalogueEntry c;
  c.origin = from.origin();
  c.host = from.address().participant;
  c.object = "organ";
  c.object_id = ses::id_of("organ");
  c.summary = summary();
  c.scale = 0.002;
  c.pose = kPose;
  c.material = {1234.5, 2.5, 0.75, 0.5};
  c.body = {0.875, {0.002, 0.003, 0.0045}, 0.625, -0.25};
  c.base_bytes = 4711;
  c.surface = {{{{0.25f, 0.5f, -1}, {0, 0, 1}}, {{1, 2, 3}, {-1, 0, 0}}}, 0.125};
  return c;
}

template <>
ses::Demand full_sample(const Participants& from) {
  return {from.origin(),      11, 12, 13, 14, true, {{0, 3}, {5, 1}, {9, 20}}, {{4, 1500}, {6, 2500}}, 15, 16, 30,
          {{17, 2}, {21, 1}}, 17, 18, 19};
}

template <>
ses::Metrics full_sample(const Participants& from) {
  return {from.origin(), {{"cycle_p99_us", 47.5}, {"late", -0.0}}, {{17, 0}, {18, 0xfedcba9876543210}}, 19};
}

template <>
ses::ShownRegions full_sample(const Participants& from) {
  return {from.origin(), 17, 18, 0xfedcba9876543210, false, {{0, 1}, {70'000, 5}}};
}

template <>
ses::Control full_sample(const Participants& from) {
  return {from.origin(), 5, ses::ControlKind::kMode, "large-scale"};
}

template <>
ses::EmergencyStop full_sample(const Participants& from) {
  return {from.origin(), 6, "requested by the operator"};
}

template <>
ses::ForceReset full_sample(const Participants& from) {
  return {from.origin(), 7, {{11, 12, 3}, {13, 14, 0xffffffff}}, "requested by the operator"};
}

template <>
ses::SessionEnd full_sample(const Participants& from) {
  return {from.origin(), "requested by the operator"};
}

template <>
ses::BulkChunk full_sample(const Participants&) {
  return {21,
          24,
          25,
          28,
          {{26, 2, 9, 27, {1, 2, 3, 0, 255}}, {70'000, 66'000, 70'001, ~0u, {128}}, {0, 0, 1, 5, {0, 128}}},
          false,
          {}};
}

template <>
ses::Intent full_sample(const Participants& from) {
  return {from.origin(), ses::id_of("ann"), 2, 33, 34, {{100, kPose}, {200, {{-4, 5, -6}, {0, 0.6, 0, 0.8}}}}};
}

template <>
ses::ProbeState full_sample(const Participants& from) {
  ses::ProbeState p;
  p.origin = from.origin();
  p.user_id = 41;
  p.probe = 1;
  p.sequence = 43;
  p.session_time_ns = -44;
  p.time_bound_us = 45;
  p.device = kPose;
  p.proxy = {1.5, 2.5, 3.5};
  p.velocity = {-0.01, 0.02, -0.03};
  p.force = {0.5, -1.5, 2.5};
  p.radius = 0.005;
  p.object_id = 46;
  p.status = ses::kInContact | ses::kSurfaceMoved;
  p.error_bound = 0.25f;
  p.data_age_us = 47;
  p.stiffness = 800.5f;
  return p;
}

template <>
ses::DevicePose full_sample(const Participants& from) {
  return {from.origin(), ses::id_of("ann"), 1, 53, 54, kPose, {0.1, 0.2, 0.3}, 0.004, 0x80000001u, 55};
}

template <>
ses::DeviceCommand full_sample(const Participants& from) {
  return {from.origin(), ses::id_of("ann"), 1, 63, 64, {1, 2, 3}, {4, 5, 6}, {0, 0, 1}, ses::kExact, 0.125f, 65};
}

template <>
ses::ObjectPose full_sample(const Participants& from) {
  return {from.origin(), 71, 72, 73, 74, kPose, {1, 2, 3}, {4, 5, 6}};
}

template <>
ses::ObjectClaim full_sample(const Participants& from) {
  return {from.origin(), 91, 92, true, 93, 94};
}

template <>
ses::ObjectGrant full_sample(const Participants& from) {
  return {from.origin(), 101, 102, 103, 104, {{105, 106, 107}, {108, 109, 110}}};
}

template <>
ses::ObjectCopy full_sample(const Participants& from) {
  return {from.origin(),
          111,
          112,
          113,
          2,
          114,
          kPose,
          {1, 2, 3},
          {4, 5, 6},
          {-7, 8, -9},
          {{{1, 2, 3, 4, 5, 6}, 0.5}, {{-1, -2, -3, -4, -5, -6}, 1.5}, {{7, 8, 9, 10, 11, 12}, 2.5}}};
}

template <>
ses::ClockSample full_sample(const Participants& from) {
  return {from.origin(), 81, 82, true, 83, -84, 85};
}

}  // namespace tactus::wire::test
