#include "hrtc_service/state_sender.hpp"

#include <algorithm>

#include "session/figures.hpp"

namespace tactus::hrtc_service {

StateSender::StateSender(wire::Participants& participants, double radius, bool uses_deadband,
                         const UserDevices& devices, const RemoteUsers& remote_users, GroupEndpoints& groups)
    : participants_{participants},
      radius_{radius},
      uses_deadband_{uses_deadband},
      devices_{devices},
      remote_users_{remote_users},
      groups_{groups},
      states_out_{participants, wire::topics::kProbeState} {}

void StateSender::send(const ProbeReports& latest, const session::ClockMap& clock) {
  groups_.take_endpoints();
  // A new reader must receive all probes now, not after their next motion. So the coders start anew.
  const int matched_readers = states_out_.matched();
  if (matched_readers > matched_readers_) coders_.fill(ProbeCoder{});
  matched_readers_ = matched_readers;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (!latest.probes[i].active) continue;
    const std::uint64_t user = devices_.user_at(i);
    if (user == 0) continue;
    ProbeCoder& coder = coders_[i];
    if (coder.user != user) coder = ProbeCoder{user, session::ProbeEncoder{}};
    session::ProbeState state = state_of(latest, i, clock);
    state.user_id = user;
    state.sequence = full_rate_numbers_[i] + 1;
    if (groups_.send_full_rate(i, state)) {
      ++full_rate_numbers_[i];
      ++sent_full_rate_;
    }
    coder.encoder.set_loss(remote_users_.loss());
    if (uses_deadband_ && !coder.encoder.step(state)) continue;
    state.sequence = ++deadband_coded_numbers_[i];
    (void)states_out_.send(state);
    ++sent_deadband_coded_;
  }
}

session::ProbeState StateSender::state_of(const ProbeReports& latest, std::uint32_t i,
                                          const session::ClockMap& clock) const {
  const ProbeOutput& probe = latest.probes[i];
  session::ProbeState state;
  state.origin = participants_.origin();
  state.probe = i;
  state.session_time_ns = clock.session_time(latest.time_ns);
  state.time_bound_us =
      static_cast<std::uint32_t>(std::min<std::int64_t>(clock.error_bound(latest.time_ns) / 1000, 0xffffffff));
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

void StateSender::add_figures(std::vector<session::Figure>& figures) const {
  namespace names = session::figures;
  figures.push_back({names::kStatesDeadbandCoded, static_cast<double>(sent_deadband_coded_)});
  figures.push_back({names::kStatesFullRate, static_cast<double>(sent_full_rate_)});
}

}  // namespace tactus::hrtc_service
