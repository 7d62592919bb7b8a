/// Passive coupling between the copies of one object that several HRTCs simulate at once.
///
/// Each of N copies has a share of the mass. The rest of the mass is in wave-variable channels between each pair of
/// copies. A channel is one transmission line per axis, with impedance b and a delay D that covers the delay of the
/// network. A spring of stiffness K pulls each copy to its set position e, the common end of its channels:
///
///     copy --[ K ]-- e ==( channel: impedance b, delay D )== e --[ K ]-- copy
///                    \\==( another )== e --[ K ]-- copy
///
/// Let y_j be the integral of twice the wave that arrives from copy j, and ' the derivative by time. Then the spring
/// force is F = sum_j b (y_j' - e'). The integral of the departing wave is z_j = 2 e - y_j. After the delay D, z
/// arrives at the other end as y.
/// - Without contact the copies move as one body, whose mass is the sum of the shares plus b D per channel. b is chosen
///   so that this is the mass of the object. No force opposes a steady motion.
/// - If the users of two copies press against each other with force F, the copies separate by F (D / b + 2 / K). So the
///   channel between these copies gets a higher impedance, and with it more mass, along the direction of F.
/// - Lost samples need no repair, because samples carry the integrals of the waves. Jitter has no effect, because the
///   samples are interpolated at D.
///
/// Energy: an arriving wave of velocity a needs the energy b a^2 dt per step dt, which is taken from an energy tank.
/// Three sources fill the tank: the energy that the peers report as a counter in each sample, half of the drag losses,
/// and the numerical losses of the implicit spring. Loss, order and repetition of samples do not matter; one sample
/// adds at most a full tank. If the tank is too low, the set position moves less and catches up later. So whatever the
/// network does, all copies together return no more energy than they received: sum of Ledger::given <= initial_energy +
/// allowance * time + the kinetic energy that `start` puts into the tanks. Wrong delays or clocks reduce accuracy, not
/// passivity.
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

/// The state of a copy that its HRTC sends to the peers in every cycle.
struct CopySample {
  std::int64_t time_ns = 0;  ///< session time
  BodyState body;
  Vec3d user_force = Vec3d::Zero();  ///< N, world frame: smoothed force of the copy's own users on the copy
  /// By index of the peer: z since the group began, m and rad; and the energy put into the channel to this peer, J,
  /// which never decreases.
  std::array<Vec6d, kMaxCopies> waves = zero_waves();
  std::array<double, kMaxCopies> energy{};

  [[nodiscard]] static std::array<Vec6d, kMaxCopies> zero_waves() noexcept {
    std::array<Vec6d, kMaxCopies> waves;
    waves.fill(Vec6d::Zero());
    return waves;
  }
};

struct CouplingSettings {
  std::size_t copies = 2;       ///< number of copies in the group
  double delay = 0.03;          ///< s, D without the filter: max transit in the group; equal in all copies
  double stiffness = 1000;      ///< N/m, K
  double channel_share = 0.85;  ///< share of the object's mass that is in the channels
  /// N/m, minimum stiffness between two copies under a sustained force. For this, channels with a long delay get more
  /// mass than the object has.
  double min_stiffness = 60;
  /// N/m, minimum rotational stiffness, as the stiffness of springs at the corners of a box. It is high because an
  /// object that is held at one point turns under its weight.
  double min_rotational_stiffness = 4000;
  double stretch = 0.01;             ///< m, stretch of a channel under opposing forces, if max_mass allows it
  double max_mass = 25;              ///< kg, maximum mass of a channel along the direction of these forces
  double ignored_force = 0.3;        ///< N; smaller opposing forces are ignored
  double drag = 0.6;                 ///< N s/m, drag of the whole object
  double credited_drag_share = 0.5;  ///< share of the drag losses that is credited to the tank
  double tank = 0.1;                 ///< J, capacity of the tank; energy above it is lost
  double reserve = 0.04;             ///< J; each cycle, a twentieth of the tank's energy above this goes to the peers
  double initial_energy = 1e-4;      ///< J in all tanks together at the start
  double allowance = 0.5e-3 / 60;    ///< W into all tanks together, so that copies converge while nobody moves them
  double convergence_share = 0.1;    ///< share of the distance between copies by which they converge per D
  double max_speed = 2;              ///< m/s, maximum speed of the set position
};

/// Couples one copy to its peers.
class CopyCoupling {
 public:
  /// `index`: index of this copy in the group, below settings.copies. `whole`: the object with its whole mass.
  CopyCoupling(const CouplingSettings& settings, std::size_t index, const BodySettings& whole) noexcept;

  /// Starts the group: body and channels continue with the present motion of `body`. The channels replace a part of the
  /// mass that moved before, so the tank receives the kinetic energy of this part.
  void start(std::int64_t now_ns, const BodyState& body) noexcept;

  [[nodiscard]] std::size_t copies() const noexcept { return settings_.copies; }
  [[nodiscard]] std::size_t index() const noexcept { return index_; }
  /// Settings of the body that simulates this copy.
  [[nodiscard]] const BodySettings& body_settings() const noexcept { return share_; }

  /// Takes a sample of a peer; samples may arrive in any order and repeatedly. Realtime.
  void on_sample(std::size_t peer, const CopySample& sample) noexcept;

  /// Chooses the step of the set position, and adds the spring to the step that `body` has begun. Realtime.
  void begin(std::int64_t now_ns, double dt, RigidBody& body) noexcept;
  /// Ends the cycle after the body's step. `velocity`: result of the solver. `user_force`: force of the local users on the
  /// body, N. Realtime.
  void finish(const Vec6d& velocity, const RigidBody& body, const Vec3d& user_force) noexcept;
  /// The sample to send, after `finish`.
  [[nodiscard]] const CopySample& sample() const noexcept { return own_; }

  struct Ledger {
    double given = 0;                  ///< J given to this copy minus J taken from it
    double tank = 0;                   ///< J in the tank, never below 0
    double stored = 0;                 ///< J in the spring
    double received = 0;               ///< J put into the tank by peers and the allowance, and at the start
    std::uint64_t limited_cycles = 0;  ///< cycles in which the tank was too low for the whole step
    double lag = 0;                    ///< m, largest lag of the set position behind a channel's wave
    double copy_distance = 0;          ///< m, max distance between this copy and another, `delay` of the settings ago
  };
  [[nodiscard]] const Ledger& ledger() const noexcept { return ledger_; }

 private:
  static constexpr std::size_t kHistory = 512;         // cycles
  static constexpr std::int64_t kCycleNs = 1'000'000;  // period of the entries of a history
  /// One sample in a history.
  struct Received {
    std::int64_t time_ns = -1;
    Vec6d wave;
    Vec3d position;
    Eigen::Quaterniond orientation;
  };
  using History = std::array<Received, kHistory>;

  [[nodiscard]] Mat6d impedance_to(std::size_t peer) const noexcept;
  void receive_waves(std::int64_t now_ns, double dt) noexcept;
  void choose_step(double dt) noexcept;
  void add_spring(double dt, RigidBody& body) noexcept;
  static void store(History& history, const CopySample& sample, std::size_t to) noexcept;
  [[nodiscard]] static bool interpolate(const History& history, std::int64_t time_ns, Received& found) noexcept;

  CouplingSettings settings_;
  std::size_t index_;
  BodySettings share_;
  Vec6d whole_ = Vec6d::Zero();  // mass and inertia of the whole object
  Vec6d stiffness_, drag_;
  Vec6d impedance_;           // of each channel without opposing forces
  double channel_delay_ = 0;  // s, D with the filter
  double filter_ = 0;         // s, time constant of the low-pass filter of the waves

  std::array<History, kMaxCopies> received_;  // by index of the copy, also of this one
  std::array<double, kMaxCopies> energy_received_{};
  std::array<Vec3d, kMaxCopies> user_force_;  // N, force of the users of each copy on that copy
  std::array<std::int64_t, kMaxCopies> user_force_ns_{};
  bool started_ = false;
  std::int64_t start_ns_ = 0;
  Vec6d start_speed_ = Vec6d::Zero();

  Vec6d moved_ = Vec6d::Zero();         // u: integral of the copy's velocity
  Vec6d set_position_ = Vec6d::Zero();  // e: integral of the velocity of the set position
  Vec6d homing_ = Vec6d::Zero();        // added to each y, so that the copies converge
  bool may_home_ = true;                // in the last cycle the tank had more energy than the waves needed
  /// The channel to one peer.
  struct Channel {
    bool received = false;           // a sample has been available at the channel's delay
    Vec6d offset = Vec6d::Zero();    // added to received waves, because peers start the group at different times
    Vec6d raw = Vec6d::Zero();       // y as received
    Vec6d filtered = Vec6d::Zero();  // y, low-pass filtered
    Vec6d arrived = Vec6d::Zero();   // y, as far as the tank had the energy for it
    Vec6d step = Vec6d::Zero();      // change of `arrived` in this cycle
    Mat6d impedance = Mat6d::Zero();
  };
  std::array<Channel, kMaxCopies> channels_;
  Vec6d step_ = Vec6d::Zero();                 // mean of the channels' steps, weighted by impedance
  Mat6d admittance_ = Mat6d::Zero();           // of all channels together
  Mat6d effective_stiffness_ = Mat6d::Zero();  // of spring and channels in series in this cycle
  Eigen::Quaterniond axes_ = Eigen::Quaterniond::Identity();
  double dt_ = 0;
  std::int64_t now_ns_ = 0;
  CopySample own_;
  Ledger ledger_;
};

}  // namespace tactus::haptics
