#include "netem/link.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::netem {

Link::Link(const LinkProfile& profile, std::uint64_t seed)
    : profile_{profile},
      queue_rate_mbit_{profile.rate_mbit},
      loss_random_{2 * seed},
      jitter_random_{2 * seed + 1},
      repeat_random_{~seed} {}

void Link::set_profile(const LinkProfile& profile) {
  profile_ = profile;
  in_burst_ = false;
}

void Link::adapt_queue(std::int64_t now_ns) {
  const double ratio = profile_.rate_mbit > 0 ? queue_rate_mbit_ / profile_.rate_mbit : 0;
  const std::int64_t backlog_ns = std::max<std::int64_t>(free_ns_ - now_ns, 0);
  free_ns_ = now_ns + std::llround(static_cast<double>(backlog_ns) * ratio);
  queue_rate_mbit_ = profile_.rate_mbit;
}

std::optional<std::int64_t> Link::departure(std::int64_t arrival_ns, std::size_t bytes) {
  ++counts_.arrived;
  // Each frame draws the same number of values, so that the queue and the losses do not change later draws.
  const bool lost = is_lost();
  const std::array<double, 2> noise = jitter_noise();
  is_repeated_ = profile_.repeat > 0 && uniform_(repeat_random_) < profile_.repeat;
  if (queue_rate_mbit_ != profile_.rate_mbit) adapt_queue(arrival_ns);
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
  if (lost) {
    ++counts_.lost;
    return std::nullopt;
  }
  counts_.bytes += bytes;
  counts_.repeated += is_repeated_ ? 1 : 0;
  const double delay_ms = std::max(0.0, profile_.delay_ms + jitter(sent, noise));
  std::int64_t departure = sent + std::llround(delay_ms * 1e6);
  if (!profile_.reorder) departure = std::max(departure, last_departure_ns_);
  last_departure_ns_ = departure;
  return departure;
}

bool Link::is_lost() {
  if (profile_.mean_loss() == 0) return false;
  const double burst = uniform_(loss_random_), single = uniform_(loss_random_);
  in_burst_ = in_burst_ ? burst >= profile_.burst_end : burst < profile_.burst_start;
  return in_burst_ || single < profile_.loss;
}

std::array<double, 2> Link::jitter_noise() {
  if (profile_.jitter_ms == 0) return {};
  const double first = normal_(jitter_random_);
  return {first, profile_.reorder ? 0 : normal_(jitter_random_)};
}

double Link::jitter(std::int64_t at_ns, const std::array<double, 2>& noise) {
  if (profile_.jitter_ms == 0) return 0;
  const auto [first, second] = noise;
  if (profile_.reorder) return profile_.jitter_ms * first;
  // Exact step of a critically damped oscillator that white noise drives. Its position is normally distributed at each
  // time and has a continuous rate of change (Matern process with nu = 3/2). Source: Rasmussen, Williams, Gaussian
  // Processes for Machine Learning, 2006, section 4.2.1.
  if (!has_smooth_jitter_) {
    has_smooth_jitter_ = true;
    smooth_jitter_ = first;
    smooth_jitter_rate_ = second;
  } else {
    // After an increase of the rate, a frame may leave the queue earlier than its predecessor, so `a` would be
    // negative.
    const double a = std::max(0.0, static_cast<double>(at_ns - smooth_jitter_ns_) * 1e-6 / kJitterCorrelationMs);
    const double decay = std::exp(-a);
    const double x = decay * ((1 + a) * smooth_jitter_ + a * smooth_jitter_rate_);
    const double v = decay * ((1 - a) * smooth_jitter_rate_ - a * smooth_jitter_);
    const double var_x = std::max(0.0, 1 - decay * decay * (1 + 2 * a + 2 * a * a));
    const double var_v = std::max(0.0, 1 - decay * decay * (1 - 2 * a + 2 * a * a));
    const double cov = 2 * a * a * decay * decay;
    const double sd_v = std::sqrt(var_v);
    const double part = sd_v > 0 ? cov / sd_v : 0;
    smooth_jitter_rate_ = v + sd_v * first;
    smooth_jitter_ = x + part * first + std::sqrt(std::max(0.0, var_x - part * part)) * second;
  }
  smooth_jitter_ns_ = at_ns;
  return profile_.jitter_ms * smooth_jitter_;
}

}  // namespace tactus::netem
