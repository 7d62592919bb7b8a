#include "hrtc_service/neighbours.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "session/figures.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kSilentNs = 300'000'000;    // after which another's probe is gone
constexpr double kMinLoss = 1e-3;                  // that is worth telling
constexpr std::int64_t kMissedNs = 3'000'000'000;  // for which what a controller told of losses counts

std::string lost_figure(std::uint64_t participant) {
  return session::figures::kLostOf + fmt::format("{:016x}", participant);
}

}  // namespace

Neighbours::Neighbours(wire::Participants& participants, OnWhole on_whole)
    : participants_{participants}, on_whole_{std::move(on_whole)}, modes_{participants.origin().participant} {}
Neighbours::~Neighbours() = default;

void Neighbours::on_state(const session::ProbeState& state, session::StateStream stream, std::int64_t now_ns,
                          std::int64_t session_now_ns) {
  Remote& remote = remotes_[{state.user_id, state.probe}];
  const session::Admission admission = remote.probe.on_state(state, stream, session_now_ns);
  if (admission == session::Admission::kImplausible) ++implausible_;
  if (!session::accepted(admission)) return;
  remote.participant = state.origin.participant;
  remote.seen_ns = now_ns;
  modes_.on_probe(state.user_id, state.origin.participant, state.device.position, now_ns);
}

void Neighbours::on_metrics(const session::Metrics& metrics, std::int64_t now_ns) {
  const std::string ours = lost_figure(participants_.origin().participant);
  for (const session::Figure& figure : metrics.figures)
    if (figure.name == ours) missed_[metrics.origin.participant] = {std::clamp(figure.value, 0.0, 0.5), now_ns};
}

void Neighbours::on_controller_gone(std::uint64_t participant) {
  missed_.erase(participant);
  for (auto at = remotes_.begin(); at != remotes_.end();) {
    if (at->second.participant == participant) modes_.forget(at->first.first);
    at = at->second.participant == participant ? remotes_.erase(at) : std::next(at);
  }
}

void Neighbours::tick(std::int64_t now_ns, const std::array<std::uint64_t, kMaxProbes>& users) {
  for (auto at = remotes_.begin(); at != remotes_.end();)
    at = now_ns - at->second.seen_ns > kSilentNs ? remotes_.erase(at) : std::next(at);
  double loss = 0;
  for (auto at = missed_.begin(); at != missed_.end();) {
    loss = std::max(loss, at->second.share);
    at = now_ns - at->second.published_ns > kMissedNs ? missed_.erase(at) : std::next(at);
  }
  loss_.store(loss, std::memory_order_relaxed);
  modes_.tick(now_ns);
  sync_endpoints(users);
}

void Neighbours::sync_endpoints(const std::array<std::uint64_t, kMaxProbes>& users) {
  const std::vector<std::uint64_t> groups = modes_.groups();
  for (const std::uint64_t group : groups) {
    Endpoints& endpoints = endpoints_[group];
    if (endpoints.out == nullptr) {
      const wire::EndpointOptions where{wire::group_partition(group)};
      endpoints.out =
          std::make_unique<wire::Writer<session::ProbeState>>(participants_, wire::topics::kProbeStateFullRate, where);
      endpoints.in = std::make_unique<wire::Reader<session::ProbeState>>(
          participants_, wire::topics::kProbeStateFullRate, on_whole_, where);
      spdlog::info("users come near: ends of group {:016x} are built", group);
    }
    modes_.on_peers(group, endpoints.out->matched() > 0 && endpoints.in->matched() > 0);
  }
  Whole whole{};
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const std::uint64_t group = users[i] == 0 ? 0 : modes_.group_of(users[i]);
    whole[i] = group == 0 ? nullptr : endpoints_.at(group).out.get();
  }
  whole_ = whole;
  const std::uint64_t number = whole_out_.post(whole_);
  for (auto at = endpoints_.begin(); at != endpoints_.end();) {
    const bool wanted = std::binary_search(groups.begin(), groups.end(), at->first);
    if (wanted) {
      ++at;
      continue;
    }
    spdlog::info("users are apart: ends of group {:016x} are dropped", at->first);
    at->second.in.reset();
    dropped_.add(number, std::move(at->second));
    at = endpoints_.erase(at);
  }
  dropped_.collect([this](std::uint64_t dropped) { return whole_out_.passed(dropped); });
}

bool Neighbours::send_full_rate(std::uint32_t probe, const session::ProbeState& state) {
  wire::Writer<session::ProbeState>* const out = (*in_use_)[probe];
  if (out == nullptr) return false;
  (void)out->send(state);
  return true;
}

void Neighbours::write(std::vector<session::Figure>& figures) const {
  namespace names = session::figures;
  std::int64_t playout_ns = 0;
  for (const auto& [key, remote] : remotes_) playout_ns = std::max(playout_ns, remote.probe.delay_ns());
  figures.push_back({names::kRemoteProbes, static_cast<double>(remotes_.size())});
  figures.push_back({names::kPlayout, static_cast<double>(playout_ns) * 1e-3});
  figures.push_back({names::kTogether, static_cast<double>(std::count_if(whole_.begin(), whole_.end(),
                                                                         [](auto* end) { return end != nullptr; }))});
}

std::vector<session::Figure> Neighbours::losses() const {
  std::map<std::uint64_t, double> lost;
  for (const auto& [key, remote] : remotes_) {
    const double share = remote.probe.lost();
    if (share > kMinLoss) lost[remote.participant] = std::max(lost[remote.participant], share);
  }
  std::vector<session::Figure> figures;
  for (const auto& [participant, share] : lost)
    if (figures.size() < session::kMaxFigures) figures.push_back({lost_figure(participant), share});
  return figures;
}

}  // namespace tactus::hrtc_service
