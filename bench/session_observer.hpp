/// Observes a running session: measures the ages and counts of probe states, and records exact contacts and metrics.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "bench/figures.hpp"
#include "realtime/process.hpp"
#include "session/figures.hpp"
#include "session/messages.hpp"
#include "wire/endpoints.hpp"
#include "wire/participants.hpp"

namespace tactus::bench {

/// Deadband-coded probe states of all users.
struct StateDelivery {
  Samples ages_us;     // time from sending to decoding of each state that arrived
  double arrived = 0,  // number of states that arrived between the first and the last metrics sample of their HRTC
      sent = 0;        // number of states that the HRTCs sent in the same time, by their metrics
};

/// Receives the probe states and metrics of all participants of a session.
class SessionObserver {
 public:
  explicit SessionObserver(const wire::SessionAddress& address)
      : links_{address},
        states_{links_, wire::topics::kProbeState, [this](session::ProbeState&& state) { on_state(state); }},
        metrics_{links_, wire::topics::kMetrics, [this](session::Metrics&& metrics) { on_metrics(metrics); }} {}

  /// Adds the ages of the probe states of `user` to `ages`, us, until the next call. Null: adds no ages.
  void add_ages_of(const std::string& user, Samples* ages) {
    const std::lock_guard lock{mutex_};
    user_with_ages_ = session::id_of(user);
    ages_ = ages;
    last_age_ns_ = realtime::monotonic_ns();
    longest_silence_ns_ = 0;
  }
  /// Returns the longest time without a probe state of the user of `add_ages_of`, from that call until now, ms.
  [[nodiscard]] double longest_silence_ms() const {
    const std::lock_guard lock{mutex_};
    return static_cast<double>(std::max(longest_silence_ns_, realtime::monotonic_ns() - last_age_ns_)) * 1e-6;
  }
  /// Adds each value of the figure `name` that arrives to `values`, until the next call. Null: adds no values.
  void add_values_of(const std::string& name, Samples* values) {
    const std::lock_guard lock{mutex_};
    figure_with_values_ = name;
    values_ = values;
  }
  /// Counts the states of all users until `stop_counting` is called.
  void start_counting() {
    const std::lock_guard lock{mutex_};
    counting_ = true;
    delivery_ = {};
    counts_.clear();
  }
  /// Stops the count. Returns the states received since `start_counting`.
  [[nodiscard]] StateDelivery stop_counting() {
    const std::lock_guard lock{mutex_};
    counting_ = false;
    for (const auto& [hrtc, count] : counts_) {
      delivery_.arrived += count.arrived_at_last - count.arrived_at_first;
      delivery_.sent += count.sent_at_last - count.sent_at_first;
    }
    return std::exchange(delivery_, {});
  }
  /// Returns the number of users that have had an exact contact.
  [[nodiscard]] std::size_t exact_users() const {
    const std::lock_guard lock{mutex_};
    return exact_users_.size();
  }
  /// Returns the newest value of the figure `name` of a participant. Returns 0 if none has arrived.
  [[nodiscard]] double figure(const std::string& participant, const std::string& name) const {
    const std::lock_guard lock{mutex_};
    const auto found = figures_.find({session::id_of(participant), name});
    return found == figures_.end() ? 0 : found->second;
  }

 private:
  /// Numbers of states of one HRTC: now, and at its first and last metrics sample since `start_counting`.
  struct Count {
    double arrived = 0, arrived_at_first = 0, arrived_at_last = 0, sent_at_first = -1, sent_at_last = 0;
  };

  void on_state(const session::ProbeState& state) {
    const std::lock_guard lock{mutex_};
    const std::int64_t now_ns = realtime::monotonic_ns();
    const double age_us = static_cast<double>(now_ns - state.origin.time_ns) / 1e3;
    if (ages_ != nullptr && state.user_id == user_with_ages_) {
      ages_->add(age_us);
      longest_silence_ns_ = std::max(longest_silence_ns_, now_ns - last_age_ns_);
      last_age_ns_ = now_ns;
    }
    if (counting_) {
      delivery_.ages_us.add(age_us);
      ++counts_[state.origin.participant].arrived;
    }
    constexpr std::uint32_t kTouches = session::kInContact | session::kExact;
    if ((state.status & kTouches) == kTouches) exact_users_.insert(state.user_id);
  }
  void on_metrics(const session::Metrics& metrics) {
    const std::lock_guard lock{mutex_};
    for (const auto& [name, value] : metrics.figures) {
      figures_[{metrics.origin.participant, name}] = value;
      if (values_ != nullptr && name == figure_with_values_) values_->add(value);
      if (!counting_ || name != session::figures::kStatesDeadbandCoded) continue;
      Count& count = counts_[metrics.origin.participant];
      if (count.sent_at_first < 0) {
        count.sent_at_first = value;
        count.arrived_at_first = count.arrived;
      }
      count.sent_at_last = value;
      count.arrived_at_last = count.arrived;
    }
  }

  mutable std::mutex mutex_;
  std::uint64_t user_with_ages_ = 0;
  Samples* ages_ = nullptr;
  std::int64_t last_age_ns_ = 0, longest_silence_ns_ = 0;
  std::string figure_with_values_;
  Samples* values_ = nullptr;
  bool counting_ = false;
  StateDelivery delivery_;
  std::map<std::uint64_t, Count> counts_;  // by HRTC
  std::set<std::uint64_t> exact_users_;
  std::map<std::pair<std::uint64_t, std::string>, double> figures_;
  wire::Participants links_;
  wire::Reader<session::ProbeState> states_;
  wire::Reader<session::Metrics> metrics_;
};

}  // namespace tactus::bench
