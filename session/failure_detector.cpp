#include "session/failure_detector.hpp"

#include <algorithm>
#include <cmath>

#include "session/units.hpp"

namespace tactus::session {

void FailureDetector::watch(const std::vector<std::uint64_t>& hosts) {
  for (auto at = hosts_.begin(); at != hosts_.end();) {
    const bool stays = std::find(hosts.begin(), hosts.end(), at->first) != hosts.end();
    at = stays ? std::next(at) : hosts_.erase(at);
  }
  for (const std::uint64_t host : hosts) hosts_.try_emplace(host);
}

std::optional<ClockSample> FailureDetector::next_request(std::int64_t now_ns) {
  for (auto& [id, host] : hosts_) {
    if (host.sequence != 0 && now_ns - host.requested_ns < settings_.period_ns) continue;
    host.requested_ns = now_ns;
    ClockSample request;
    request.origin = self_;
    request.origin.time_ns = now_ns;
    request.peer = id;
    request.sequence = ++host.sequence;
    request.t0_ns = now_ns;
    return request;
  }
  return std::nullopt;
}

void FailureDetector::on_answer(const ClockSample& answer, std::int64_t now_ns) {
  const auto at = hosts_.find(answer.origin.participant);
  if (at == hosts_.end() || !answer.answer || answer.peer != self_.participant ||
      answer.origin.session != self_.session)
    return;
  Watched& host = at->second;
  const bool is_same_program = host.incarnation == answer.origin.incarnation;
  if (is_same_program) {
    const double passed_s = static_cast<double>(now_ns - host.answered_ns) / kNsPerS;
    host.longest_ns *= std::exp2(-passed_s / settings_.half_life_s);
    host.longest_ns = std::max(host.longest_ns, static_cast<double>(host.silence_ns));
    if (host.suspected) ++false_suspicions_;
  }
  host.incarnation = answer.origin.incarnation;
  host.answered_ns = now_ns;
  host.silence_ns = 0;
  host.suspected = false;
}

std::int64_t FailureDetector::timeout_ns(const Watched& host) const noexcept {
  return std::clamp(std::llround(settings_.margin * host.longest_ns), static_cast<long long>(settings_.min_timeout_ns),
                    static_cast<long long>(settings_.max_timeout_ns));
}

bool FailureDetector::all_answered() const noexcept {
  return std::all_of(hosts_.begin(), hosts_.end(), [this](const auto& watched) {
    return watched.second.suspected || watched.second.silence_ns <= settings_.period_ns;
  });
}

std::vector<FailureDetector::Suspect> FailureDetector::take_suspects(std::int64_t now_ns) {
  const std::int64_t passed_ns = std::clamp<std::int64_t>(now_ns - polled_ns_, 0, settings_.max_poll_gap_ns);
  polled_ns_ = now_ns;
  std::vector<Suspect> suspects;
  for (auto& [id, host] : hosts_) {
    if (host.incarnation == 0) continue;
    host.silence_ns += passed_ns;
    if (host.suspected || host.silence_ns < timeout_ns(host)) continue;
    host.suspected = true;
    suspects.push_back({id, host.silence_ns});
  }
  return suspects;
}

}  // namespace tactus::session
