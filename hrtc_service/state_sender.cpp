#include "hrtc_service/state_sender.hpp"

#include <algorithm>

#include "session/figures.hpp"

namespace tactus::hrtc_service {

StateSender::StateSender(wire::Participants& participants, double radius, bool coding, const UserDevices& devices,
                         const RemoteUsers& remote_users, GroupEndpoints& groups)
    : participants_{participants},
      radius_{radius},
      coding_{coding},
      devices_{devices},
      remote_users_{remote_users},
      groups_{groups},
      out_{participants, wire::topics::kProbeState} {}

void StateSender::send(const ProbeReports& latest, const session::ClockMap& map) {
  groups_.take_endpoints();
  // A participant that was just found must receive the probes now, not after their next motion.
  const int matched = out_.matched();
  if (matched > matched_) coders_.fill(Coder{});
  matched_ = matched;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (!latest.probes[i].active) continue;
    const std::uint64_t user = devices_.user_at(i);
    if (user == 0) continue;
    Coder& coder = coders_[i];
    if (coder.user != user) coder = Coder{user, session::ProbeEncoder{}};
    session::ProbeState state = state_of(latest, i, map);
    state.user_id = user;
    state.sequence = full_rate_[i] + 1;
    if (groups_.send_full_rate(i, state)) {
      ++full_rate_[i];
      ++sent_full_rate_;
    }
    coder.encoder.set_loss(remote_users_.loss());
    if (coding_ && !coder.encoder.step(state)) continue;
    state.sequence = ++deadband_coded_[i];
    (void)out_.send(state);
    ++sent_deadband_coded_;
  }
}

session::ProbeState StateSender::state_of(const ProbeReports& latest, std::uint32_t i,
                                          const session::ClockMap& map) const {
  const ProbeOutput& probe = latest.probes[i];
  session::ProbeState state;
  state.origin = participants_.origin();
  state.probe = i;
  state.session_time_ns = map.session_time(latest.time_ns);
  state.time_bound_us =
      static_cast<std::uint32_t>(std::min<std::int64_t>(map.bound(latest.time_ns) / 1000, 0xffffffff));
  state.device.position = probe.device;
  state.proxy = probe.proxy;
  state.velocity = probe.velocity;
  state.force = probe.force;
  state.radius = radius_;
  state.object_id = probe.object < kMaxObjects ? object_ids_[probe.object].load(std::memory_order_relaxed) : 0;
  state.status = probe.status;
  state.error_bound = probe.error_bound;
  state.data_age_us = age_us(probe);
  state.stiffness = probe.stiffness;
  return state;
}

void StateSender::write(std::vector<session::Figure>& figures) const {
  namespace names = session::figures;
  figures.push_back({names::kStatesDeadbandCoded, static_cast<double>(sent_deadband_coded_)});
  figures.push_back({names::kStatesFullRate, static_cast<double>(sent_full_rate_)});
}

}  // namespace tactus::hrtc_service
