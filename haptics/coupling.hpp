/// One object simulated by several controllers at once: what holds the copies together, passively.
///
/// Each of N copies carries its share of the mass; the rest is in lines between each two of them, a transmission line
/// per axis whose delay is the network's. At their common end the copy is pulled by a spring to a set position e:
///
///     copy --[ K ]-- e ==( line: impedance b, delay D )== e --[ K ]-- copy
///                    \\==( another )== e --[ K ]-- copy
///
/// With y_j the integral of twice the wave that arrives from copy j, F = sum_j b (y_j' - e'), and the wave that leaves,
/// as an integral, is z_j = 2 e - y_j, which is y at the other end D later. So
///   - free of contact the copies move as one body of the shares' mass plus b D for each line: b is chosen so that
///     this makes the whole; no force opposes a steady motion;
///   - a force that is held against a peer's stretches the line: two are apart by F (D / b + 2 / K). So a line is made
///     stiffer along the direction in which its two copies' users press against each other, and heavier, in that alone;
///   - losses need no repair, because waves come as integrals, and jitter ends at D: samples are interpolated there.
///
/// Energy: a wave of velocity a costs b a^2 dt where it arrives. It is paid from a tank that is filled by what the
/// peers say they put into the line (a counter in each sample: loss, order and repetition do not matter; what one
/// sample adds is at most a full tank), by half of what the drag takes, and by what the spring loses because it is
/// taken implicitly. A set position that the tank cannot pay moves less and catches up later. So, whatever the network
/// does, all copies together give at most what was put in: sum of `given` <= initial + allowance * time. Nothing in it
/// is assumed about delays or clocks; those make it good, not passive.
///
/// Translation in the world, rotation about the body's axes. Session time as argument. One thread at
/// a time. Realtime. Source: Niemeyer, Slotine 1991 (wave variables, integrals of waves against drift); Lee, Huang 2010
/// (passive set-position modulation: spring, tank, credited share of the damping).
#pragma once

#include <array>
#include <cstdint>

#include "haptics/rigid_body.hpp"

namespace tactus::haptics {

inline constexpr std::size_t kMaxCopies = 8;

/// What a copy tells its peers, every cycle.
struct CopySample {
  std::int64_t time_ns = 0;  ///< session time
  BodyState body;
  Vec3d pressed = Vec3d::Zero();  ///< N, world frame: what its own users do to it, smoothed
  /// By the peer's place: z, m and rad since the group began, and J put into the line to it, which never falls.
  std::array<Vec6d, kMaxCopies> waves = zero_waves();
  std::array<double, kMaxCopies> energy{};

  [[nodiscard]] static std::array<Vec6d, kMaxCopies> zero_waves() noexcept {
    std::array<Vec6d, kMaxCopies> waves;
    waves.fill(Vec6d::Zero());
    return waves;
  }
};

struct CouplingSettings {
  std::size_t copies = 2;    ///< of this group, this one included
  double delay = 0.03;       ///< s, D without the filter: the longest way of the group with its jitter; all agree on it
  double stiffness = 1000;   ///< N/m, K
  double line_share = 0.85;  ///< of the mass that is in the line
  /// N/m between two copies under a held force, at least; makes long lines heavier than the object.
  double min_stiffness = 60;
  /// N/m, the same for turning, where a box has its corners: who holds an object by one point turns it by its weight.
  double min_turning_stiffness = 4000;
  double give = 0.01;              ///< m, by which a line yields where users press against each other, if it may weigh
  double max_mass = 25;            ///< kg, of a line along that direction
  double slight = 0.3;             ///< N; who press against each other with less hold nothing
  double drag = 0.6;               ///< N s/m of the whole object
  double credited = 0.5;           ///< share of what the drag takes that may be given again
  double tank = 0.1;               ///< J at most; more is lost
  double reserve = 0.04;           ///< J; what a tank has above it goes to the peers, a twentieth a cycle
  double initial = 1e-4;           ///< J at the begin, of all copies together
  double allowance = 0.5e-3 / 60;  ///< W, of all copies together: brings them close when nobody moves
  double homing = 0.1;             ///< share of a difference between copies that is undone in D
  double max_speed = 2;            ///< m/s, of the set position
};

class CopyCoupling {
 public:
  /// `place`: this copy's number in the group, below settings.copies. `whole`: the object's.
  CopyCoupling(const CouplingSettings& settings, std::size_t place, const BodySettings& whole) noexcept;

  /// The group begins with the body as it moves now. The line moves with it: what it lacks of the whole's energy is
  /// credited to the tank, because the copies have been cut out of one body.
  void start(std::int64_t now_ns, const BodyState& body) noexcept;

  [[nodiscard]] std::size_t copies() const noexcept { return settings_.copies; }
  [[nodiscard]] std::size_t index() const noexcept { return place_; }
  /// What this copy is to be simulated as.
  [[nodiscard]] const BodySettings& share() const noexcept { return share_; }

  /// A peer's sample, in any order and any number of times. Realtime.
  void on_sample(std::size_t peer, const CopySample& sample) noexcept;

  /// Moves the set position and adds its spring to the step that `body` has begun.
  void begin(std::int64_t now_ns, double dt, RigidBody& body) noexcept;
  /// After the body's step, with the velocity that the solver found and the force of the users here on the body.
  void finish(const Vec6d& velocity, const RigidBody& body, const Vec3d& pressed) noexcept;
  /// To send, after `finish`.
  [[nodiscard]] const CopySample& sample() const noexcept { return own_; }

  struct Ledger {
    double given = 0;        ///< J to this copy, less what it took
    double tank = 0;         ///< J, never below 0
    double stored = 0;       ///< J in the spring
    double received = 0;     ///< J from peers and allowance
    std::uint64_t held = 0;  ///< cycles in which the tank could not pay the whole way
    double behind = 0;       ///< m, of the set position
    double apart = 0;        ///< m, of the centres of this copy and the one furthest from it, the line's delay ago
  };
  [[nodiscard]] const Ledger& ledger() const noexcept { return ledger_; }

 private:
  static constexpr std::size_t kHistory = 512;         // cycles
  static constexpr std::int64_t kCycleNs = 1'000'000;  // one place in a history each
  struct Received {
    std::int64_t time_ns = -1;
    Vec6d wave;
    Vec3d position;
    Eigen::Quaterniond orientation;
  };
  using History = std::array<Received, kHistory>;

  [[nodiscard]] Mat6d impedance_to(std::size_t peer) const noexcept;
  static void keep(History& history, const CopySample& sample, std::size_t to) noexcept;
  [[nodiscard]] static bool at(const History& history, std::int64_t time_ns, Received& found) noexcept;

  CouplingSettings settings_;
  std::size_t place_;
  BodySettings share_;
  Vec6d whole_ = Vec6d::Zero();         // mass and inertia
  Vec6d stiffness_, impedance_, drag_;  // impedance: of each line while nobody presses against anybody
  double line_delay_ = 0;               // s, D with the filter
  double filter_ = 0;                   // s

  std::array<History, kMaxCopies> received_;  // [place_]: of this copy itself
  std::array<double, kMaxCopies> energy_received_{};
  std::array<Vec3d, kMaxCopies> pressed_;  // N, by the users of each, as last heard
  std::array<std::int64_t, kMaxCopies> pressed_ns_{};
  bool started_ = false;
  std::int64_t start_ns_ = 0;
  Vec6d start_speed_ = Vec6d::Zero();

  Vec6d moved_ = Vec6d::Zero();  // u: integral of the copy's velocity
  Vec6d end_ = Vec6d::Zero();    // e, likewise
  Vec6d homed_ = Vec6d::Zero();  // added to each y
  bool may_home_ = true;         // the tank had enough beside the waves, in the last cycle
  struct Line {
    bool received = false;           // the peer, at the line's delay
    Vec6d offset = Vec6d::Zero();    // of its wave: the groups of two peers do not begin at one moment
    Vec6d arrived = Vec6d::Zero();   // y as far as it has been paid
    Vec6d wanted = Vec6d::Zero();    // y as it came
    Vec6d filtered = Vec6d::Zero();  // and without ringing
    Vec6d step = Vec6d::Zero();      // of y in this cycle
    Mat6d impedance = Mat6d::Zero();
  };
  std::array<Line, kMaxCopies> lines_;
  Vec6d step_ = Vec6d::Zero();        // mean of theirs, by their impedance
  Mat6d admittance_ = Mat6d::Zero();  // of all lines together
  Mat6d pull_ = Mat6d::Zero();        // stiffness in this cycle
  Eigen::Quaterniond axes_ = Eigen::Quaterniond::Identity();
  double dt_ = 0;
  std::int64_t now_ns_ = 0;
  CopySample own_;
  Ledger ledger_;
};

}  // namespace tactus::haptics
