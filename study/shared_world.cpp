#include "study/shared_world.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "haptics/body_touch.hpp"
#include "haptics/passivity.hpp"
#include "haptics/shared_object.hpp"
#include "haptics/simulated_device.hpp"
#include "study/constants.hpp"
#include "study/virtual_link.hpp"

namespace tactus::study {
namespace {

using namespace haptics;
constexpr double kPi = 3.14159265358979323846;
constexpr std::size_t kPacketBytes = 400;    // with headers
constexpr double kMotionEnd = 6;             // s, from the begin of the run
const Vec3d kHalfExtents{0.06, 0.06, 0.04};  // of the box, m

/// A sample on a link: the state of a copy, or the state of a hand's device.
struct Packet {
  CopySample copy;
  DeviceState device;
  bool grab = false;
};

/// A spring that pulls a copy to the mean of the last received positions of the other copies. If `modulated`, an energy
/// tank limits the changes of the set position. Source: Lee, Huang 2010.
class SpringCoupling {
 public:
  SpringCoupling(double stiffness, double damping, const BodySettings& share, bool modulated) : modulated_{modulated} {
    Vec6d per_mass;
    per_mass << Vec3d::Ones(), 3 * share.inertia / share.mass;
    stiffness_ = stiffness * per_mass;
    damping_ = damping * per_mass;
  }
  void on_sample(std::size_t peer, const CopySample& sample) {
    if (sample.time_ns > received_[peer].time_ns) received_[peer] = sample;
  }
  [[nodiscard]] ImplicitForce begin(const BodyState& state) {
    state_ = state;
    Vec6d desired = Vec6d::Zero();
    int count = 0;
    for (const CopySample& peer : received_) {
      if (peer.time_ns < 0) continue;
      desired.head<3>() += peer.body.position - state.position;
      desired.tail<3>() += log_map(state.orientation.conjugate() * peer.body.orientation);
      ++count;
    }
    if (count > 0) desired /= count;
    const double costs = 0.5 * stiffness_.dot(desired.cwiseAbs2() - stretch_.cwiseAbs2());
    if (modulated_ && costs > tank_) {
      // Bisects for the largest share of the step from the old to the desired set position that the tank's energy
      // allows.
      ++limited_cycles_;
      double low = 0, high = 1;
      for (int i = 0; i < 40; ++i) {
        const double share = (low + high) / 2;
        const Vec6d between = stretch_ + share * (desired - stretch_);
        (0.5 * stiffness_.dot(between.cwiseAbs2() - stretch_.cwiseAbs2()) <= tank_ ? low : high) = share;
      }
      desired = stretch_ + low * (desired - stretch_);
    }
    tank_ = std::min(0.05, tank_ - 0.5 * stiffness_.dot(desired.cwiseAbs2() - stretch_.cwiseAbs2()));
    stretch_ = desired;
    const Vec6d mass = kCycle * kCycle * stiffness_ + kCycle * damping_;
    const Vec6d impulse = kCycle * stiffness_.cwiseProduct(stretch_);
    const Eigen::Matrix3d axes = state.orientation.toRotationMatrix();
    ImplicitForce force;
    force.mass.topLeftCorner<3, 3>() = mass.head<3>().asDiagonal();
    force.mass.bottomRightCorner<3, 3>() = axes * mass.tail<3>().asDiagonal() * axes.transpose();
    force.impulse << impulse.head<3>(), axes * impulse.tail<3>();
    return force;
  }
  void finish(const BodyState& state) {
    Vec6d moved;
    moved << state.position - state_.position, log_map(state_.orientation.conjugate() * state.orientation);
    stretch_ -= moved;
    const double dragged = damping_.dot(moved.cwiseAbs2()) / kCycle;
    given_ += stiffness_.cwiseProduct(stretch_).dot(moved) - dragged;
    tank_ += 0.5 * dragged;
  }
  [[nodiscard]] double given() const { return given_; }
  [[nodiscard]] std::uint64_t limited_cycles() const { return limited_cycles_; }

 private:
  bool modulated_;
  Vec6d stiffness_, damping_;
  std::array<CopySample, kMaxCopies> received_ = [] {
    std::array<CopySample, kMaxCopies> none;
    for (CopySample& sample : none) sample.time_ns = -1;
    return none;
  }();
  BodyState state_;
  Vec6d stretch_ = Vec6d::Zero();  // set position minus position of the copy
  double tank_ = 1e-4, given_ = 0;
  std::uint64_t limited_cycles_ = 0;
};

BodySettings whole_of(const WorldSettings& settings) {
  BodySettings whole = box_body(settings.mass, kHalfExtents);
  whole.friction = 0.05;  // the table is smooth
  return whole;
}

/// All simulators of the object and the links between them.
class World {
 public:
  explicit World(const WorldSettings& settings, const BodySettings& whole, const BodyState& start)
      : settings_{settings}, shape_{kHalfExtents} {
    const std::size_t nodes = settings.users + (server() ? 1 : 0);
    for (std::size_t i = 0; i < nodes; ++i) {
      objects_.push_back(std::make_unique<SharedObject>(whole, start));
      links_.emplace_back();
      for (std::size_t j = 0; j < nodes; ++j) links_[i].emplace_back(settings.link, settings.seed * 64 + i * 8 + j);
    }
    touches_.resize(settings.users);
    remote_.resize(settings.users);
    ports_.resize(settings.users);
    passed_on_.resize(settings.users);
    remote_touches_.resize(settings.users);
    springs_.resize(nodes);
    pushes_.resize(nodes, Vec3d::Zero());
    for (BodyTouch& touch : touches_) touch.set_grip({0.8, 0.8});
    for (BodyTouch& touch : remote_touches_) touch.set_grip({0.8, 0.8});
    CouplingSettings coupling;
    coupling.copies = settings.users;
    coupling.stiffness = settings.coupling;
    coupling.delay = settings.playout;
    for (std::size_t i = 0; i < settings.users; ++i) {
      if (server()) {
        objects_[i]->follow();
      } else if (settings.method == Method::kChannel) {
        couplings_.push_back(std::make_unique<CopyCoupling>(coupling, i, whole));
        objects_[i]->couple(*couplings_.back());
      } else {
        BodySettings share = whole;
        share.mass /= static_cast<double>(settings.users);
        share.inertia /= static_cast<double>(settings.users);
        objects_[i] = std::make_unique<SharedObject>(share, start);
        springs_to_copies_.emplace_back(settings.coupling, settings.coupling_damping, share,
                                        settings.method == Method::kSpring);
      }
    }
  }

  [[nodiscard]] bool server() const { return settings_.method == Method::kServer; }
  /// The object that user `i` touches.
  [[nodiscard]] const SharedObject& object(std::size_t i) const { return *objects_[i]; }
  [[nodiscard]] const BodyTouch& touch(std::size_t i) const { return touches_[i]; }

  [[nodiscard]] const PassivityController::Ledger& port(std::size_t i) const { return ports_[i].ledger(); }

  /// Steps the touch of a user's device in this cycle and returns the force on the hand.
  Vec3d hold(std::size_t user, const DeviceState& device, bool grab) {
    BodyTouch& touch = touches_[user];
    touch.step(device, grab, objects_[user]->state(), shape_, {settings_.grip, settings_.grip_damping}, kCycle);
    outgoing_.device = device;
    outgoing_.grab = grab;
    if (server()) {
      links_[user][settings_.users].send(now_ns_, outgoing_, kPacketBytes);
    }
    Vec3d force = Vec3d::Zero();
    if (touch.is_touching())
      force =
          settings_.grip * (touch.touch().anchor - device.position) - settings_.grip_damping * touch.device().velocity;
    const double stored =
        touch.is_touching() ? 0.5 * settings_.grip * (touch.touch().anchor - device.position).squaredNorm() : 0.0;
    force = ports_[user].step(force, device.position, passed_on_[user], kCycle, settings_.port_control, stored);
    passed_on_[user] = 0;
    if (!server() && touch.is_touching()) springs_[user].push_back(touch.spring());
    return force;
  }
  void push(std::size_t node, const Vec3d& force) { pushes_[node] = force; }

  /// Advances every simulator by one cycle.
  void step(const Surroundings& surroundings) {
    for (std::size_t i = 0; i < objects_.size(); ++i) receive(i);
    if (server()) {
      auto& springs = springs_[settings_.users];
      for (std::size_t user = 0; user < settings_.users; ++user) {
        if (remote_[user].copy.time_ns < 0) continue;
        BodyTouch& touch = remote_touches_[user];
        touch.step(remote_[user].device, remote_[user].grab, objects_.back()->state(), shape_, {settings_.grip, 0},
                   kCycle);
        if (touch.is_touching()) springs.push_back(touch.spring());
      }
    }
    for (std::size_t i = 0; i < objects_.size(); ++i) simulate(i, surroundings);
    now_ns_ += kCycleNs;
    for (Vec3d& push : pushes_) push.setZero();
  }

  [[nodiscard]] std::int64_t now_ns() const { return now_ns_; }
  [[nodiscard]] double given() const {
    double sum = server_given_;
    for (const auto& object : objects_) sum += object->coupling() != nullptr ? object->coupling()->ledger().given : 0;
    for (const SpringCoupling& pull : springs_to_copies_) sum += pull.given();
    return sum;
  }
  [[nodiscard]] std::uint64_t limited_cycles() const {
    std::uint64_t sum = 0;
    for (const auto& object : objects_)
      sum += object->coupling() != nullptr ? object->coupling()->ledger().limited_cycles : 0;
    for (const SpringCoupling& pull : springs_to_copies_) sum += pull.limited_cycles();
    return sum;
  }
  [[nodiscard]] double tank_lowest() const {
    double lowest = 0;
    for (const auto& object : objects_) {
      if (object->coupling() != nullptr) lowest = std::min(lowest, object->coupling()->ledger().tank);
    }
    return lowest;
  }
  [[nodiscard]] double top_speed() const {
    double fastest = 0;
    for (const auto& object : objects_) fastest = std::max(fastest, object->body().top_speed());
    return fastest;
  }
  void add_given(double work) { server_given_ += work; }

 private:
  void receive(std::size_t i) {
    for (std::size_t from = 0; from < objects_.size(); ++from) {
      if (from == i) continue;
      while (const auto packet = links_[from][i].take(now_ns_)) {
        if (server()) {
          if (i == settings_.users) {
            remote_[from] = *packet;
          } else if (from == settings_.users) {
            objects_[i]->set_state(packet->copy.body);
          }
        } else if (settings_.method == Method::kChannel) {
          objects_[i]->coupling()->on_sample(from, packet->copy);
        } else {
          springs_to_copies_[i].on_sample(from, packet->copy);
        }
      }
    }
  }

  void simulate(std::size_t i, const Surroundings& surroundings) {
    ImplicitForce external;
    if (!springs_to_copies_.empty()) external = springs_to_copies_[i].begin(objects_[i]->state());
    external.impulse.head<3>() += kCycle * pushes_[i];
    const BodyState before = objects_[i]->state();
    auto& springs = springs_[i];
    objects_[i]->step(now_ns_, springs, surroundings, kCycle, &external);
    const BodyState& after = objects_[i]->state();
    if (!springs_to_copies_.empty()) springs_to_copies_[i].finish(after);
    if (server() && i == settings_.users) {
      for (const PointSpring& spring : springs) {
        const Vec3d velocity = after.velocity_at(after.to_world(before.to_body(spring.point)));
        server_given_ += spring.force(velocity, kCycle).dot(kCycle * velocity);
      }
    }
    if (!server()) {
      for (const PointSpring& spring : springs) {
        const Vec3d velocity = after.velocity + after.angular_velocity.cross(spring.point - before.position);
        passed_on_[i] += spring.force(velocity, kCycle).dot(kCycle * velocity);
      }
    }
    springs.clear();
    Packet packet;
    if (objects_[i]->coupling() != nullptr) {
      packet.copy = objects_[i]->coupling()->sample();
    } else {
      packet.copy.time_ns = now_ns_;
      packet.copy.body = after;
    }
    for (std::size_t to = 0; to < objects_.size(); ++to) {
      if (to == i || (server() && i != settings_.users)) continue;
      links_[i][to].send(now_ns_, packet, kPacketBytes);
    }
  }

  WorldSettings settings_;
  BoxSurface shape_;
  std::vector<std::unique_ptr<CopyCoupling>> couplings_;
  std::vector<std::unique_ptr<SharedObject>> objects_;
  std::vector<std::vector<VirtualLink<Packet>>> links_;  // from, to
  std::vector<BodyTouch> touches_, remote_touches_;
  std::vector<Packet> remote_;
  std::vector<std::vector<PointSpring>> springs_;
  std::vector<SpringCoupling> springs_to_copies_;
  std::vector<PassivityController> ports_;
  std::vector<double> passed_on_;  // energy given to the body since the last step of the port, J
  Packet outgoing_;
  std::vector<Vec3d> pushes_;
  std::int64_t now_ns_ = kCycleNs;
  double server_given_ = 0;
};

/// Returns the displacement of the object's centre on the users' path: a closed curve in the horizontal plane, from 1 s
/// to kMotionEnd.
Vec3d path_at(double time) {
  const double t = std::clamp(time - 1, 0.0, kMotionEnd - 1);
  const double phase = t / (kMotionEnd - 1);
  const double smooth = phase * phase * (3 - 2 * phase);
  return {0.15 * std::sin(2 * kPi * smooth), 0.05 * (1 - std::cos(2 * kPi * smooth)), 0};
}

double max_corner_distance(const BodyState& a, const BodyState& b, const BodySettings& body) {
  double furthest = 0;
  for (std::uint32_t i = 0; i < body.point_count; ++i)
    furthest = std::max(furthest, (a.to_world(body.points[i]) - b.to_world(body.points[i])).norm());
  return furthest;
}

}  // namespace

CarryResult carry(const WorldSettings& settings, double seconds) {
  const BodySettings whole = whole_of(settings);
  BodyState start;
  start.position.z() = kHalfExtents.z();
  World world{settings, whole, start};
  std::mt19937_64 random{settings.seed};
  std::normal_distribution<double> normal;

  struct User {
    std::unique_ptr<SimulatedDevice> device;
    Vec3d grip_point, error, force = Vec3d::Zero(), position;
    double lag;
  };
  std::vector<User> users;
  for (std::size_t i = 0; i < settings.users; ++i) {
    const double angle = 2 * kPi * static_cast<double>(i) / static_cast<double>(settings.users);
    User user;
    const Vec3d direction{std::cos(angle), std::sin(angle), 0};
    // The tip is 1 mm inside the side face, so that it is in contact when the hand grabs.
    const double face = kHalfExtents.x() / direction.head<2>().cwiseAbs().maxCoeff();
    user.grip_point = start.position + direction * (face + 0.003 - 0.001);
    user.error = settings.disagreement * Vec3d{normal(random), normal(random), normal(random)};
    user.lag = 0.05 + 0.03 * std::abs(normal(random));
    HandSettings hand;
    hand.start = user.grip_point + direction * 0.01;
    hand.seed = static_cast<std::uint32_t>(settings.seed * 16 + i);
    hand.tremor = 0;
    user.device = std::make_unique<SimulatedDevice>(hand);
    user.position = hand.start;
    users.push_back(std::move(user));
  }

  CarryResult result;
  const Surroundings surroundings;
  const int cycles = static_cast<int>(seconds / kCycle);
  const double rest = kMotionEnd + 0.2;  // the hands lag behind by at most 0.2 s
  constexpr double kRestSpeed = 1e-3;    // m/s
  constexpr double kRestTime = 1;        // s at the end of the run, without a faster motion if the run comes to rest
  for (int cycle = 0; cycle < cycles; ++cycle) {
    const double time = cycle * kCycle;
    for (std::size_t i = 0; i < settings.users; ++i) {
      User& user = users[i];
      // The path has two waypoints: the hand's targets one cycle ago, at `time`, and now.
      HandPath path;
      path.count = 2;
      for (int k = 0; k < 2; ++k) {
        const double at = time - user.lag + k * kCycle;
        const Vec3d target = user.grip_point + path_at(at) + std::clamp(at - 1, 0.0, 1.0) * user.error;
        path.waypoints[static_cast<std::size_t>(k)] = {world.now_ns() - kCycleNs + k * kCycleNs,
                                                       {target.x(), target.y(), target.z()}};
      }
      user.device->paths().post(path);
      const DeviceState device = user.device->read(world.now_ns());
      if (settings.method == Method::kServer) world.add_given(user.force.dot(device.position - user.position));
      user.position = device.position;
      user.force = world.hold(i, device, true);
      user.device->write(user.force);
      result.peak_force = std::max(result.peak_force, user.force.norm());
    }
    world.step(surroundings);

    result.injected = std::max(result.injected, world.given());
    result.tank_lowest = std::min(result.tank_lowest, world.tank_lowest());
    double apart = 0, fastest = 0;
    for (std::size_t i = 0; i < settings.users; ++i) {
      const BodyState& state = world.object(i).state();
      if (!state.position.allFinite() || state.position.norm() > 1e3) result.finite = false;
      fastest = std::max(fastest, world.object(i).body().top_speed());
      for (std::size_t j = 0; j < i; ++j)
        apart = std::max(apart, max_corner_distance(state, world.object(j).state(), whole));
    }
    if (!result.finite) break;
    result.max_copy_distance = std::max(result.max_copy_distance, apart);
    if (time <= rest + 1) result.end_copy_distance = apart;
    if (time > rest && fastest > kRestSpeed) {
      result.settling_time = time - rest;
      if (time >= seconds - kRestTime) result.settles = false;
    }
  }
  result.settles = result.settles && result.finite;
  result.limited_share =
      static_cast<double>(world.limited_cycles()) / static_cast<double>(cycles) / static_cast<double>(settings.users);
  for (std::size_t i = 0; i < settings.users; ++i) {
    const auto& port = world.port(i);
    result.port_lowest = std::min(result.port_lowest, port.lowest);
    result.withholding += static_cast<double>(port.withholding) / cycles / static_cast<double>(settings.users);
  }
  return result;
}

bool comes_to_rest(const WorldSettings& settings) {
  BodySettings whole = whole_of(settings);
  whole.gravity.setZero();
  World world{settings, whole, {}};
  Surroundings surroundings;
  surroundings.ground = false;
  const int cycles = 12'000;
  double early = 0, late = 0;
  for (int cycle = 0; cycle < cycles; ++cycle) {
    if (cycle >= 500 && cycle < 700) {
      world.push(0, {1, 0, 0});
      world.push(1, {-1, 0, 0});
    }
    world.step(surroundings);
    const double speed = world.top_speed();
    if (!(speed < 1e3)) return false;
    if (cycle >= 2000 && cycle < 4000) early = std::max(early, speed);
    if (cycle >= cycles - 2000) late = std::max(late, speed);
  }
  return late < 1e-3 || late < 0.3 * early;
}

MassResult apparent_mass(const WorldSettings& settings, double frequency) {
  BodySettings whole = whole_of(settings);
  whole.gravity.setZero();
  World world{settings, whole, {}};
  Surroundings surroundings;
  surroundings.ground = false;
  const double angular_frequency = 2 * kPi * frequency;
  const double amplitude = 0.03 * settings.mass * angular_frequency * angular_frequency;  // N, for about 3 cm
  const int warm_up = static_cast<int>(std::ceil(12 * frequency) / frequency / kCycle);
  const int measured = static_cast<int>(4 / frequency / kCycle);
  double in_phase = 0, out_of_phase = 0, before = 0;
  // The force starts as a cosine, so that the mean velocity is zero.
  for (int cycle = 0; cycle < warm_up + measured; ++cycle) {
    const double phase = angular_frequency * cycle * kCycle;
    const bool server = settings.method == Method::kServer;
    // A user's force reaches the server one link delay later.
    const double there = server ? phase - angular_frequency * settings.link.delay_ms * 1e-3 : phase;
    world.push(server ? settings.users : 0, {amplitude * std::cos(there), 0, 0});
    world.step(surroundings);
    const double x = world.object(0).state().position.x();
    const double speed = (x - before) / kCycle;
    before = x;
    if (cycle < warm_up) continue;
    in_phase += speed * std::sin(phase) * 2 / measured;
    out_of_phase += speed * std::cos(phase) * 2 / measured;
  }
  // As phasors, the force is A and the velocity is out - j in. The impedance is A / (out - j in), which is
  // A (out + j in) / (out^2 + in^2).
  const double size = in_phase * in_phase + out_of_phase * out_of_phase;
  return {amplitude * in_phase / size / angular_frequency, amplitude * out_of_phase / size};
}

}  // namespace tactus::study
