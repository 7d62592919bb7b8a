#include "wire/convert.hpp"

namespace tactus::wire {

// The IDL and session/messages.hpp have to state the same bounds.
static_assert(idl::kProtocolVersion == session::kProtocolVersion);
static_assert(idl::kMaxName == session::kMaxName);
static_assert(idl::kMaxText == session::kMaxText);
static_assert(idl::kMaxUsers == session::kMaxUsers);
static_assert(idl::kMaxHaveIntervals == session::kMaxHaveIntervals);
static_assert(idl::kMaxWanted == session::kMaxWanted);
static_assert(idl::kMaxPayload == session::kMaxPayload);
static_assert(idl::kMaxFigures == session::kMaxFigures);
static_assert(idl::kMaxMeshes == session::kMaxMeshes);
static_assert(idl::kMaxShownRegions == session::kMaxShownRegions);
static_assert(idl::kMaxWaypoints == session::kMaxWaypoints);
static_assert(idl::kMaxCredit == session::kMaxCredit);
static_assert(idl::kMaxSurfacePoints == session::kMaxSurfacePoints);
static_assert(idl::kMaxTouchers == session::kMaxTouchers);

idl::PoseValue pose_to_idl(const session::Pose& from) {
  idl::PoseValue to;
  to.position(from.position);
  to.orientation(from.orientation);
  return to;
}

session::Pose pose_from_idl(const idl::PoseValue& from) { return {from.position(), from.orientation()}; }

void to_idl(const session::EmergencyStop& from, idl::EmergencyStop& to) {
  origin_to_idl(from.origin, to);
  to.stop_number(from.number);
  to.text(from.text);
}

void from_idl(const idl::EmergencyStop& from, session::EmergencyStop& to) {
  to.origin = origin_from_idl(from);
  to.number = from.stop_number();
  to.text = from.text().to_string();
}

void to_idl(const session::Intent& from, idl::Intent& to) {
  origin_to_idl(from.origin, to);
  to.user_id(from.user_id);
  to.probe(from.probe);
  to.sequence_number(from.sequence);
  to.buttons(from.buttons);
  to.path().resize(from.path.size());
  for (std::size_t i = 0; i < from.path.size(); ++i) {
    to.path()[i].session_time_ns(from.path[i].session_time_ns);
    to.path()[i].pose(pose_to_idl(from.path[i].pose));
  }
}

void from_idl(const idl::Intent& from, session::Intent& to) {
  to.origin = origin_from_idl(from);
  to.user_id = from.user_id();
  to.probe = from.probe();
  to.sequence = from.sequence_number();
  to.buttons = from.buttons();
  to.path.resize(from.path().size());
  for (std::size_t i = 0; i < to.path.size(); ++i) {
    to.path[i] = {from.path()[i].session_time_ns(), pose_from_idl(from.path()[i].pose())};
  }
}

void to_idl(const session::ProbeState& from, idl::ProbeState& to) {
  origin_to_idl(from.origin, to);
  to.user_id(from.user_id);
  to.probe(from.probe);
  to.sequence_number(from.sequence);
  to.session_time_ns(from.session_time_ns);
  to.time_bound_us(from.time_bound_us);
  to.device(pose_to_idl(from.device));
  to.proxy(from.proxy);
  to.velocity(from.velocity);
  to.force(from.force);
  to.radius(from.radius);
  to.object_id(from.object_id);
  to.status(from.status);
  to.error_bound(from.error_bound);
  to.data_age_us(from.data_age_us);
  to.stiffness(from.stiffness);
}

void from_idl(const idl::ProbeState& from, session::ProbeState& to) {
  to.origin = origin_from_idl(from);
  to.user_id = from.user_id();
  to.probe = from.probe();
  to.sequence = from.sequence_number();
  to.session_time_ns = from.session_time_ns();
  to.time_bound_us = from.time_bound_us();
  to.device = pose_from_idl(from.device());
  to.proxy = from.proxy();
  to.velocity = from.velocity();
  to.force = from.force();
  to.radius = from.radius();
  to.object_id = from.object_id();
  to.status = from.status();
  to.error_bound = from.error_bound();
  to.data_age_us = from.data_age_us();
  to.stiffness = from.stiffness();
}

void to_idl(const session::DevicePose& from, idl::DevicePose& to) {
  origin_to_idl(from.origin, to);
  to.user_id(from.user_id);
  to.probe(from.probe);
  to.sequence_number(from.sequence);
  to.session_time_ns(from.session_time_ns);
  to.device(pose_to_idl(from.pose));
  to.velocity(from.velocity);
  to.radius(from.radius);
  to.buttons(from.buttons);
  to.command_applied(from.command_applied);
}

void from_idl(const idl::DevicePose& from, session::DevicePose& to) {
  to.origin = origin_from_idl(from);
  to.user_id = from.user_id();
  to.probe = from.probe();
  to.sequence = from.sequence_number();
  to.session_time_ns = from.session_time_ns();
  to.pose = pose_from_idl(from.device());
  to.velocity = from.velocity();
  to.radius = from.radius();
  to.buttons = from.buttons();
  to.command_applied = from.command_applied();
}

void to_idl(const session::DeviceCommand& from, idl::DeviceCommand& to) {
  origin_to_idl(from.origin, to);
  to.user_id(from.user_id);
  to.probe(from.probe);
  to.sequence_number(from.sequence);
  to.pose_answered(from.pose_answered);
  to.force(from.force);
  to.torque(from.torque);
  to.normal(from.normal);
  to.status(from.status);
  to.error_bound(from.error_bound);
  to.data_age_us(from.data_age_us);
}

void from_idl(const idl::DeviceCommand& from, session::DeviceCommand& to) {
  to.origin = origin_from_idl(from);
  to.user_id = from.user_id();
  to.probe = from.probe();
  to.sequence = from.sequence_number();
  to.pose_answered = from.pose_answered();
  to.force = from.force();
  to.torque = from.torque();
  to.normal = from.normal();
  to.status = from.status();
  to.error_bound = from.error_bound();
  to.data_age_us = from.data_age_us();
}

void to_idl(const session::ObjectPose& from, idl::ObjectPose& to) {
  origin_to_idl(from.origin, to);
  to.object_id(from.object_id);
  to.sequence_number(from.sequence);
  to.fencing(from.fencing);
  to.session_time_ns(from.session_time_ns);
  to.placement(pose_to_idl(from.pose));
  to.velocity(from.velocity);
  to.angular_velocity(from.angular_velocity);
}

void from_idl(const idl::ObjectPose& from, session::ObjectPose& to) {
  to.origin = origin_from_idl(from);
  to.object_id = from.object_id();
  to.sequence = from.sequence_number();
  to.fencing = from.fencing();
  to.session_time_ns = from.session_time_ns();
  to.pose = pose_from_idl(from.placement());
  to.velocity = from.velocity();
  to.angular_velocity = from.angular_velocity();
}

void to_idl(const session::ObjectClaim& from, idl::ObjectClaim& to) {
  origin_to_idl(from.origin, to);
  to.object_id(from.object_id);
  to.sequence_number(from.sequence);
  to.touching(from.touching);
  to.fencing(from.fencing);
  to.one_way_ns(from.one_way_ns);
}

void from_idl(const idl::ObjectClaim& from, session::ObjectClaim& to) {
  to.origin = origin_from_idl(from);
  to.object_id = from.object_id();
  to.sequence = from.sequence_number();
  to.touching = from.touching();
  to.fencing = from.fencing();
  to.one_way_ns = from.one_way_ns();
}

void to_idl(const session::ObjectGrant& from, idl::ObjectGrant& to) {
  origin_to_idl(from.origin, to);
  to.object_id(from.object_id);
  to.sequence_number(from.sequence);
  to.fencing(from.fencing);
  to.channel_delay_ns(from.channel_delay_ns);
  to.touchers().resize(from.touchers.size());
  for (std::size_t i = 0; i < from.touchers.size(); ++i) {
    to.touchers()[i].participant(from.touchers[i].participant);
    to.touchers()[i].incarnation(from.touchers[i].incarnation);
    to.touchers()[i].claim(from.touchers[i].claim);
  }
}

void from_idl(const idl::ObjectGrant& from, session::ObjectGrant& to) {
  to.origin = origin_from_idl(from);
  to.object_id = from.object_id();
  to.sequence = from.sequence_number();
  to.fencing = from.fencing();
  to.channel_delay_ns = from.channel_delay_ns();
  to.touchers.resize(from.touchers().size());
  for (std::size_t i = 0; i < to.touchers.size(); ++i) {
    const idl::ToucherValue& toucher = from.touchers()[i];
    to.touchers[i] = {toucher.participant(), toucher.incarnation(), toucher.claim()};
  }
}

void to_idl(const session::ObjectCopy& from, idl::ObjectCopy& to) {
  origin_to_idl(from.origin, to);
  to.object_id(from.object_id);
  to.sequence_number(from.sequence);
  to.fencing(from.fencing);
  to.copy_index(from.copy_index);
  to.session_time_ns(from.session_time_ns);
  to.body(pose_to_idl(from.body));
  to.velocity(from.velocity);
  to.angular_velocity(from.angular_velocity);
  to.user_force(from.user_force);
  to.channels().resize(from.channels.size());
  for (std::size_t i = 0; i < from.channels.size(); ++i) {
    to.channels()[i].wave(from.channels[i].wave);
    to.channels()[i].energy(from.channels[i].energy);
  }
}

void from_idl(const idl::ObjectCopy& from, session::ObjectCopy& to) {
  to.origin = origin_from_idl(from);
  to.object_id = from.object_id();
  to.sequence = from.sequence_number();
  to.fencing = from.fencing();
  to.copy_index = from.copy_index();
  to.session_time_ns = from.session_time_ns();
  to.body = pose_from_idl(from.body());
  to.velocity = from.velocity();
  to.angular_velocity = from.angular_velocity();
  to.user_force = from.user_force();
  to.channels.resize(from.channels().size());
  for (std::size_t i = 0; i < to.channels.size(); ++i)
    to.channels[i] = {from.channels()[i].wave(), from.channels()[i].energy()};
}

void to_idl(const session::ClockSample& from, idl::ClockSample& to) {
  origin_to_idl(from.origin, to);
  to.peer(from.peer);
  to.sequence_number(from.sequence);
  to.answer(from.answer);
  to.t0_ns(from.t0_ns);
  to.t1_ns(from.t1_ns);
  to.t2_ns(from.t2_ns);
}

void from_idl(const idl::ClockSample& from, session::ClockSample& to) {
  to.origin = origin_from_idl(from);
  to.peer = from.peer();
  to.sequence = from.sequence_number();
  to.answer = from.answer();
  to.t0_ns = from.t0_ns();
  to.t1_ns = from.t1_ns();
  to.t2_ns = from.t2_ns();
}

}  // namespace tactus::wire
