/// Carries messages between a SimCore and the wire.
///
/// One Participants for each participant that the core plays: one for each HRTC that its users are at. Samples that
/// arrive wait in a queue for the one thread that runs the core.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>

#include "client_sim/sim_core.hpp"
#include "wire/participants.hpp"

namespace tactus::client_sim {

struct SimOptions {
  wire::SessionAddress address;
  Scenario scenario;
  double patience = SimSettings{}.patience;  ///< s to wait for HRTCs, objects and slots
  std::string mode{};                        ///< SimSettings::mode
};

/// An older program in the session has the name of this one.
class NameTaken : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class Sim {
 public:
  /// Joins. Throws wire::WireError.
  explicit Sim(SimOptions options);
  ~Sim();

  /// Until the scenario has run, or `stop` is set and the session has ended in order. `say` gets one line for what it
  /// waits for, whenever that changes. Throws NameTaken; the session goes on then.
  [[nodiscard]] Report run(const std::atomic<bool>& stop, const std::function<void(const std::string&)>& say);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::client_sim
