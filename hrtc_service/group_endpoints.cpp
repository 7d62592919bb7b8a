#include "hrtc_service/group_endpoints.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace tactus::hrtc_service {

GroupEndpoints::GroupEndpoints(wire::Participants& participants, OnState on_state)
    : participants_{participants}, on_state_{std::move(on_state)} {}
GroupEndpoints::~GroupEndpoints() = default;

void GroupEndpoints::sync(RemoteUsers& users, const std::array<std::uint64_t, kMaxProbes>& ids) {
  const std::vector<std::uint64_t> groups = users.groups();
  for (const std::uint64_t group : groups) {
    Endpoints& endpoints = endpoints_[group];
    if (endpoints.writer == nullptr) {
      const wire::EndpointOptions where{wire::group_partition(group)};
      endpoints.writer =
          std::make_unique<wire::Writer<session::ProbeState>>(participants_, wire::topics::kProbeStateFullRate, where);
      endpoints.reader = std::make_unique<wire::Reader<session::ProbeState>>(
          participants_, wire::topics::kProbeStateFullRate, on_state_, where);
      spdlog::info("users near one object: group {:016x} opens", group);
    }
    users.on_peers(group, endpoints.writer->matched() > 0 && endpoints.reader->matched() > 0);
  }
  full_rate_ = {};
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (const std::uint64_t group = ids[i] == 0 ? 0 : users.group_of(ids[i]); group != 0)
      full_rate_[i] = endpoints_.at(group).writer.get();
  const std::uint64_t number = full_rate_out_.post(full_rate_);
  for (auto at = endpoints_.begin(); at != endpoints_.end();) {
    if (std::binary_search(groups.begin(), groups.end(), at->first)) {
      ++at;
      continue;
    }
    if (users.is_paused())
      spdlog::warn("the link is too slow for full-rate states: group {:016x} closes for a time", at->first);
    else
      spdlog::info("users apart: group {:016x} closes", at->first);
    at->second.reader.reset();
    dropped_.add(number, std::move(at->second));
    at = endpoints_.erase(at);
  }
  dropped_.collect([this](std::uint64_t dropped) { return full_rate_out_.is_adopted(dropped); });
}

std::size_t GroupEndpoints::collaborating() const noexcept {
  return static_cast<std::size_t>(
      std::count_if(full_rate_.begin(), full_rate_.end(), [](const auto* writer) { return writer != nullptr; }));
}

bool GroupEndpoints::send_full_rate(std::uint32_t probe, const session::ProbeState& state) {
  wire::Writer<session::ProbeState>* const out = (*in_use_)[probe];
  if (out == nullptr) return false;
  (void)out->send(state);
  return true;
}

}  // namespace tactus::hrtc_service
