/// Passive coupling between the copies of one object that several HRTCs simulate at once.
///
/// Each of N copies has its share of the mass. The rest is in wave-variable channels between each pair of copies: one
/// transmission line per axis with the delay of the network. A spring pulls each copy to a set position e, the common
/// end of its channels:
///
///     copy --[ K ]-- e ==( channel: impedance b, delay D )== e --[ K ]-- copy
///                    \\==( another )== e --[ K ]-- copy
///
/// With y_j the integral of twice the wave that arrives from copy j, F = sum_j b (y_j' - e'). The departing wave, as an
/// integral, is z_j = 2 e - y_j; it becomes y at the other end after D.
/// - Without contact the copies move as one body, with the mass of the shares plus b D per channel. b is chosen so that
///   this is the mass of the object. No force opposes a steady motion.
/// - A sustained force against a peer's stretches the channel: the copies separate by F (D / b + 2 / K). So a channel
///   gets a higher impedance, and more mass, along the direction in which its two users press against each other.
/// - Lost samples need no repair, because waves are sent as integrals. Jitter does not matter, because samples are
///   interpolated at D.
///
/// Energy: a wave of velocity a costs b a^2 dt where it arrives. A tank pays for it. Three sources fill the tank: the
/// energy that the peers report in a counter in each sample, half of the drag losses, and the numerical losses of the
/// implicit spring. Loss, order and repetition of samples do not matter; one sample adds at most a full tank. When the
/// tank is too low the set position moves less and catches up later. So for every behaviour of the network, all copies
/// together return at most what was put in: sum of `given` <= initial + allowance * time. Wrong delays or clocks cost
/// accuracy, not passivity.
///
/// Translation in the world frame, rotation about the body's axes. Session time is an argument. One thread at a time.
/// Realtime. Source: Niemeyer, Slotine 1991 (wave variables, integrals of waves against drift); Lee, Huang 2010
/// (passive set-position modulation: spring, tank, credited share of the damping).
#pragma once

#include <array>
#include <cstdint>

#include "haptics/rigid_body.hpp"

namespace tactus::haptics {

inline constexpr std::size_t kMaxCopies = 8;

/// What a copy sends to its peers in every cycle.
struct CopySample {
  std::int64_t time_ns = 0;  ///< session time
  BodyState body;
  Vec3d pressed = Vec3d::Zero();  ///< N, world frame: force of its own users on it, smoothed
  /// By index of the peer: z, m and rad since the group began; and J put into the channel to it, which never falls.
  std::array<Vec6d, kMaxCopies> waves = zero_waves();
  std::array<double, kMaxCopies> energy{};

  [[nodiscard]] static std::array<Vec6d, kMaxCopies> zero_waves() noexcept {
    std::array<Vec6d, kMaxCopies> waves;
    waves.fill(Vec6d::Zero());
    return waves;
  }
};

struct CouplingSettings {
  std::size_t copies = 2;   ///< of this group, including this one
  double delay = 0.03;      ///< s, D without filter: the group's longest one-way delay with jitter; equal in all copies
  double stiffness = 1000;  ///< N/m, K
  double channel_share = 0.85;  ///< share of the mass that is in the channels
  /// N/m, minimum stiffness between two copies under a sustained force; long channels become heavier than the object.
  double min_stiffness = 60;
  /// N/m, the same for rotation, at the corners of a box: an object held by one point turns under its weight.
  double min_rotational_stiffness = 4000;
  double stretch = 0.01;           ///< m, stretch of a channel under opposing forces, if max_mass allows it
  double max_mass = 25;            ///< kg, of a channel along that direction
  double ignored_force = 0.3;      ///< N; smaller opposing forces are ignored
  double drag = 0.6;               ///< N s/m, of the whole object
  double credited = 0.5;           ///< share of the drag losses that is credited to the tank
  double tank = 0.1;               ///< J, maximum; more is lost
  double reserve = 0.04;           ///< J; a twentieth of the energy above it goes to the peers per cycle
  double initial = 1e-4;           ///< J at the start, of all copies together
  double allowance = 0.5e-3 / 60;  ///< W, of all copies together: lets copies converge when nobody moves them
  double homing = 0.1;             ///< share of a difference between copies that is removed per D
  double max_speed = 2;            ///< m/s, of the set position
};

class CopyCoupling {
 public:
  /// `index`: this copy's number in the group, below settings.copies. `whole`: the whole object.
  CopyCoupling(const CouplingSettings& settings, std::size_t index, const BodySettings& whole) noexcept;

  /// Starts the group with the body's present motion, and the channels move with it. The copies were cut out of one
  /// body, so the tank receives the kinetic energy that the shares of the mass lack.
  void start(std::int64_t now_ns, const BodyState& body) noexcept;

  [[nodiscard]] std::size_t copies() const noexcept { return settings_.copies; }
  [[nodiscard]] std::size_t index() const noexcept { return index_; }
  /// The body that simulates this copy.
  [[nodiscard]] const BodySettings& share() const noexcept { return share_; }

  /// A peer's sample, in any order and with any repetition. Realtime.
  void on_sample(std::size_t peer, const CopySample& sample) noexcept;

  /// Moves the set position and adds its spring to the step that `body` has begun. Realtime.
  void begin(std::int64_t now_ns, double dt, RigidBody& body) noexcept;
  /// Call after the body's step, with the solver's velocity and the force of the local users on the body. Realtime.
  void finish(const Vec6d& velocity, const RigidBody& body, const Vec3d& pressed) noexcept;
  /// The sample to send, after `finish`.
  [[nodiscard]] const CopySample& sample() const noexcept { return own_; }

  struct Ledger {
    double given = 0;        ///< J given to this copy minus J taken from it
    double tank = 0;         ///< J, never below 0
    double stored = 0;       ///< J in the spring
    double received = 0;     ///< J from peers and from the allowance
    std::uint64_t held = 0;  ///< cycles in which the tank could not pay the whole step
    double behind = 0;       ///< m, lag of the set position
    double apart = 0;        ///< m, greatest distance between this copy and another, one channel delay ago
  };
  [[nodiscard]] const Ledger& ledger() const noexcept { return ledger_; }

 private:
  static constexpr std::size_t kHistory = 512;         // cycles
  static constexpr std::int64_t kCycleNs = 1'000'000;  // one entry of a history per cycle
  struct Received {
    std::int64_t time_ns = -1;
    Vec6d wave;
    Vec3d position;
    Eigen::Quaterniond orientation;
  };
  using History = std::array<Received, kHistory>;

  [[nodiscard]] Mat6d impedance_to(std::size_t peer) const noexcept;
  static void store(History& history, const CopySample& sample, std::size_t to) noexcept;
  [[nodiscard]] static bool interpolate(const History& history, std::int64_t time_ns, Received& found) noexcept;

  CouplingSettings settings_;
  std::size_t index_;
  BodySettings share_;
  Vec6d whole_ = Vec6d::Zero();         // mass and inertia
  Vec6d stiffness_, impedance_, drag_;  // impedance: of each channel without opposing forces
  double channel_delay_ = 0;            // s, D with the filter
  double filter_ = 0;                   // s

  std::array<History, kMaxCopies> received_;  // [index_]: of this copy itself
  std::array<double, kMaxCopies> energy_received_{};
  std::array<Vec3d, kMaxCopies> pressed_;  // N, by the users of each copy, as last received
  std::array<std::int64_t, kMaxCopies> pressed_ns_{};
  bool started_ = false;
  std::int64_t start_ns_ = 0;
  Vec6d start_speed_ = Vec6d::Zero();

  Vec6d moved_ = Vec6d::Zero();         // u: integral of the copy's velocity
  Vec6d set_position_ = Vec6d::Zero();  // e, likewise
  Vec6d homing_ = Vec6d::Zero();        // added to each y
  bool may_home_ = true;                // the tank had enough energy beside the waves in the last cycle
  struct Channel {
    bool received = false;           // a sample of the peer is available at the channel's delay
    Vec6d offset = Vec6d::Zero();    // of its wave: the groups of two peers do not start at the same time
    Vec6d arrived = Vec6d::Zero();   // y as far as its energy has been paid
    Vec6d wanted = Vec6d::Zero();    // y as received
    Vec6d filtered = Vec6d::Zero();  // y, low-pass filtered
    Vec6d step = Vec6d::Zero();      // of y in this cycle
    Mat6d impedance = Mat6d::Zero();
  };
  std::array<Channel, kMaxCopies> channels_;
  Vec6d step_ = Vec6d::Zero();        // mean of the channels' steps, weighted by impedance
  Mat6d admittance_ = Mat6d::Zero();  // of all channels together
  Mat6d pull_ = Mat6d::Zero();        // stiffness in this cycle
  Eigen::Quaterniond axes_ = Eigen::Quaterniond::Identity();
  double dt_ = 0;
  std::int64_t now_ns_ = 0;
  CopySample own_;
  Ledger ledger_;
};

}  // namespace tactus::haptics
