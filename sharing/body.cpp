#include "sharing/body.hpp"

#include <algorithm>

namespace tactus::sharing {

namespace {

using Plain3 = std::array<double, 3>;
Plain3 plain(const Vec3d& v) noexcept { return {v.x(), v.y(), v.z()}; }
Vec3d vec(const Plain3& v) noexcept { return {v[0], v[1], v[2]}; }
std::array<double, 4> plain(const Eigen::Quaterniond& q) noexcept { return {q.x(), q.y(), q.z(), q.w()}; }
Eigen::Quaterniond quaternion(const std::array<double, 4>& q) noexcept {
  return Eigen::Quaterniond{q[3], q[0], q[1], q[2]}.normalized();
}

/// Half the edges of the bounds, m.
Vec3d half_of(const spm::ModelSummary& summary, double scale) noexcept {
  Vec3d half;
  for (int axis = 0; axis < 3; ++axis)
    half[axis] = 0.5 * scale * (double{summary.bounds_max[axis]} - double{summary.bounds_min[axis]});
  return half;
}

}  // namespace

std::array<double, 3> inertia_of_bounds(const spm::ModelSummary& summary, double scale, double mass) noexcept {
  return plain(haptics::box_body(mass, half_of(summary, scale)).inertia);
}

SharedBody body_of_bounds(const spm::ModelSummary& summary, double scale) noexcept {
  SharedBody body;
  body.settings = haptics::box_body(body.settings.mass, half_of(summary, scale));
  for (int axis = 0; axis < 3; ++axis)
    body.centre[axis] = 0.5 * scale * (double{summary.bounds_max[axis]} + double{summary.bounds_min[axis]});
  return body;
}

SharedBody body_of(const session::CatalogueEntry& entry) noexcept {
  SharedBody body = body_of_bounds(entry.summary, entry.scale);
  body.settings.mass = entry.body.mass;
  body.settings.inertia = vec(entry.body.inertia);
  body.settings.friction = entry.body.friction;
  body.ground = entry.body.ground;
  body.start = state_at(entry.pose, body.centre);
  return body;
}

BodyState state_at(const session::Pose& pose, const Vec3d& centre) noexcept {
  BodyState state;
  state.orientation = quaternion(pose.orientation);
  state.position = vec(pose.position) + state.orientation * centre;
  return state;
}

session::Pose pose_of(const BodyState& state, const Vec3d& centre) noexcept {
  return {plain(Vec3d(state.position - state.orientation * centre)), plain(state.orientation)};
}

BodyState state_of(const session::ObjectPose& pose, const Vec3d& centre) noexcept {
  BodyState state = state_at(pose.pose, centre);
  state.angular_velocity = vec(pose.angular_velocity);
  state.velocity = vec(pose.velocity) + state.angular_velocity.cross(state.orientation * centre);
  return state;
}

void put_state(const BodyState& state, const Vec3d& centre, session::ObjectPose& pose) noexcept {
  pose.pose = pose_of(state, centre);
  pose.velocity = plain(Vec3d(state.velocity - state.angular_velocity.cross(state.orientation * centre)));
  pose.angular_velocity = plain(state.angular_velocity);
}

haptics::CopySample sample_of(const session::ObjectCopy& copy) noexcept {
  haptics::CopySample sample;
  sample.time_ns = copy.session_time_ns;
  sample.body.position = vec(copy.body.position);
  sample.body.orientation = quaternion(copy.body.orientation);
  sample.body.velocity = vec(copy.velocity);
  sample.body.angular_velocity = vec(copy.angular_velocity);
  sample.user_force = vec(copy.user_force);
  const std::size_t count = std::min(copy.channels.size(), haptics::kMaxCopies);
  for (std::size_t i = 0; i < count; ++i) {
    sample.waves[i] = Eigen::Map<const haptics::Vec6d>(copy.channels[i].wave.data());
    sample.energy[i] = copy.channels[i].energy;
  }
  return sample;
}

void put_sample(const haptics::CopySample& sample, std::size_t count, session::ObjectCopy& copy) {
  copy.session_time_ns = sample.time_ns;
  copy.body = {plain(sample.body.position), plain(sample.body.orientation)};
  copy.velocity = plain(sample.body.velocity);
  copy.angular_velocity = plain(sample.body.angular_velocity);
  copy.user_force = plain(sample.user_force);
  copy.channels.resize(std::min(count, haptics::kMaxCopies));
  for (std::size_t i = 0; i < copy.channels.size(); ++i) {
    Eigen::Map<haptics::Vec6d>(copy.channels[i].wave.data()) = sample.waves[i];
    copy.channels[i].energy = sample.energy[i];
  }
}

BodyState extrapolated(const BodyState& state, double seconds) noexcept {
  BodyState later = state;
  later.position += seconds * state.velocity;
  later.orientation = (haptics::exp_map(seconds * state.angular_velocity) * state.orientation).normalized();
  return later;
}

}  // namespace tactus::sharing
