/// Publishes the probes here: full-rate states to users who collaborate, deadband-coded states to the session.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "hrtc_service/group_endpoints.hpp"
#include "hrtc_service/haptic_thread.hpp"
#include "hrtc_service/user_devices.hpp"
#include "session/clock.hpp"
#include "session/probe_coding.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class StateSender {
 public:
  /// `radius`: of the tips, m. `coding`: deadband-coded states for the session; false: all states. The arguments that
  /// are references must outlive it.
  StateSender(wire::Participants& participants, double radius, bool coding, const UserDevices& devices,
              const RemoteUsers& remote_users, GroupEndpoints& groups);

  /// Sender's thread. `map`: session time of `latest`.
  void send(const ProbeReports& latest, const session::ClockMap& map);

  /// Service thread: adds the object of this index, so that states can name it. `id` 0: the servo has removed it.
  void on_object(std::uint32_t index, std::uint64_t id) noexcept { object_ids_[index] = id; }
  /// Any thread.
  void write(std::vector<session::Figure>& figures) const;

 private:
  struct Coder {
    std::uint64_t user = 0;
    session::ProbeEncoder encoder{};
  };

  [[nodiscard]] session::ProbeState state_of(const ProbeReports& latest, std::uint32_t probe,
                                             const session::ClockMap& map) const;

  const wire::Participants& participants_;
  const double radius_;
  const bool coding_;
  const UserDevices& devices_;
  const RemoteUsers& remote_users_;
  GroupEndpoints& groups_;
  wire::Writer<session::ProbeState> out_;
  std::array<std::atomic<std::uint64_t>, kMaxObjects> object_ids_{};
  std::atomic<std::uint64_t> sent_deadband_coded_{0}, sent_full_rate_{0};

  // The sender's own.
  int matched_ = 0;
  std::array<Coder, kMaxProbes> coders_;
  std::array<std::uint32_t, kMaxProbes> deadband_coded_{}, full_rate_{};  // numbers given
};

}  // namespace tactus::hrtc_service
