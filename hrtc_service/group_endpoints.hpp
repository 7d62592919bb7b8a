/// Opens and closes the endpoints for full-rate states (session/modes.hpp): a writer and a reader for each group, in
/// the partition of the group.
///
/// Service thread, unless a comment names another one.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "hrtc_service/handover.hpp"
#include "hrtc_service/remote_users.hpp"
#include "hrtc_service/touch_object.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class GroupEndpoints {
 public:
  using OnState = std::function<void(session::ProbeState&&)>;

  /// `on_state` receives the states of all groups, in a thread of DDS. `participants` must outlive the endpoints.
  GroupEndpoints(wire::Participants& participants, OnState on_state);
  ~GroupEndpoints();

  /// Opens and closes endpoints according to the groups of `users`. `ids`: ids of this HRTC's users by probe, 0: none.
  void sync(RemoteUsers& users, const std::array<std::uint64_t, kMaxProbes>& ids);
  /// Returns the number of probes whose states are sent at full rate.
  [[nodiscard]] std::size_t collaborating() const noexcept;

  /// Adopts the newest endpoints. Call it before the states of each cycle. Sender thread.
  void take_endpoints() noexcept { in_use_ = &full_rate_out_.latest(); }
  /// Sends the state if the probe's user collaborates, else returns false. Sender thread. Takes no lock.
  bool send_full_rate(std::uint32_t probe, const session::ProbeState& state);

 private:
  struct Endpoints {
    std::unique_ptr<wire::Writer<session::ProbeState>> writer;
    std::unique_ptr<wire::Reader<session::ProbeState>> reader;
  };
  using Writers = std::array<wire::Writer<session::ProbeState>*, kMaxProbes>;  // by probe

  wire::Participants& participants_;
  OnState on_state_;
  std::map<std::uint64_t, Endpoints> endpoints_;  // by group
  Writers full_rate_{};
  Handover<Writers> full_rate_out_;  // to the sender
  const Writers* in_use_ = nullptr;  // writers of the sender since take_endpoints
  Retired<Endpoints> dropped_;       // until the sender no longer uses them
};

}  // namespace tactus::hrtc_service
