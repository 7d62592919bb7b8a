/// Exchanges the membership samples of a host and an HRTC without delay.
#pragma once

#include "host_service/host_core.hpp"
#include "hrtc_service/membership.hpp"

namespace tactus::study {

/// Ticks the host and delivers roster entries, clock samples, and the catalogue if the host publishes it. Drops all
/// other samples of both. Call every few milliseconds, after the ticks of the HRTC.
inline void exchange_membership(host_service::HostCore& host, hrtc_service::Membership& hrtc, std::int64_t now_ns) {
  const host_service::HostMessages& messages = host.tick(now_ns);
  if (messages.roster) hrtc.on_roster(*messages.roster, now_ns);
  if (messages.catalogue)
    for (const session::CatalogueEntry& entry : host.catalogue()) hrtc.on_catalogue(entry);
  if (messages.clock_request) hrtc.on_clock(*messages.clock_request, now_ns, now_ns);
  if (const auto request = hrtc.clock_request(now_ns))
    if (const auto answer = host.on_clock(request->sample, now_ns, now_ns)) hrtc.on_clock(*answer, now_ns, now_ns);
  for (const session::ClockSample& answer : hrtc.output.clock) (void)host.on_clock(answer, now_ns, now_ns);
  if (hrtc.output.roster) host.on_roster(*hrtc.output.roster, now_ns);
  hrtc.output.clear();
}

}  // namespace tactus::study
