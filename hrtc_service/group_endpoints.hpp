/// Opens and closes the endpoints for full-rate states (session/modes.hpp): a writer and a reader for each group, in
/// the partition of the group.
///
/// Only the service thread may call it, except where a comment names another thread.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "hrtc_service/handover.hpp"
#include "hrtc_service/remote_users.hpp"
#include "hrtc_service/servo/touch_object.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class GroupEndpoints {
 public:
  using OnState = std::function<void(session::ProbeState&&)>;

  /// `on_state` receives the states of all groups, in a thread of DDS. `participants` must outlive this object.
  GroupEndpoints(wire::Participants& participants, OnState on_state);
  ~GroupEndpoints();

  /// Opens the endpoints of new groups, closes those of ended groups, and passes the writers to the sender thread.
  /// `users` returns the groups. `ids`: id of the user of each probe; 0: no user.
  void sync(RemoteUsers& users, const std::array<std::uint64_t, kMaxProbes>& ids);
  /// Returns the number of probes that send full-rate states.
  [[nodiscard]] std::size_t collaborating() const noexcept;

  /// Switches to the newest writers. Call it before the states of each cycle are sent. Sender thread.
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
  Writers full_rate_{};                           // at the last sync; null: the probe's user does not collaborate
  Handover<Writers> full_rate_out_;               // passes `full_rate_` to the sender thread
  const Writers* in_use_ = nullptr;               // writers that the sender thread uses, set by take_endpoints
  DeferredDestruction<Endpoints> dropped_;        // of ended groups, until the sender thread no longer uses them
};

}  // namespace tactus::hrtc_service
