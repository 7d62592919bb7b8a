/// How much a host may have under way to one HRTC, and how fast it sends that: delay-based, with nothing to set.
///
/// Each demand tells the least time that a chunk took since the one before, from the host's clock to the HRTC's; what
/// that is above what is usual while little is sent is time spent in queues, whatever the clocks. The window grows and
/// shrinks so that this stays at a target of about a millisecond, more on long ways. That fills a link of any rate, and
/// leaves probe states that share its queue little to wait for; loss alone says nothing, for a link that loses is not
/// full. Chunks leave evenly spread over the time in which a window is answered.
///
/// Source: LEDBAT, RFC 6817. Different here: the target; the window moves in proportion to what is acknowledged, and
/// only while it is in use; it is a part for some moments every few seconds, so that what is usual is known however
/// long the link is full (LEDBAT++). What is usual is a mean, not the least: where delays wander by themselves, most
/// are far above the least of some seconds, and a window that took that for a queue would close.
///
/// No clock in it: times are nanoseconds of the host's monotonic clock. One thread at a time.
#pragma once

#include <cstdint>
#include <optional>

namespace tactus::session {

class Pacer {
 public:
  /// Whether a chunk of so many bytes may leave now.
  [[nodiscard]] bool may_send(std::uint32_t bytes, std::int64_t now_ns);
  /// When the next chunk may leave, as far as the pace alone decides.
  [[nodiscard]] std::int64_t next_ns() const noexcept { return next_ns_; }
  void sent(std::uint32_t bytes, std::int64_t now_ns);
  /// There is nothing to send.
  void rest() noexcept { paced_ = false; }

  /// What a demand tells of chunks that were under way.
  struct Feedback {
    std::uint32_t arrived_bytes = 0, lost_bytes = 0;
    std::int64_t loop_ns = 0;                 ///< since the first of those that arrived was sent
    std::optional<std::uint32_t> one_way_us;  ///< Demand::one_way_us
  };
  void on_feedback(const Feedback& feedback, std::int64_t now_ns);
  /// So much will never be told of.
  void forget(std::uint32_t bytes) noexcept { under_way_ -= bytes; }

  [[nodiscard]] std::uint32_t under_way() const noexcept { return under_way_; }
  [[nodiscard]] double window() const noexcept { return window_; }
  /// Time that chunks last spent in queues.
  [[nodiscard]] std::int64_t queueing_ns() const noexcept { return queueing_ns_; }

 private:
  [[nodiscard]] double pace() const noexcept;  // bytes/ns
  [[nodiscard]] std::int64_t target_ns() const noexcept;
  void note_round(const Feedback& feedback, std::int64_t now_ns);
  void note_one_way(std::uint32_t one_way_us, std::int64_t now_ns);

  double window_;  // bytes
  std::uint32_t under_way_ = 0;
  std::int64_t next_ns_ = 0;
  std::int64_t loop_ns_ = 0;  // from sending a chunk to being told of it, smoothed; 0 before the first
  bool starting_ = true;      // the window doubles each loop
  bool held_up_ = false;      // something had to wait since the last feedback
  bool paced_ = false;        // the pace alone held up what was last asked for
  // One-way times are relative to the first, us: the least of this and of the last span, which began then.
  std::optional<std::uint32_t> first_us_;
  std::int32_t min_us_[2];
  std::int64_t span_ns_ = 0;
  std::int64_t queueing_ns_ = 0;
  std::int64_t empty_ns_ = 0;        // when the queue was last seen empty
  std::int64_t drain_until_ns_ = 0;  // `drain_share_` of the window until then
  double drain_share_ = 1;
  // While so little is sent that no queue can be ours: mean over the last second, us; since when that has not been.
  std::optional<double> usual_us_;
  std::int64_t usual_ns_ = 0;
  std::int64_t wander_ns_ = 0;  // what it is above the least
  std::int64_t loaded_until_ns_ = 0;
  double best_ = 0;  // bytes/ns that arrived in the best of the last loops
  // Of the current loop.
  std::int64_t round_ns_ = 0;
  std::uint64_t round_arrived_ = 0, round_lost_ = 0;

 public:
  Pacer() noexcept;
};

}  // namespace tactus::session
