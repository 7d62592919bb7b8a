/// Carries Ethernet frames between two tap devices. Two Links decide delays and losses.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <mutex>
#include <queue>
#include <string>
#include <vector>

#include "netem/link.hpp"

namespace tactus::netem {

struct RelayFigures {
  LinkCounts a_to_b, b_to_a;
  std::uint64_t overflowed = 0;  ///< frames dropped because kMaxFrames were in transit
  std::uint64_t sent = 0;        ///< frames
  /// Lateness of the frames sent: time after the departure that Link computed, us.
  double late_p50_us = 0, late_p99_us = 0, late_max_us = 0;
};

class Relay {
 public:
  /// Max number of frames in transit at once, in both directions together. Each takes 2 KiB, allocated on demand.
  static constexpr std::size_t kMaxFrames = 65536;

  /// `a` and `b` are non-blocking descriptors of tap devices. The caller keeps them open until run() returns.
  Relay(int a, int b, const LinkSettings& settings);
  ~Relay();
  Relay(const Relay&) = delete;
  Relay& operator=(const Relay&) = delete;

  /// Carries frames until stop(). Sleeps until shortly before a departure, then spins.
  void run();
  /// Ends run(). Any thread may call this.
  void stop() noexcept;
  /// Replaces the profiles, which must pass `check`, for later frames. Any thread may call this.
  void set_profiles(const LinkProfile& a_to_b, const LinkProfile& b_to_a);
  /// Any thread may call this.
  [[nodiscard]] RelayFigures figures() const;

 private:
  struct Frame {
    std::uint32_t bytes;
    std::array<std::uint8_t, 2044> data;
  };
  struct Departure {
    std::int64_t at_ns;
    std::uint64_t order;  // number of the arrival, which orders frames with equal departures
    std::uint32_t frame;
    int to;
    bool operator>(const Departure& other) const noexcept {
      return at_ns != other.at_ns ? at_ns > other.at_ns : order > other.order;
    }
  };

  void receive(int side);
  [[nodiscard]] std::uint32_t allocate_frame();
  void forward(std::uint32_t frame, std::int64_t at_ns, int to);
  void send_due();
  void wait(std::int64_t now_ns);

  std::array<int, 2> taps_;
  int wake_;
  std::array<Link, 2> links_;  // by the side at which frames arrive
  std::atomic<bool> stop_{false};
  std::deque<Frame> frames_;  // a deque, because frames must not move when it grows
  std::vector<std::uint32_t> free_;
  std::priority_queue<Departure, std::vector<Departure>, std::greater<>> departures_;
  std::uint64_t order_ = 0;

  mutable std::mutex mutex_;         // guards the members below, and links_
  std::vector<std::uint64_t> late_;  // counts by lateness in us; the last one counts all larger values
  double late_max_us_ = 0;
  std::uint64_t overflowed_ = 0, sent_ = 0;
};

}  // namespace tactus::netem
