#include "netem/relay.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace tactus::netem {
namespace {

constexpr int kBurst = 64;                    // frames taken from one side before the other side
constexpr std::int64_t kBusyWaitNs = 40'000;  // typical lateness of a wake-up with real-time priority
constexpr std::size_t kLateBuckets = 10'001;

std::int64_t monotonic_ns() noexcept {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * INT64_C(1'000'000'000) + now.tv_nsec;
}

/// Returns a percentile by nearest rank, rounded down to a whole microsecond; 0 without frames. Counting by microsecond
/// takes constant memory at any number of frames.
double percentile(const std::vector<std::uint64_t>& buckets, double share) {
  std::uint64_t total = 0;
  for (const std::uint64_t count : buckets) total += count;
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < buckets.size(); ++i) {
    below += buckets[i];
    if (below > 0 && static_cast<double>(below) >= share * static_cast<double>(total)) return static_cast<double>(i);
  }
  return 0;
}

}  // namespace

Relay::Relay(int a, int b, const LinkSettings& settings)
    : taps_{a, b},
      wake_{::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)},
      links_{Link{settings.a_to_b, 2 * settings.seed}, Link{settings.b_to_a, 2 * settings.seed + 1}},
      late_(kLateBuckets, 0) {
  if (wake_ < 0) throw LinkError(std::string{"relay: no eventfd: "} + std::strerror(errno));
}

Relay::~Relay() { ::close(wake_); }

void Relay::run() {
  ::prctl(PR_SET_TIMERSLACK, 1);
  while (!stop_) {
    wait(monotonic_ns());
    const std::lock_guard lock{mutex_};
    receive(0);
    receive(1);
    send_due();
  }
}

void Relay::stop() noexcept {
  stop_ = true;
  const std::uint64_t one = 1;
  (void)!::write(wake_, &one, sizeof one);
}

void Relay::wait(std::int64_t now_ns) {
  timespec timeout{};
  const bool has_departure = !departures_.empty();
  if (has_departure) {
    const std::int64_t sleep = std::max<std::int64_t>(departures_.top().at_ns - now_ns - kBusyWaitNs, 0);
    timeout = {sleep / 1'000'000'000, sleep % 1'000'000'000};
  }
  std::array<pollfd, 3> on{{{taps_[0], POLLIN, 0}, {taps_[1], POLLIN, 0}, {wake_, POLLIN, 0}}};
  ::ppoll(on.data(), on.size(), has_departure ? &timeout : nullptr, nullptr);
}

std::uint32_t Relay::allocate_frame() {
  if (free_.empty()) {
    frames_.emplace_back();
    return static_cast<std::uint32_t>(frames_.size() - 1);
  }
  const std::uint32_t frame = free_.back();
  free_.pop_back();
  return frame;
}

void Relay::receive(int side) {
  for (int taken = 0; taken < kBurst; ++taken) {
    const std::uint32_t index = allocate_frame();
    Frame& frame = frames_[index];
    const ssize_t bytes = ::read(taps_[side], frame.data.data(), frame.data.size());
    if (bytes <= 0) {
      free_.push_back(index);
      return;
    }
    frame.bytes = static_cast<std::uint32_t>(bytes);
    const auto at = links_[side].departure(monotonic_ns(), frame.bytes);
    if (!at) {
      free_.push_back(index);
      continue;
    }
    if (links_[side].is_repeated()) {
      const std::uint32_t copy = allocate_frame();
      frames_[copy] = frame;
      forward(copy, *at, 1 - side);
    }
    forward(index, *at, 1 - side);
  }
}

/// Sends the frame at the given time, unless too many are in transit.
void Relay::forward(std::uint32_t frame, std::int64_t at_ns, int to) {
  if (departures_.size() == kMaxFrames) {
    ++overflowed_;
    free_.push_back(frame);
    return;
  }
  departures_.push({at_ns, order_++, frame, to});
}

void Relay::send_due() {
  while (!departures_.empty()) {
    const Departure next = departures_.top();
    const std::int64_t late = monotonic_ns() - next.at_ns;
    if (late < 0) return;
    departures_.pop();
    const Frame& frame = frames_[next.frame];
    // A tap whose interface is down refuses the frame. The frame is lost, as on an unplugged cable.
    (void)!::write(taps_[next.to], frame.data.data(), frame.bytes);
    free_.push_back(next.frame);
    ++sent_;
    const double late_us = static_cast<double>(late) * 1e-3;
    ++late_[std::min(static_cast<std::size_t>(late_us), kLateBuckets - 1)];
    late_max_us_ = std::max(late_max_us_, late_us);
  }
}

void Relay::set_profiles(const LinkProfile& a_to_b, const LinkProfile& b_to_a) {
  const std::lock_guard lock{mutex_};
  links_[0].set_profile(a_to_b);
  links_[1].set_profile(b_to_a);
}

RelayFigures Relay::figures() const {
  const std::lock_guard lock{mutex_};
  return {links_[0].counts(),      links_[1].counts(),      overflowed_, sent_,
          percentile(late_, 0.50), percentile(late_, 0.99), late_max_us_};
}

}  // namespace tactus::netem
