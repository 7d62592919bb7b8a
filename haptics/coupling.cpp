#include "haptics/coupling.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::haptics {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kLongestGap = 100;                   // cycles without a sample over which waves are interpolated
constexpr std::int64_t kPatienceNs = 500'000'000;  // for which a peer that has said nothing is taken to move along
constexpr double kSharing = 0.05;                  // of what is above the reserve, a cycle
constexpr double kSpare = 3;                       // times what a cycle's waves cost, with which copies are homed
constexpr double kSmoothing = 0.02;                // s, of what users do

}  // namespace

CopyCoupling::CopyCoupling(const CouplingSettings& settings, std::size_t place, const BodySettings& whole) noexcept
    : settings_{settings}, place_{place}, share_{whole} {
  const double copies = static_cast<double>(settings_.copies);
  // A long line rings within the band of a hand, so its waves are damped; a short one rings above it and the hands do.
  filter_ = settings_.delay * std::min(0.8, settings_.delay / 0.3);
  line_delay_ = settings_.delay + filter_ + 1e-3;
  const double phi = settings_.line_share;

  // Springs and line yield, so that what hangs on them seems heavier by the share `yields` at 1 Hz than at rest: half
  // of it is taken away beforehand.
  const double others = whole.mass * (copies - 1) / copies;
  const double yields = std::pow(2 * kPi, 2) * others *
                        (1 / settings_.stiffness + copies * line_delay_ * line_delay_ / (2 * phi * whole.mass));
  const double scale = 1 / (1 + 0.45 * std::min(0.3, yields));

  share_.mass = whole.mass * scale * (1 - phi) / copies;
  share_.inertia = whole.inertia * (scale * (1 - phi) / copies);
  share_.gravity = whole.gravity * (whole.mass / copies / share_.mass);
  share_.damping = whole.damping / copies;
  share_.angular_damping = whole.angular_damping / copies;

  whole_ << Vec3d::Constant(whole.mass), whole.inertia;
  // What a kilogram of translation is in rotation, and what a spring is when its parts are where a box has corners.
  Vec6d per_mass;
  per_mass << Vec3d::Ones(), whole.inertia / whole.mass;
  Vec6d per_spring;
  per_spring << Vec3d::Ones(), 3 * whole.inertia / whole.mass;
  stiffness_ = per_spring * settings_.stiffness;
  Vec6d min;
  min << Vec3d::Constant(settings_.min_stiffness), Vec3d::Constant(settings_.min_turning_stiffness);
  const double pairs = copies * (copies - 1) / 2;
  impedance_ = (per_mass * (phi * whole.mass * scale / (pairs * line_delay_)))
                   .cwiseMax(per_spring.cwiseProduct(min) * (line_delay_ / pairs));
  drag_ = per_mass * (settings_.drag / copies);
  ledger_.tank = ledger_.received = settings_.initial / copies;
  own_.time_ns = -1;
  pressed_.fill(Vec3d::Zero());
}

void CopyCoupling::keep(History& history, const CopySample& sample, std::size_t to) noexcept {
  Received& received = history[static_cast<std::size_t>(sample.time_ns / kCycleNs) % kHistory];
  if (sample.time_ns > received.time_ns)
    received = {sample.time_ns, sample.waves[to], sample.body.position, sample.body.orientation};
}

bool CopyCoupling::at(const History& history, std::int64_t time_ns, Received& found) noexcept {
  const std::int64_t cycle = time_ns / kCycleNs;
  if (cycle < 0) return false;
  const auto place = [&](std::int64_t c) -> const Received& { return history[static_cast<std::size_t>(c) % kHistory]; };
  const Received* before = nullptr;
  for (int gap = 0; gap <= std::min<std::int64_t>(kLongestGap, cycle) && before == nullptr; ++gap) {
    const Received& received = place(cycle - gap);
    if (received.time_ns / kCycleNs == cycle - gap && received.time_ns >= 0 && received.time_ns <= time_ns)
      before = &received;
  }
  if (before == nullptr) return false;
  found = *before;
  for (int gap = 0; gap <= kLongestGap; ++gap) {
    const Received& after = place(cycle + gap);
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
  if (peer >= settings_.copies || peer == place_ || sample.time_ns < 0) return;
  keep(received_[peer], sample, place_);
  if (sample.time_ns <= pressed_ns_[peer]) return;
  pressed_ns_[peer] = sample.time_ns;
  pressed_[peer] = sample.pressed;
  // The counter never falls, so one that does shows that the sample before was wrong: the count goes on from here.
  const double arrived = std::min(sample.energy[place_] - energy_received_[peer], settings_.tank);
  energy_received_[peer] = sample.energy[place_];
  if (!(arrived > 0)) return;
  ledger_.tank += arrived;
  ledger_.received += arrived;
}

void CopyCoupling::start(std::int64_t now_ns, const BodyState& body) noexcept {
  started_ = true;
  start_ns_ = now_ns;
  start_speed_ << body.velocity, body.orientation.conjugate() * body.angular_velocity;
  for (Line& line : lines_) line.filtered = -filter_ * start_speed_;  // as it would lag
  for (Line& line : lines_) line.arrived = line.filtered;
  Vec6d share;
  share << Vec3d::Constant(share_.mass), share_.inertia;
  const Vec6d cut_off = whole_ / static_cast<double>(settings_.copies) - share;
  const double lacking = 0.5 * cut_off.dot(start_speed_.cwiseAbs2());
  ledger_.tank += lacking;
  ledger_.received += lacking;
}

/// A line at rest carries 1 / N of the difference of what its two ends' users do, and is stretched by D / b of that.
Mat6d CopyCoupling::impedance_to(std::size_t peer) const noexcept {
  Mat6d impedance = impedance_.asDiagonal();
  const Vec3d between = pressed_[place_] - pressed_[peer];
  const double size = between.norm();
  if (size < settings_.slight) return impedance;
  const Vec3d along = between / size;
  const double opposed = std::min(pressed_[place_].dot(along), -pressed_[peer].dot(along));
  const double carried = 2 * std::max(0.0, opposed - settings_.slight) / static_cast<double>(settings_.copies);
  const double wanted = std::min(carried * line_delay_ / settings_.give, settings_.max_mass / line_delay_);
  if (const double more = wanted - impedance_[0]; more > 0)
    impedance.topLeftCorner<3, 3>() += more * along * along.transpose();
  return impedance;
}

void CopyCoupling::begin(std::int64_t now_ns, double dt, RigidBody& body) noexcept {
  if (!started_) start(now_ns, body.state());
  now_ns_ = now_ns;
  dt_ = dt;
  axes_ = body.state().orientation;
  step_.setZero();
  const double copies = static_cast<double>(settings_.copies);
  const double allowed = settings_.allowance / copies * dt;
  ledger_.received += allowed;
  ledger_.tank = std::min(settings_.tank, ledger_.tank + allowed);

  const std::int64_t then_ns = now_ns - std::llround(settings_.delay * 1e9);
  Received own;
  bool all = at(received_[place_], then_ns, own);
  Vec6d apart = Vec6d::Zero();
  double furthest = 0;
  for (std::size_t i = 0; i < settings_.copies; ++i) {
    if (i == place_) continue;
    Line& line = lines_[i];
    Received peer;
    if (at(received_[i], then_ns, peer)) {
      if (!line.received) line.offset = line.wanted - peer.wave;
      line.received = true;
      line.wanted = peer.wave + line.offset;
      if (all) {
        furthest = std::max(furthest, (peer.position - own.position).norm());
        apart.head<3>() += (peer.position - own.position) / copies;
        apart.tail<3>() += log_map(own.orientation.conjugate() * peer.orientation) / copies;
      }
    } else {
      all = false;
      if (!line.received && now_ns - start_ns_ <= kPatienceNs) line.wanted += dt * start_speed_;  // as one body goes on
    }
  }
  if (all) ledger_.apart = furthest;
  if (all && may_home_) homed_ += apart * (settings_.homing * dt / line_delay_);
  for (std::size_t i = 0; i < settings_.copies; ++i) {
    if (i == place_) continue;
    lines_[i].filtered += (lines_[i].wanted + homed_ - lines_[i].filtered) * (dt / (filter_ + dt));
  }

  // As far as speed and tank allow.
  const double arm = std::sqrt(share_.inertia.maxCoeff() / share_.mass);
  double cost = 0;
  Mat6d impedances = Mat6d::Zero();
  ledger_.behind = 0;
  for (std::size_t i = 0; i < settings_.copies; ++i) {
    if (i == place_) continue;
    Line& line = lines_[i];
    line.step = line.filtered - line.arrived;
    ledger_.behind = std::max(ledger_.behind, line.step.head<3>().norm());
    const double fastest = std::max(line.step.head<3>().norm(), arm * line.step.tail<3>().norm()) / dt;
    if (fastest > settings_.max_speed) line.step *= settings_.max_speed / fastest;
    line.impedance = impedance_to(i);
    impedances += line.impedance;
    cost += line.step.dot(line.impedance * line.step) / (4 * dt);
  }
  double share = 1;
  may_home_ = kSpare * cost <= ledger_.tank;
  if (cost > ledger_.tank) {
    share = std::sqrt(std::max(0.0, ledger_.tank) / cost);
    ++ledger_.held;
  }
  ledger_.tank -= share * share * cost;
  for (std::size_t i = 0; i < settings_.copies; ++i) {
    if (i == place_) continue;
    lines_[i].step *= share;
    lines_[i].arrived += lines_[i].step;
    step_ += lines_[i].impedance * lines_[i].step;
  }
  admittance_ = impedances.inverse();
  step_ = admittance_ * step_;

  // Spring and lines in series, at the end of the step: F = K (e + step - F dt / b - u - dt v).
  pull_ = (Mat6d(stiffness_.cwiseInverse().asDiagonal()) + dt * admittance_).inverse();
  const Mat6d mass = dt * dt * pull_ + dt * Mat6d(drag_.asDiagonal());
  const Vec6d impulse = dt * pull_ * (end_ + step_ - moved_);
  const Eigen::Matrix3d axes = axes_.toRotationMatrix();
  Mat6d mass_world = Mat6d::Zero();
  mass_world.topLeftCorner<3, 3>() = mass.topLeftCorner<3, 3>();
  mass_world.bottomRightCorner<3, 3>() = axes * mass.bottomRightCorner<3, 3>() * axes.transpose();
  Vec6d impulse_world;
  impulse_world << impulse.head<3>(), axes * impulse.tail<3>();
  body.add_implicit(mass_world, impulse_world);
}

void CopyCoupling::finish(const Vec6d& velocity, const RigidBody& body, const Vec3d& pressed) noexcept {
  if (started_) {
    Vec6d own;
    own << velocity.head<3>(), axes_.conjugate() * velocity.tail<3>();
    const Vec6d way = dt_ * own;
    const Vec6d force = pull_ * (end_ + step_ - moved_ - way);
    const double lines = static_cast<double>(settings_.copies - 1);
    const Vec6d end_step = step_ - dt_ * admittance_ * force;
    const double dragged = drag_.dot(own.cwiseProduct(way));
    ledger_.given += force.dot(way) - dragged;
    ledger_.tank += settings_.credited * dragged;
    end_ += end_step;
    moved_ += way;
    // What lines put into the spring and it neither gave nor kept. Not credited, it is lost where a tank that is short
    // makes the set position tremble, which leaves the tank shorter still.
    const double stored = 0.5 * stiffness_.dot((end_ - moved_).cwiseAbs2());
    ledger_.tank += std::max(0.0, force.dot(end_step - way) - (stored - ledger_.stored));
    ledger_.stored = stored;

    for (std::size_t i = 0; i < settings_.copies; ++i) {
      if (i == place_) continue;
      const Vec6d leaving = end_step - lines_[i].step / 2;  // times dt
      own_.energy[i] += leaving.dot(lines_[i].impedance * leaving) / dt_;
      own_.waves[i] = 2 * end_ - lines_[i].arrived;
    }
    if (const double spare = kSharing * (ledger_.tank - settings_.reserve); spare > 0) {
      ledger_.tank -= spare;
      for (std::size_t i = 0; i < settings_.copies; ++i) {
        if (i != place_) own_.energy[i] += spare / lines;
      }
    }
  }
  pressed_[place_] += (pressed - pressed_[place_]) * (dt_ / (kSmoothing + dt_));
  own_.pressed = pressed_[place_];
  own_.time_ns = now_ns_;
  own_.body = body.state();
  keep(received_[place_], own_, place_);
}

}  // namespace tactus::haptics
