/// Publishes the states of this HRTC's probes: full-rate states to users who collaborate, deadband-coded states to the
/// session.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "hrtc_service/group_endpoints.hpp"
#include "hrtc_service/servo/servo_link.hpp"
#include "hrtc_service/user_devices.hpp"
#include "session/clock.hpp"
#include "session/probe_coding.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class StateSender {
 public:
  /// `radius`: radius of the tips, m. `uses_deadband` false: the session receives every state. All references must
  /// outlive the sender.
  StateSender(wire::Participants& participants, double radius, bool uses_deadband, const UserDevices& devices,
              const RemoteUsers& remote_users, GroupEndpoints& groups);

  /// Sends the states in `latest`, the newest reports. `clock` maps local time to session time. Sender thread.
  void send(const ProbeReports& latest, const session::ClockMap& clock);

  /// Sets the id by which states name the object with this index. 0: the servo has removed the object. Service thread.
  void set_object_id(std::uint32_t index, std::uint64_t id) noexcept { object_ids_[index] = id; }
  /// Appends the numbers of sent states. Any thread.
  void add_figures(std::vector<session::Figure>& figures) const;

 private:
  struct ProbeCoder {
    std::uint64_t user = 0;  // id
    session::ProbeEncoder encoder{};
  };

  [[nodiscard]] session::ProbeState state_of(const ProbeReports& latest, std::uint32_t probe,
                                             const session::ClockMap& clock) const;

  const wire::Participants& participants_;
  const double radius_;
  const bool uses_deadband_;
  const UserDevices& devices_;
  const RemoteUsers& remote_users_;
  GroupEndpoints& groups_;
  wire::Writer<session::ProbeState> states_out_;
  std::array<std::atomic<std::uint64_t>, kMaxObjects> object_ids_{};
  std::atomic<std::uint64_t> sent_deadband_coded_{0}, sent_full_rate_{0};

  // Sender thread only.
  int matched_readers_ = 0;  // readers of the session's states at the last `send`
  std::array<ProbeCoder, kMaxProbes> coders_;
  // Sequence numbers of the last states, by probe.
  std::array<std::uint32_t, kMaxProbes> deadband_coded_numbers_{}, full_rate_numbers_{};
};

}  // namespace tactus::hrtc_service
