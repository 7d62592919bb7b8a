/// The probes of other controllers as this one knows them, and the ends through which users near one object hear each
/// other whole (session/modes.hpp).
///
/// Service thread, but for what says otherwise.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "hrtc_service/handover.hpp"
#include "hrtc_service/touch_object.hpp"
#include "session/modes.hpp"
#include "session/remote_probe.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class Neighbours {
 public:
  using OnWhole = std::function<void(session::ProbeState&&)>;

  /// `on_whole` gets what arrives at a group's end, in a thread of DDS. `links` must outlive it.
  Neighbours(wire::Participants& participants, OnWhole on_whole);
  ~Neighbours();

  void on_catalogue(const session::CatalogueEntry& entry) { modes_.on_catalogue(entry); }
  void on_object_gone(std::uint64_t object) { modes_.forget_object(object); }
  /// Throws std::invalid_argument as session::parse_mode.
  void on_mode(const std::string& text) { modes_.command(session::parse_mode(text)); }
  void on_own_probe(std::uint64_t user, const std::array<double, 3>& position, std::int64_t now_ns) {
    modes_.on_probe(user, participants_.origin().participant, position, now_ns);
  }
  void on_state(const session::ProbeState& state, session::StateStream stream, std::int64_t now_ns,
                std::int64_t session_now_ns);
  /// What another controller misses of our states is among its figures.
  void on_metrics(const session::Metrics& metrics, std::int64_t now_ns);
  void on_controller_gone(std::uint64_t participant);
  void on_user_left(std::uint64_t user) { modes_.forget(user); }

  /// Builds and drops ends, forgets who is silent. `users`: ids by probe, 0 where there is none.
  void tick(std::int64_t now_ns, const std::array<std::uint64_t, kMaxProbes>& users);

  /// Sender's thread, before the states of each cycle: from now on it uses the newest ends and none that are dropped.
  void take_endpoints() noexcept { in_use_ = &whole_out_.latest(); }
  /// Sender's thread: sends the state of a probe whole if its user collaborates; false when it does not. Takes no lock.
  bool send_full_rate(std::uint32_t probe, const session::ProbeState& state);
  /// Any thread: the greatest share of our coded states that a controller misses.
  [[nodiscard]] double loss() const noexcept { return loss_.load(std::memory_order_relaxed); }

  void write(std::vector<session::Figure>& figures) const;
  /// States dropped because their origin, number or time is outside its window.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }
  /// For kLossesPartition: whose coded states get lost on their way here, and which share; empty when nobody's.
  [[nodiscard]] std::vector<session::Figure> losses() const;

 private:
  struct Remote {
    std::uint64_t participant = 0;
    std::int64_t seen_ns = 0;
    session::RemoteProbe probe;
  };
  struct Endpoints {
    std::unique_ptr<wire::Writer<session::ProbeState>> out;
    std::unique_ptr<wire::Reader<session::ProbeState>> in;
  };
  struct Missed {
    double share = 0;
    std::int64_t published_ns = 0;
  };

  void sync_endpoints(const std::array<std::uint64_t, kMaxProbes>& users);

  wire::Participants& participants_;
  OnWhole on_whole_;
  session::Modes modes_;
  std::map<std::pair<std::uint64_t, std::uint32_t>, Remote> remotes_;  // by user and probe
  std::map<std::uint64_t, Missed> missed_;                             // by controller
  std::uint64_t implausible_ = 0;
  std::atomic<double> loss_{0};
  std::map<std::uint64_t, Endpoints> endpoints_;                             // by group
  using Whole = std::array<wire::Writer<session::ProbeState>*, kMaxProbes>;  // by probe
  Whole whole_{};
  Handover<Whole> whole_out_;      // to the sender
  const Whole* in_use_ = nullptr;  // the sender's, since take_endpoints
  Retired<Endpoints> dropped_;     // until the sender has let go of them
};

}  // namespace tactus::hrtc_service
