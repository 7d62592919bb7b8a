/// Tracks the probes of users at other HRTCs, and the groups in which users of this HRTC collaborate with them.
///
///     probe states (deadband-coded, full-rate)  --> RemoteProbe, Modes  --> groups that need full-rate states
///     metrics of other HRTCs                    --> share of this HRTC's states that the others lose
///
/// If the full-rate states of all remote probes arrive late or are lost, the link of this HRTC is too slow for them, so
/// this HRTC leaves its groups for a time. If only some do, their HRTCs get a report, and they leave theirs.
///
/// No DDS, thread or clock. One thread at a time, except `loss`.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "session/figures.hpp"
#include "session/full_rate_check.hpp"
#include "session/messages.hpp"
#include "session/modes.hpp"
#include "session/remote_probe.hpp"

namespace tactus::hrtc_service {

class RemoteUsers {
 public:
  /// `self`: this HRTC's participant.
  explicit RemoteUsers(std::uint64_t self) : self_{self}, modes_{self} {}

  void on_catalogue(const session::CatalogueEntry& entry) { modes_.on_catalogue(entry); }
  void on_object_gone(std::uint64_t object) { modes_.forget_object(object); }
  /// Applies the text of a mode command. Throws std::invalid_argument like session::parse_mode.
  void on_mode(const std::string& text) { modes_.set_command(session::parse_mode(text)); }
  void on_own_probe(std::uint64_t user, const std::array<double, 3>& position, std::int64_t now_ns) {
    modes_.on_probe(user, self_, position, now_ns);
  }
  void on_state(const session::ProbeState& state, session::StateStream stream, std::int64_t now_ns,
                std::int64_t session_now_ns);
  /// Reads from the metrics of another HRTC the share of our states that it lost, and whether our full-rate states are
  /// late there.
  void on_metrics(const session::Metrics& metrics, std::int64_t now_ns);
  void on_hrtc_gone(std::uint64_t participant);
  void on_user_left(std::uint64_t user) { modes_.forget_user(user); }
  /// Removes probes without recent states and loss reports that are too old, and decides the groups again.
  void tick(std::int64_t now_ns);

  /// Returns the groups that need endpoints, ascending.
  [[nodiscard]] std::vector<std::uint64_t> groups() const { return modes_.groups(); }
  /// Returns the group of a user of this HRTC, or 0.
  [[nodiscard]] std::uint64_t group_of(std::uint64_t user) const { return modes_.group_of(user); }
  /// Whether this HRTC has left all groups, because its link is too slow for full-rate states.
  [[nodiscard]] bool is_paused() const noexcept { return modes_.is_paused(); }
  /// Sets whether the writer and the reader of a group are matched with endpoints of peers.
  void on_peers(std::uint64_t group, bool matched) { modes_.on_peers(group, matched); }

  /// Returns the share of our deadband-coded states that other HRTCs lose: the max over these HRTCs. Omits the HRTCs
  /// whose link seems to be full. Any thread.
  [[nodiscard]] double loss() const noexcept { return loss_.load(std::memory_order_relaxed); }
  void add_figures(std::vector<session::Figure>& figures) const;
  /// Returns the number of states that were dropped because a number or time was outside its plausible window, or
  /// because the sender or all senders together have too many probes.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }
  /// Returns, for each other HRTC, the share of its deadband-coded states that this HRTC lost. Omits shares near 0. If
  /// the link of the other is too slow for its full-rate states, also returns the share of them that were lost or late.
  [[nodiscard]] std::vector<session::Figure> losses() const;

 private:
  struct Remote {
    std::uint64_t participant = 0;
    std::int64_t received_ns = 0;
    session::RemoteProbe probe;
  };
  using ProbeKey = std::pair<std::uint64_t, std::uint32_t>;  // user and probe
  struct FullRate {
    std::uint64_t participant = 0;
    session::FullRateCheck check;
    double reported_share = 0;  // of states that are lost or late; 0: nothing to report
  };
  struct Loss {
    double share = 0;
    std::int64_t received_ns = 0;
  };

  void check_full_rate(std::int64_t now_ns);
  [[nodiscard]] Remote* find_or_add(const session::ProbeState& state, std::int64_t now_ns);

  std::uint64_t self_;
  session::Modes modes_;
  std::map<ProbeKey, Remote> remotes_;
  // While states fill a link, heartbeats are lost, and the remote probes are removed. Their checks remain.
  std::map<ProbeKey, FullRate> full_rate_;
  std::map<std::uint64_t, Loss> losses_;  // of our states, by the HRTC that lost them
  std::uint64_t implausible_ = 0;
  std::atomic<double> loss_{0};
};

}  // namespace tactus::hrtc_service
