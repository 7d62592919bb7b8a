#include "haptics/coupling.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::haptics {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kLongestGap = 100;  // max cycles between the interpolated time and a sample used for it
// Time after the start for which a peer whose samples have not arrived yet is assumed to keep the speed of the start.
constexpr std::int64_t kAssumedMotionNs = 500'000'000;
constexpr double kSurplusShare = 0.05;  // share of the tank's energy above the reserve that goes to the peers per cycle
// Min tank level for the convergence of the copies, as a multiple of the energy of this cycle's waves.
constexpr double kHomingCosts = 3;
constexpr double kSmoothing = 0.02;  // s, time constant for the users' forces

}  // namespace

CopyCoupling::CopyCoupling(const CouplingSettings& settings, std::size_t index, const BodySettings& whole) noexcept
    : settings_{settings}, index_{index}, share_{whole} {
  const double copies = static_cast<double>(settings_.copies);
  // A channel with a long delay resonates within the bandwidth of a hand, so its waves are low-pass filtered. A channel
  // with a short delay resonates above that bandwidth, where the hands damp the resonance, so its filter is weaker.
  filter_ = settings_.delay * std::min(0.8, settings_.delay / 0.3);
  channel_delay_ = settings_.delay + filter_ + 1e-3;
  const double phi = settings_.channel_share;

  // Springs and channels are compliant, so an object that a hand moves at 1 Hz feels heavier than its mass, by the
  // share `excess`. About half of this share is subtracted from the mass.
  const double others = whole.mass * (copies - 1) / copies;
  const double excess = std::pow(2 * kPi, 2) * others *
                        (1 / settings_.stiffness + copies * channel_delay_ * channel_delay_ / (2 * phi * whole.mass));
  const double scale = 1 / (1 + 0.45 * std::min(0.3, excess));

  share_.mass = whole.mass * scale * (1 - phi) / copies;
  share_.inertia = whole.inertia * (scale * (1 - phi) / copies);
  share_.gravity = whole.gravity * (whole.mass / copies / share_.mass);
  share_.damping = whole.damping / copies;
  share_.angular_damping = whole.angular_damping / copies;

  whole_ << Vec3d::Constant(whole.mass), whole.inertia;
  // Each axis has a factor. `per_mass` converts a mass to mass and inertia. `per_spring` converts the stiffness of
  // springs at the corners of a box with this inertia to translational and rotational stiffness.
  Vec6d per_mass;
  per_mass << Vec3d::Ones(), whole.inertia / whole.mass;
  Vec6d per_spring;
  per_spring << Vec3d::Ones(), 3 * whole.inertia / whole.mass;
  stiffness_ = per_spring * settings_.stiffness;
  Vec6d min;
  min << Vec3d::Constant(settings_.min_stiffness), Vec3d::Constant(settings_.min_rotational_stiffness);
  const double pairs = copies * (copies - 1) / 2;
  impedance_ = (per_mass * (phi * whole.mass * scale / (pairs * channel_delay_)))
                   .cwiseMax(per_spring.cwiseProduct(min) * (channel_delay_ / pairs));
  drag_ = per_mass * (settings_.drag / copies);
  ledger_.tank = ledger_.received = settings_.initial_energy / copies;
  own_.time_ns = -1;
  user_force_.fill(Vec3d::Zero());
}

void CopyCoupling::store(History& history, const CopySample& sample, std::size_t to) noexcept {
  Received& received = history[static_cast<std::size_t>(sample.time_ns / kCycleNs) % kHistory];
  if (sample.time_ns > received.time_ns)
    received = {sample.time_ns, sample.waves[to], sample.body.position, sample.body.orientation};
}

bool CopyCoupling::interpolate(const History& history, std::int64_t time_ns, Received& found) noexcept {
  const std::int64_t cycle = time_ns / kCycleNs;
  if (cycle < 0) return false;
  const auto entry = [&](std::int64_t c) -> const Received& { return history[static_cast<std::size_t>(c) % kHistory]; };
  const Received* before = nullptr;
  for (int gap = 0; gap <= std::min<std::int64_t>(kLongestGap, cycle) && before == nullptr; ++gap) {
    const Received& received = entry(cycle - gap);
    if (received.time_ns / kCycleNs == cycle - gap && received.time_ns >= 0 && received.time_ns <= time_ns)
      before = &received;
  }
  if (before == nullptr) return false;
  found = *before;
  for (int gap = 0; gap <= kLongestGap; ++gap) {
    const Received& after = entry(cycle + gap);
    if (after.time_ns / kCycleNs != cycle + gap || after.time_ns <= time_ns) continue;
    const double share =
        static_cast<double>(time_ns - before->time_ns) / static_cast<double>(after.time_ns - before->time_ns);
    found.wave += share * (after.wave - before->wave);
    found.position += share * (after.position - before->position);
    found.orientation = before->orientation.slerp(share, after.orientation);
    break;
  }
  return true;
}

void CopyCoupling::on_sample(std::size_t peer, const CopySample& sample) noexcept {
  if (peer >= settings_.copies || peer == index_ || sample.time_ns < 0) return;
  store(received_[peer], sample, index_);
  if (sample.time_ns <= user_force_ns_[peer]) return;
  user_force_ns_[peer] = sample.time_ns;
  user_force_[peer] = sample.user_force;
  // A peer's energy counter never decreases. If it is lower than in the previous sample, the previous sample was wrong,
  // and the count continues from the new value.
  const double arrived = std::min(sample.energy[index_] - energy_received_[peer], settings_.tank);
  energy_received_[peer] = sample.energy[index_];
  if (!(arrived > 0)) return;
  ledger_.tank += arrived;
  ledger_.received += arrived;
}

void CopyCoupling::start(std::int64_t now_ns, const BodyState& body) noexcept {
  started_ = true;
  start_ns_ = now_ns;
  start_speed_ << body.velocity, body.orientation.conjugate() * body.angular_velocity;
  for (Channel& channel : channels_) channel.filtered = -filter_ * start_speed_;  // lag of the filter at this speed
  for (Channel& channel : channels_) channel.arrived = channel.filtered;
  Vec6d share;
  share << Vec3d::Constant(share_.mass), share_.inertia;
  const Vec6d cut_off = whole_ / static_cast<double>(settings_.copies) - share;
  const double lacking = 0.5 * cut_off.dot(start_speed_.cwiseAbs2());
  ledger_.tank += lacking;
  ledger_.received += lacking;
}

/// Returns the impedance b of the channel to a peer. If the users of both copies press in opposite directions, b is
/// higher along their forces: at rest the channel carries 1 / N of the difference of the two forces (N copies), and
/// this force stretches the channel by D / b times the force (D: channel delay).
Mat6d CopyCoupling::impedance_to(std::size_t peer) const noexcept {
  Mat6d impedance = impedance_.asDiagonal();
  const Vec3d between = user_force_[index_] - user_force_[peer];
  const double size = between.norm();
  if (size < settings_.ignored_force) return impedance;
  const Vec3d along = between / size;
  const double opposed = std::min(user_force_[index_].dot(along), -user_force_[peer].dot(along));
  const double carried = 2 * std::max(0.0, opposed - settings_.ignored_force) / static_cast<double>(settings_.copies);
  const double target = std::min(carried * channel_delay_ / settings_.stretch, settings_.max_mass / channel_delay_);
  if (const double more = target - impedance_[0]; more > 0)
    impedance.topLeftCorner<3, 3>() += more * along * along.transpose();
  return impedance;
}

void CopyCoupling::begin(std::int64_t now_ns, double dt, RigidBody& body) noexcept {
  if (!started_) start(now_ns, body.state());
  now_ns_ = now_ns;
  dt_ = dt;
  axes_ = body.state().orientation;
  const double allowed = settings_.allowance / static_cast<double>(settings_.copies) * dt;
  ledger_.received += allowed;
  ledger_.tank = std::min(settings_.tank, ledger_.tank + allowed);
  receive_waves(now_ns, dt);
  choose_step(dt);
  add_spring(dt, body);
}

/// Interpolates the samples of all copies at the time that is `settings_.delay` ago, advances the convergence by one
/// step, and filters the waves.
void CopyCoupling::receive_waves(std::int64_t now_ns, double dt) noexcept {
  const double copies = static_cast<double>(settings_.copies);
  const std::int64_t then_ns = now_ns - std::llround(settings_.delay * 1e9);
  Received own;
  bool all_received = interpolate(received_[index_], then_ns, own);
  Vec6d apart = Vec6d::Zero();
  double furthest = 0;
  for (std::size_t i = 0; i < settings_.copies; ++i) {
    if (i == index_) continue;
    Channel& channel = channels_[i];
    Received peer;
    if (interpolate(received_[i], then_ns, peer)) {
      if (!channel.received) channel.offset = channel.raw - peer.wave;
      channel.received = true;
      channel.raw = peer.wave + channel.offset;
      if (all_received) {
        furthest = std::max(furthest, (peer.position - own.position).norm());
        apart.head<3>() += (peer.position - own.position) / copies;
        apart.tail<3>() += log_map(own.orientation.conjugate() * peer.orientation) / copies;
      }
    } else {
      all_received = false;
      if (!channel.received && now_ns - start_ns_ <= kAssumedMotionNs) channel.raw += dt * start_speed_;
    }
  }
  if (all_received) ledger_.copy_distance = furthest;
  if (all_received && may_home_) homing_ += apart * (settings_.convergence_share * dt / channel_delay_);
  for (std::size_t i = 0; i < settings_.copies; ++i) {
    if (i == index_) continue;
    channels_[i].filtered += (channels_[i].raw + homing_ - channels_[i].filtered) * (dt / (filter_ + dt));
  }
}

/// Steps each channel towards its filtered wave, as far as the maximum speed and the energy in the tank allow.
void CopyCoupling::choose_step(double dt) noexcept {
  const double arm = std::sqrt(share_.inertia.maxCoeff() / share_.mass);
  double cost = 0;  // J
  Mat6d impedances = Mat6d::Zero();
  ledger_.lag = 0;
  for (std::size_t i = 0; i < settings_.copies; ++i) {
    if (i == index_) continue;
    Channel& channel = channels_[i];
    channel.step = channel.filtered - channel.arrived;
    ledger_.lag = std::max(ledger_.lag, channel.step.head<3>().norm());
    const double speed = std::max(channel.step.head<3>().norm(), arm * channel.step.tail<3>().norm()) / dt;
    if (speed > settings_.max_speed) channel.step *= settings_.max_speed / speed;
    channel.impedance = impedance_to(i);
    impedances += channel.impedance;
    cost += channel.step.dot(channel.impedance * channel.step) / (4 * dt);
  }
  double share = 1;
  may_home_ = kHomingCosts * cost <= ledger_.tank;
  if (cost > ledger_.tank) {
    share = std::sqrt(std::max(0.0, ledger_.tank) / cost);
    ++ledger_.limited_cycles;
  }
  ledger_.tank -= share * share * cost;
  step_.setZero();
  for (std::size_t i = 0; i < settings_.copies; ++i) {
    if (i == index_) continue;
    channels_[i].step *= share;
    channels_[i].arrived += channels_[i].step;
    step_ += channels_[i].impedance * channels_[i].step;
  }
  admittance_ = impedances.inverse();
  step_ = admittance_ * step_;
}

void CopyCoupling::add_spring(double dt, RigidBody& body) noexcept {
  // Spring and channels are in series, so the spring force at the end of the step is
  // F = K (e + step - F dt / b - u - dt v). K is the stiffness, e the set position before the step, and u the integral
  // of the copy's velocity before the step. `step` is the step of the set position that the waves demand, v the
  // velocity after the step, and b the sum of the channels' impedances.
  effective_stiffness_ = (Mat6d(stiffness_.cwiseInverse().asDiagonal()) + dt * admittance_).inverse();
  const Mat6d mass = dt * dt * effective_stiffness_ + dt * Mat6d(drag_.asDiagonal());
  const Vec6d impulse = dt * effective_stiffness_ * (set_position_ + step_ - moved_);
  const Eigen::Matrix3d axes = axes_.toRotationMatrix();
  Mat6d mass_world = Mat6d::Zero();
  mass_world.topLeftCorner<3, 3>() = mass.topLeftCorner<3, 3>();
  mass_world.bottomRightCorner<3, 3>() = axes * mass.bottomRightCorner<3, 3>() * axes.transpose();
  Vec6d impulse_world;
  impulse_world << impulse.head<3>(), axes * impulse.tail<3>();
  body.add_implicit(mass_world, impulse_world);
}

void CopyCoupling::finish(const Vec6d& velocity, const RigidBody& body, const Vec3d& user_force) noexcept {
  if (started_) {
    Vec6d own;
    own << velocity.head<3>(), axes_.conjugate() * velocity.tail<3>();
    const Vec6d moved = dt_ * own;
    const Vec6d force = effective_stiffness_ * (set_position_ + step_ - moved_ - moved);
    const double channels = static_cast<double>(settings_.copies - 1);
    const Vec6d end_step = step_ - dt_ * admittance_ * force;
    const double dragged = drag_.dot(own.cwiseProduct(moved));
    ledger_.given += force.dot(moved) - dragged;
    ledger_.tank += settings_.credited_drag_share * dragged;
    set_position_ += end_step;
    moved_ += moved;
    // The implicit spring dissipates energy: the energy from the channels, minus the energy given to the copy, minus
    // the increase of the stored energy. This loss is credited to the tank. Without this credit a low tank would make
    // the set position oscillate, which would lower the tank further.
    const double stored = 0.5 * stiffness_.dot((set_position_ - moved_).cwiseAbs2());
    ledger_.tank += std::max(0.0, force.dot(end_step - moved) - (stored - ledger_.stored));
    ledger_.stored = stored;

    for (std::size_t i = 0; i < settings_.copies; ++i) {
      if (i == index_) continue;
      const Vec6d departing = end_step - channels_[i].step / 2;  // dt times the velocity of the departing wave
      own_.energy[i] += departing.dot(channels_[i].impedance * departing) / dt_;
      own_.waves[i] = 2 * set_position_ - channels_[i].arrived;
    }
    if (const double spare = kSurplusShare * (ledger_.tank - settings_.reserve); spare > 0) {
      ledger_.tank -= spare;
      for (std::size_t i = 0; i < settings_.copies; ++i) {
        if (i != index_) own_.energy[i] += spare / channels;
      }
    }
  }
  user_force_[index_] += (user_force - user_force_[index_]) * (dt_ / (kSmoothing + dt_));
  own_.user_force = user_force_[index_];
  own_.time_ns = now_ns_;
  own_.body = body.state();
  store(received_[index_], own_, index_);
}

}  // namespace tactus::haptics
