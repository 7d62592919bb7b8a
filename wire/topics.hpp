/// The topics of a session, declared once.
#pragma once

#include <type_traits>

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
  /// Samples of one participant that a reader accepts in a second: more than programs send with the largest number of
  /// users, objects and HRTCs, and the largest rates of their options.
  std::uint32_t max_rate;
};

/// Whether samples of this type are sent once. All others are repeated, or replaced by newer ones.
template <class Sample>
inline constexpr bool kIsSentOnce =
    std::is_same_v<Sample, session::CatalogueEntry> || std::is_same_v<Sample, session::Control> ||
    std::is_same_v<Sample, session::SessionEnd>;

/// Whether all samples of a topic are of one DDS instance, see Guarded in dds.hpp.
template <class Sample>
[[nodiscard]] constexpr bool has_one_instance(const TopicSpec<Sample>& topic) noexcept {
  return topic.traffic == TrafficClass::kProbe || std::is_same_v<Sample, session::RosterEntry>;
}

namespace topics {

inline constexpr TopicSpec<session::RosterEntry> kRoster{"tactus_roster", TrafficClass::kSession, "roster", 500};
/// A late joiner receives all entries of a host at once, so its readers accept that many (RateLimit).
inline constexpr TopicSpec<session::CatalogueEntry> kCatalogue{"tactus_catalogue", TrafficClass::kSession, "catalogue",
                                                               8 * 1024};
inline constexpr TopicSpec<session::Demand> kDemand{"tactus_demand", TrafficClass::kSession, "demand", 50'000};
inline constexpr TopicSpec<session::Metrics> kMetrics{"tactus_metrics", TrafficClass::kSession, "metrics", 200};
inline constexpr TopicSpec<session::ShownRegions> kShownRegions{"tactus_shown_regions", TrafficClass::kSession,
                                                                "shown_regions", 5000};
inline constexpr TopicSpec<session::Control> kControl{"tactus_control", TrafficClass::kSession, "control", 200};
inline constexpr TopicSpec<session::ForceReset> kReset{"tactus_reset", TrafficClass::kSession, "reset", 500};
inline constexpr TopicSpec<session::SessionEnd> kEnd{"tactus_end", TrafficClass::kSession, "end", 200};

inline constexpr TopicSpec<session::BulkChunk> kBase{"tactus_base", TrafficClass::kBulk, "base", 1'000'000};
inline constexpr TopicSpec<session::BulkChunk> kRecords{"tactus_records", TrafficClass::kBulk, "records", 1'000'000};

/// An emergency stop is in the probe class, because the packets and receive threads of that class have priority.
inline constexpr TopicSpec<session::EmergencyStop> kStop{"tactus_stop", TrafficClass::kProbe, "stop", 500};
inline constexpr TopicSpec<session::ProbeState> kProbeState{"tactus_probe_state", TrafficClass::kProbe, "probe_state",
                                                            100'000};
/// Full-rate states use the topic of kProbeState with other profiles, in a group's partition (mode `collaborate`).
inline constexpr TopicSpec<session::ProbeState> kProbeStateFullRate{"tactus_probe_state", TrafficClass::kProbe,
                                                                    "probe_state_full_rate", 100'000};
inline constexpr TopicSpec<session::DevicePose> kDevicePose{"tactus_device_pose", TrafficClass::kProbe, "device_pose",
                                                            100'000};
inline constexpr TopicSpec<session::DeviceCommand> kDeviceCommand{"tactus_device_command", TrafficClass::kProbe,
                                                                  "device_command", 100'000};
inline constexpr TopicSpec<session::Intent> kIntent{"tactus_intent", TrafficClass::kProbe, "intent", 20'000};
inline constexpr TopicSpec<session::ObjectPose> kObjectPose{"tactus_object_pose", TrafficClass::kProbe, "object_pose",
                                                            40'000};
inline constexpr TopicSpec<session::ObjectClaim> kObjectClaim{"tactus_object_claim", TrafficClass::kProbe,
                                                              "object_claim", 10'000};
inline constexpr TopicSpec<session::ObjectGrant> kObjectGrant{"tactus_object_grant", TrafficClass::kProbe,
                                                              "object_grant", 10'000};
inline constexpr TopicSpec<session::ObjectCopy> kObjectCopy{"tactus_object_copy", TrafficClass::kProbe, "object_copy",
                                                            100'000};
/// Clock samples are in the probe class, so that they wait in the same queues as probe states. The times of probe
/// states depend on clock samples.
inline constexpr TopicSpec<session::ClockSample> kClock{"tactus_clock", TrafficClass::kProbe, "clock", 20'000};

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
