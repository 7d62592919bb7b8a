/// Passes samples between a SimCore and the topics of a session.
///
/// The adapter has one wire::Participants for each HRTC that serves users of this program. One thread runs the core. A
/// queue passes the arriving samples to this thread.
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
  double patience = SimSettings{}.patience;  ///< s, max wait for HRTCs, objects and probes
  std::string mode{};                        ///< SimSettings::mode
};

/// Thrown if an older program in the session has the name of this program.
class NameTaken : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class Sim {
 public:
  /// Joins the session. Throws wire::WireError.
  explicit Sim(SimOptions options);
  ~Sim();

  /// Runs until the scenario ends, or until `stop` is set and the core has ended the session. Calls `log` with a line
  /// whenever the reason for waiting changes. Throws NameTaken; in this case the session continues.
  [[nodiscard]] Report run(const std::atomic<bool>& stop, const std::function<void(const std::string&)>& log);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::client_sim
