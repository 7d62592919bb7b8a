#include "hrtc_service/remote_users.hpp"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <iterator>

#include "hrtc_service/servo/touch_object.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kSilentNs = 300'000'000;  // silence after which a remote probe is removed
constexpr std::size_t kMaxRemotes = 256;         // probes of all other HRTCs; about 8 MB
constexpr double kMinLoss = 1e-3;                // min published share
// Max loss that repeated states make up for. A larger one means that the link is full, and more states would fill it
// further.
constexpr double kMaxRepairedLoss = 0.35;
constexpr std::int64_t kLossAgeNs = 3'000'000'000;  // time for which a reported loss is valid

std::string loss_figure(std::uint64_t participant) {
  std::array<char, 17> digits{};
  std::snprintf(digits.data(), digits.size(), "%016" PRIx64, participant);
  return session::figures::kLostOf + std::string{digits.data()};
}

}  // namespace

void RemoteUsers::on_state(const session::ProbeState& state, session::StateStream stream, std::int64_t now_ns,
                           std::int64_t session_now_ns) {
  Remote* const found = find_or_add(state, now_ns);
  if (found == nullptr) {
    ++implausible_;
    return;
  }
  Remote& remote = *found;
  const session::Admission admission = remote.probe.on_state(state, stream, session_now_ns);
  if (admission == session::Admission::kImplausible) ++implausible_;
  if (stream == session::StateStream::kFullRate && admission != session::Admission::kImplausible &&
      full_rate_.size() < 2 * kMaxRemotes) {
    FullRate& full_rate = full_rate_[{state.user_id, state.probe}];
    full_rate.participant = state.origin.participant;
    full_rate.check.on_state(state.sequence, session_now_ns - state.session_time_ns, now_ns);
  }
  if (!session::accepted(admission)) return;
  remote.participant = state.origin.participant;
  remote.received_ns = now_ns;
  modes_.on_probe(state.user_id, state.origin.participant, state.device.position, now_ns);
}

/// Returns the remote probe of a state, and adds it if it is new. It then replaces the one with this number at the same
/// HRTC, so each HRTC has at most kMaxProbes. Returns null if the number is too large, or if there are too many in all.
RemoteUsers::Remote* RemoteUsers::find_or_add(const session::ProbeState& state, std::int64_t now_ns) {
  if (state.probe >= kMaxProbes) return nullptr;
  const ProbeKey key{state.user_id, state.probe};
  const auto found = remotes_.find(key);
  if (found != remotes_.end()) return &found->second;
  const std::uint64_t participant = state.origin.participant;
  for (auto at = remotes_.begin(); at != remotes_.end();) {
    const bool is_replaced = at->second.participant == participant && at->first.second == state.probe;
    if (is_replaced) modes_.forget_user(at->first.first);
    at = is_replaced ? remotes_.erase(at) : std::next(at);
  }
  if (remotes_.size() >= kMaxRemotes) return nullptr;
  Remote& remote = remotes_[key];
  remote.participant = participant;
  remote.received_ns = now_ns;
  return &remote;
}

void RemoteUsers::on_metrics(const session::Metrics& metrics, std::int64_t now_ns) {
  const std::string ours = loss_figure(self_), of_full_rate = ours + session::figures::kOfFullRate;
  for (const session::Figure& figure : metrics.figures) {
    if (figure.name == ours) {
      const bool is_repaired = figure.value >= 0 && figure.value <= kMaxRepairedLoss;
      losses_[metrics.origin.participant] = {is_repaired ? figure.value : 0, now_ns};
    }
    if (figure.name == of_full_rate) modes_.pause(now_ns);
  }
}

void RemoteUsers::on_hrtc_gone(std::uint64_t participant) {
  losses_.erase(participant);
  for (auto at = remotes_.begin(); at != remotes_.end();) {
    if (at->second.participant == participant) modes_.forget_user(at->first.first);
    at = at->second.participant == participant ? remotes_.erase(at) : std::next(at);
  }
}

void RemoteUsers::tick(std::int64_t now_ns) {
  for (auto at = remotes_.begin(); at != remotes_.end();)
    at = now_ns - at->second.received_ns > kSilentNs ? remotes_.erase(at) : std::next(at);
  double loss = 0;
  for (auto at = losses_.begin(); at != losses_.end();) {
    if (now_ns - at->second.received_ns > kLossAgeNs) {
      at = losses_.erase(at);
      continue;
    }
    loss = std::max(loss, at->second.share);
    ++at;
  }
  loss_.store(loss, std::memory_order_relaxed);
  check_full_rate(now_ns);
  modes_.tick(now_ns);
}

void RemoteUsers::check_full_rate(std::int64_t now_ns) {
  std::size_t too_slow = 0;
  for (auto at = full_rate_.begin(); at != full_rate_.end();) {
    too_slow += at->second.check.is_too_slow(now_ns) ? 1 : 0;
    at = at->second.check.is_active(now_ns) ? std::next(at) : full_rate_.erase(at);
  }
  const bool is_own_link = too_slow == full_rate_.size();
  if (is_own_link && too_slow > 0) modes_.pause(now_ns);
  for (auto& [key, full_rate] : full_rate_)
    full_rate.reported_share = !is_own_link && full_rate.check.is_too_slow(now_ns) ? full_rate.check.missed_share() : 0;
}

void RemoteUsers::add_figures(std::vector<session::Figure>& figures) const {
  namespace names = session::figures;
  std::int64_t playout_ns = 0;
  for (const auto& [key, remote] : remotes_) playout_ns = std::max(playout_ns, remote.probe.delay_ns());
  figures.push_back({names::kRemoteProbes, static_cast<double>(remotes_.size())});
  figures.push_back({names::kPlayout, static_cast<double>(playout_ns) * 1e-3});
}

std::vector<session::Figure> RemoteUsers::losses() const {
  std::map<std::string, double> lost;
  const auto add = [&lost](const std::string& figure, double share) {
    if (share > kMinLoss) lost[figure] = std::max(lost[figure], share);
  };
  for (const auto& [key, remote] : remotes_) {
    add(loss_figure(remote.participant), remote.probe.lost_share());
  }
  for (const auto& [key, full_rate] : full_rate_)
    add(loss_figure(full_rate.participant) + session::figures::kOfFullRate, full_rate.reported_share);
  std::vector<session::Figure> figures;
  for (const auto& [figure, share] : lost)
    if (figures.size() < session::kMaxFigures) figures.push_back({figure, share});
  return figures;
}

}  // namespace tactus::hrtc_service
