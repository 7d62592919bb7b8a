#include "netem/link.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::netem {

Link::Link(const LinkProfile& profile, std::uint64_t seed)
    : profile_{profile}, loss_random_{2 * seed}, jitter_random_{2 * seed + 1} {}

std::optional<std::int64_t> Link::departure(std::int64_t arrival_ns, std::size_t bytes) {
  ++counts_.arrived;
  std::int64_t sent = arrival_ns;
  if (profile_.rate_mbit > 0) {
    const double ns_per_byte = 8e3 / profile_.rate_mbit;
    const double waiting = static_cast<double>(std::max<std::int64_t>(free_ns_ - arrival_ns, 0)) / ns_per_byte;
    if (waiting + static_cast<double>(bytes) > profile_.queue_bytes) {
      ++counts_.dropped;
      return std::nullopt;
    }
    sent = std::max(free_ns_, arrival_ns) + std::llround(static_cast<double>(bytes) * ns_per_byte);
    free_ns_ = sent;
  }
  if (loses()) {
    ++counts_.lost;
    return std::nullopt;
  }
  counts_.bytes += bytes;
  const double delay_ms = std::max(0.0, profile_.delay_ms + jitter(sent));
  std::int64_t departure = sent + std::llround(delay_ms * 1e6);
  if (!profile_.reorder) departure = std::max(departure, last_departure_ns_);
  last_departure_ns_ = departure;
  return departure;
}

bool Link::loses() {
  if (profile_.mean_loss() == 0) return false;
  const double burst = share_(loss_random_),
               single = share_(loss_random_);  // each frame draws both, so losses do not shift the sequence
  in_burst_ = in_burst_ ? burst >= profile_.burst_end : burst < profile_.burst_start;
  return in_burst_ || single < profile_.loss;
}

double Link::jitter(std::int64_t at_ns) {
  if (profile_.jitter_ms == 0) return 0;
  if (profile_.reorder) return profile_.jitter_ms * normal_(jitter_random_);
  // A critically damped oscillator driven by white noise, stepped exactly over the time passed: normal at every moment,
  // with a bounded rate of change. Rasmussen, Williams, Gaussian Processes for Machine Learning, 2006, section 4.2.1
  // (Matern, nu = 3/2).
  const double first = normal_(jitter_random_), second = normal_(jitter_random_);
  if (!started_) {
    started_ = true;
    wander_ = first;
    wander_speed_ = second;
  } else {
    const double a = static_cast<double>(at_ns - wander_ns_) * 1e-6 / kJitterMemoryMs;
    const double fade = std::exp(-a);
    const double x = fade * ((1 + a) * wander_ + a * wander_speed_);
    const double v = fade * ((1 - a) * wander_speed_ - a * wander_);
    const double var_x = std::max(0.0, 1 - fade * fade * (1 + 2 * a + 2 * a * a));
    const double var_v = std::max(0.0, 1 - fade * fade * (1 - 2 * a + 2 * a * a));
    const double cov = 2 * a * a * fade * fade;
    const double sd_v = std::sqrt(var_v);
    const double part = sd_v > 0 ? cov / sd_v : 0;
    wander_speed_ = v + sd_v * first;
    wander_ = x + part * first + std::sqrt(std::max(0.0, var_x - part * part)) * second;
  }
  wander_ns_ = at_ns;
  return profile_.jitter_ms * wander_;
}

}  // namespace tactus::netem
