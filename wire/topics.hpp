/// The topics of a session, declared once.
#pragma once

#include "session/messages.hpp"
#include "wire/participants.hpp"

namespace tactus::wire {

/// A topic. The QoS profiles of its endpoints are `<profile>_writer` and `<profile>_reader` in the file of its traffic
/// class, for example qos/session.xml.
template <class Sample>
struct TopicSpec {
  const char* name;
  TrafficClass traffic;
  const char* profile;
};

namespace topics {

inline constexpr TopicSpec<session::RosterEntry> kRoster{"tactus_roster", TrafficClass::kSession, "roster"};
inline constexpr TopicSpec<session::CatalogueEntry> kCatalogue{"tactus_catalogue", TrafficClass::kSession, "catalogue"};
inline constexpr TopicSpec<session::Demand> kDemand{"tactus_demand", TrafficClass::kSession, "demand"};
inline constexpr TopicSpec<session::Metrics> kMetrics{"tactus_metrics", TrafficClass::kSession, "metrics"};
inline constexpr TopicSpec<session::ShownRegions> kShownRegions{"tactus_shown_regions", TrafficClass::kSession,
                                                                "shown_regions"};
inline constexpr TopicSpec<session::Control> kControl{"tactus_control", TrafficClass::kSession, "control"};
inline constexpr TopicSpec<session::ForceReset> kReset{"tactus_reset", TrafficClass::kSession, "reset"};
inline constexpr TopicSpec<session::SessionEnd> kEnd{"tactus_end", TrafficClass::kSession, "end"};

inline constexpr TopicSpec<session::BulkChunk> kBase{"tactus_base", TrafficClass::kBulk, "base"};
inline constexpr TopicSpec<session::BulkChunk> kRecords{"tactus_records", TrafficClass::kBulk, "records"};

/// An emergency stop is in the probe class, because the packets and receive threads of that class have priority.
inline constexpr TopicSpec<session::EmergencyStop> kStop{"tactus_stop", TrafficClass::kProbe, "stop"};
inline constexpr TopicSpec<session::ProbeState> kProbeState{"tactus_probe_state", TrafficClass::kProbe, "probe_state"};
/// Full-rate states use the topic of kProbeState with other profiles, in a group's partition (mode `collaborate`).
inline constexpr TopicSpec<session::ProbeState> kProbeStateFullRate{"tactus_probe_state", TrafficClass::kProbe,
                                                                    "probe_state_full_rate"};
inline constexpr TopicSpec<session::DevicePose> kDevicePose{"tactus_device_pose", TrafficClass::kProbe, "device_pose"};
inline constexpr TopicSpec<session::DeviceCommand> kDeviceCommand{"tactus_device_command", TrafficClass::kProbe,
                                                                  "device_command"};
inline constexpr TopicSpec<session::Intent> kIntent{"tactus_intent", TrafficClass::kProbe, "intent"};
inline constexpr TopicSpec<session::ObjectPose> kObjectPose{"tactus_object_pose", TrafficClass::kProbe, "object_pose"};
inline constexpr TopicSpec<session::ObjectClaim> kObjectClaim{"tactus_object_claim", TrafficClass::kProbe,
                                                              "object_claim"};
inline constexpr TopicSpec<session::ObjectGrant> kObjectGrant{"tactus_object_grant", TrafficClass::kProbe,
                                                              "object_grant"};
inline constexpr TopicSpec<session::ObjectCopy> kObjectCopy{"tactus_object_copy", TrafficClass::kProbe, "object_copy"};
/// Clock samples are in the probe class, so that they wait in the same queues as probe states. The times of probe
/// states depend on clock samples.
inline constexpr TopicSpec<session::ClockSample> kClock{"tactus_clock", TrafficClass::kProbe, "clock"};

/// Calls `visit` with every TopicSpec.
template <class Visit>
void for_each(Visit&& visit) {
  visit(kRoster);
  visit(kCatalogue);
  visit(kDemand);
  visit(kMetrics);
  visit(kShownRegions);
  visit(kControl);
  visit(kReset);
  visit(kEnd);
  visit(kBase);
  visit(kRecords);
  visit(kStop);
  visit(kProbeState);
  visit(kProbeStateFullRate);
  visit(kDevicePose);
  visit(kDeviceCommand);
  visit(kIntent);
  visit(kObjectPose);
  visit(kObjectClaim);
  visit(kObjectGrant);
  visit(kObjectCopy);
  visit(kClock);
}

}  // namespace topics
}  // namespace tactus::wire
