/// A failure detector for the hosts that an HRTC needs now: pings them every few milliseconds, reports silent ones.
///
///     watch          the hosts that serve objects near a tip
///     next_request   the requests to send
///     on_answer      the answers
///     take_suspects  the hosts that are suspected now
///
/// The roster detects a failure within 250 ms, which is too slow for a host whose object is being touched. Fast
/// heartbeats from everyone would load the network with hosts times HRTCs messages. So each HRTC pings the one or two
/// hosts that it needs. A host answers from its main loop, so a host that hangs is detected too.
///
/// The timeout adapts to the silences of late, so that a lossy link or a busy machine raises few false suspicions. A
/// false one costs a change of host and no data (DeliveryClient::suspect_host). Time during which this program did not
/// poll does not count as silence. A host that has not answered yet is never suspected: it may not have discovered us.
/// Source: Chandra, Toueg 1996 (unreliable failure detectors); the rule for the timeout is ours.
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
  std::int64_t period_ns = 8'000'000;         ///< between requests to one host
  std::int64_t min_timeout_ns = 30'000'000;   ///< lower limit of the timeout
  std::int64_t max_timeout_ns = 250'000'000;  ///< upper limit; by then the roster has noticed as well
  double margin = 2;                          ///< timeout, as a multiple of the longest recent silence
  double half_life_s = 10;                    ///< of the longest recent silence
  std::int64_t max_poll_gap_ns = 6'000'000;   ///< longest time between two polls that counts as silence
};

class FailureDetector {
 public:
  FailureDetector(const Origin& self, const FailureDetectorSettings& settings) : self_{self}, settings_{settings} {}

  /// Replaces the hosts to watch.
  void watch(const std::vector<std::uint64_t>& hosts);
  [[nodiscard]] bool watches() const noexcept { return !hosts_.empty(); }
  /// Whether no host has an overdue answer: polling half as often is then enough.
  [[nodiscard]] bool all_answered() const noexcept;
  [[nodiscard]] bool watches(std::uint64_t host) const { return hosts_.count(host) != 0; }
  /// The next request that is due, or none; of topic clock.
  [[nodiscard]] std::optional<ClockSample> next_request(std::int64_t now_ns);
  void on_answer(const ClockSample& answer, std::int64_t now_ns);

  struct Suspect {
    std::uint64_t host = 0;
    std::int64_t silent_ns = 0;
  };
  /// Hosts whose timeout has expired since the last call; each is returned once, until it answers again. Call it every
  /// few milliseconds, after all samples that arrived have been taken.
  [[nodiscard]] std::vector<Suspect> take_suspects(std::int64_t now_ns);

  /// Suspicions that were followed by an answer of the same program.
  [[nodiscard]] std::uint64_t false_suspicions() const noexcept { return false_suspicions_; }

 private:
  struct Watched {
    std::int64_t requested_ns = 0;
    std::uint32_t sequence = 0;
    std::uint64_t incarnation = 0;  // of the last answer; 0: none yet
    std::int64_t silence_ns = 0;    // silence, while this program polled
    double longest_ns = 0;          // recent silence
    std::int64_t answered_ns = 0;
    bool missed = false;
  };
  [[nodiscard]] std::int64_t timeout_ns(const Watched& host) const noexcept;

  Origin self_;
  FailureDetectorSettings settings_;
  std::map<std::uint64_t, Watched> hosts_;
  std::int64_t polled_ns_ = 0;
  std::uint64_t false_suspicions_ = 0;
};

}  // namespace tactus::session
