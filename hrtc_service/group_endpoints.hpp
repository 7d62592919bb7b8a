/// The DDS endpoints through which users near one object exchange full-rate states (session/modes.hpp): a writer and a
/// reader for each group, in a partition of its own.
///
/// The service's thread, but for what says otherwise.
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

  /// `on_state` gets what arrives in a group, in a thread of DDS. `participants` must outlive it.
  GroupEndpoints(wire::Participants& participants, OnState on_state);
  ~GroupEndpoints();

  /// Opens and closes endpoints as the groups of `users` say. `ids`: of our users by probe, 0 where there is none.
  void sync(RemoteUsers& users, const std::array<std::uint64_t, kMaxProbes>& ids);
  /// Probes here whose states go out at full rate.
  [[nodiscard]] std::size_t collaborating() const noexcept;

  /// Sender's thread, before the states of each cycle: from now on it uses the newest endpoints only.
  void take_endpoints() noexcept { in_use_ = &full_rate_out_.latest(); }
  /// Sender's thread: sends the state if the probe's user collaborates; false when it does not. Takes no lock.
  bool send_full_rate(std::uint32_t probe, const session::ProbeState& state);

 private:
  struct Endpoints {
    std::unique_ptr<wire::Writer<session::ProbeState>> out;
    std::unique_ptr<wire::Reader<session::ProbeState>> in;
  };
  using Writers = std::array<wire::Writer<session::ProbeState>*, kMaxProbes>;  // by probe

  wire::Participants& participants_;
  OnState on_state_;
  std::map<std::uint64_t, Endpoints> endpoints_;  // by group
  Writers full_rate_{};
  Handover<Writers> full_rate_out_;  // to the sender
  const Writers* in_use_ = nullptr;  // the sender's, since take_endpoints
  Retired<Endpoints> dropped_;       // until the sender no longer uses them
};

}  // namespace tactus::hrtc_service
