/// Whether the hosts that an HRTC needs right now are alive: asked every few milliseconds, silent ones named.
///
///     watch        the hosts that serve what a tip is near
///     ask          questions to send
///     on_answer    whatever comes back
///     silent       who has been silent for too long
///
/// The roster tells of everyone within 250 ms. Who is touched must not wait so long, and to have everyone beat fast for
/// everyone would load the network with hosts times HRTCs; so the one who needs an answer asks for it, of the one or
/// two hosts that it needs it from. An answer is of the host's own loop: one that hangs is as good as dead.
///
/// How long a silence is too long follows from those that were seen of late, so that a link that loses or a busy
/// machine raises few false alarms; one costs a change of host and no data, see DeliveryClient::host_silent. Time in
/// which this program itself did not look does not count as silence. Before its first answer a host is not missed: it
/// may not have found us yet.
///
/// No clock, socket or thread in it; one thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "session/messages.hpp"

namespace tactus::session {

struct FailureDetectorSettings {
  std::int64_t period_ns = 8'000'000;          ///< between questions to one host
  std::int64_t min_patience_ns = 30'000'000;   ///< a silence up to this is none
  std::int64_t max_patience_ns = 250'000'000;  ///< then the roster has noticed as well
  double margin = 2;                           ///< patience, as a multiple of the longest silence that ended of late
  double half_life_s = 10;                     ///< in which a long silence is half forgotten
  std::int64_t max_unwatched_ns = 6'000'000;   ///< between two looks; what is longer was this program's own sleep
};

class FailureDetector {
 public:
  FailureDetector(const Origin& self, const FailureDetectorSettings& settings) : self_{self}, settings_{settings} {}

  /// These and no others from now on.
  void watch(const std::vector<std::uint64_t>& hosts);
  [[nodiscard]] bool watches() const noexcept { return !hosts_.empty(); }
  /// No host has left a question unanswered: looking half as often is enough.
  [[nodiscard]] bool at_ease() const noexcept;
  [[nodiscard]] bool watches(std::uint64_t host) const { return hosts_.count(host) != 0; }
  /// The next question that is due, or none; a clock request as the topic has it.
  [[nodiscard]] std::optional<ClockSample> ask(std::int64_t now_ns);
  void on_answer(const ClockSample& answer, std::int64_t now_ns);

  struct Silent {
    std::uint64_t host = 0;
    std::int64_t for_ns = 0;
  };
  /// Hosts whose patience has run out since the last call; each is named once, until it answers again. Lets time pass:
  /// call it after what has arrived has been taken, every few milliseconds.
  [[nodiscard]] std::vector<Silent> silent(std::int64_t now_ns);

  /// Silences that were too long and yet ended with an answer of the same program.
  [[nodiscard]] std::uint64_t false_alarms() const noexcept { return false_alarms_; }

 private:
  struct Watched {
    std::int64_t requested_ns = 0;
    std::uint32_t sequence = 0;
    std::uint64_t incarnation = 0;  // that answered last; 0: none has
    std::int64_t silent_ns = 0;     // while this program looked
    double longest_ns = 0;          // of late
    std::int64_t answered_ns = 0;
    bool missed = false;
  };
  [[nodiscard]] std::int64_t patience_ns(const Watched& host) const noexcept;

  Origin self_;
  FailureDetectorSettings settings_;
  std::map<std::uint64_t, Watched> hosts_;
  std::int64_t looked_ns_ = 0;
  std::uint64_t false_alarms_ = 0;
};

}  // namespace tactus::session
