/// Detects failures of the hosts that an HRTC needs now: pings these hosts every few milliseconds and reports those
/// that do not answer.
///
///     watch          sets the hosts that serve objects near a tip
///     next_request   returns the requests to send
///     on_answer      processes the answers
///     take_suspects  returns the hosts that are newly suspected
///
/// The roster detects a failure within 250 ms. That is too slow for a host whose object is being touched. If all hosts
/// sent fast heartbeats to all HRTCs, the load would grow with hosts times HRTCs. So each HRTC pings the one or two
/// hosts that it needs. A host answers from its main loop, so a host that hangs is detected too.
///
/// The timeout adapts to the longest recent silence, so that a lossy link or a busy machine causes few false
/// suspicions. A false suspicion causes a change of host and loses no data (DeliveryClient::suspect_host). Time during
/// which this program did not poll does not count as silence. A host that has not answered yet is never suspected,
/// because it may not have discovered this program. Source: Chandra, Toueg 1996 (unreliable failure detectors); the
/// rule for the timeout is ours.
///
/// No clock, socket or thread; one thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "session/messages.hpp"

namespace tactus::session {

struct FailureDetectorSettings {
  std::int64_t period_ns = 8'000'000;         ///< time between requests to one host
  std::int64_t min_timeout_ns = 30'000'000;   ///< lower limit of the timeout
  std::int64_t max_timeout_ns = 250'000'000;  ///< upper limit; the roster detects a failure by then
  double margin = 2;                          ///< the timeout is this multiple of the longest recent silence
  double half_life_s = 10;                    ///< half-life of the longest recent silence
  std::int64_t max_poll_gap_ns = 6'000'000;   ///< max silence that one call of take_suspects adds
};

class FailureDetector {
 public:
  FailureDetector(const Origin& self, const FailureDetectorSettings& settings) : self_{self}, settings_{settings} {}

  /// Sets the hosts to ping.
  void watch(const std::vector<std::uint64_t>& hosts);
  /// Whether there are hosts to ping.
  [[nodiscard]] bool watches() const noexcept { return !hosts_.empty(); }
  /// Whether every host has answered within the last request period. Suspected hosts, and hosts that have never
  /// answered, do not count. If true, it is enough to call take_suspects half as often.
  [[nodiscard]] bool all_answered() const noexcept;
  [[nodiscard]] bool watches(std::uint64_t host) const { return hosts_.count(host) != 0; }
  /// Returns the next request that is due, for topic clock, or none.
  [[nodiscard]] std::optional<ClockSample> next_request(std::int64_t now_ns);
  void on_answer(const ClockSample& answer, std::int64_t now_ns);

  struct Suspect {
    std::uint64_t host = 0;
    std::int64_t silent_ns = 0;
  };
  /// Returns the hosts whose timeout has expired since the last call. A host is returned again only after it has
  /// answered. Call it every few milliseconds, after all received samples have been processed.
  [[nodiscard]] std::vector<Suspect> take_suspects(std::int64_t now_ns);

  /// Number of false suspicions: the host answered later, with the same incarnation.
  [[nodiscard]] std::uint64_t false_suspicions() const noexcept { return false_suspicions_; }

 private:
  struct Watched {
    std::int64_t requested_ns = 0;
    std::uint32_t sequence = 0;
    std::uint64_t incarnation = 0;  // of the last answer; 0: none yet
    std::int64_t silence_ns = 0;    // since the last answer, while this program polled
    double longest_ns = 0;          // longest recent silence, decaying
    std::int64_t answered_ns = 0;   // arrival of the last answer
    bool suspected = false;
  };
  [[nodiscard]] std::int64_t timeout_ns(const Watched& host) const noexcept;

  Origin self_;
  FailureDetectorSettings settings_;
  std::map<std::uint64_t, Watched> hosts_;
  std::int64_t polled_ns_ = 0;
  std::uint64_t false_suspicions_ = 0;
};

}  // namespace tactus::session
