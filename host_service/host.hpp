/// A VE host as a service: a HostCore between the topics of a session, with models from files.
///
///     readers --> inbox --> one thread: HostCore --> writers
///
/// DDS callbacks only fill the inbox. Each HRTC gets bulk writers in a partition of its own when it joins, so an HRTC
/// that hangs does not delay the others. A host never computes the force of a device.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host_service/host_config.hpp"
#include "host_service/host_core.hpp"
#include "wire/participants.hpp"

namespace tactus::host_service {

/// Gets one line for each event; called in the threads of the constructor and of run().
using Log = std::function<void(Severity, const std::string&)>;

struct HostOptions {
  wire::SessionAddress address;
  std::vector<ObjectConfig> objects;
  std::filesystem::path cache;        ///< for models that have to be built
  std::array<double, 3> at{0, 0, 0};  ///< m, position of the first object without a pose; others follow along x
  /// Raises the priority of the calling thread and of the DDS threads once the models are open, if the system allows
  /// it. All HRTCs wait for these few threads; at ordinary priority they would wait longer on a busy machine.
  bool raise_priority = false;
};

class Host {
 public:
  /// Opens or builds every model, then joins the session. Throws HostError, spm::offline::ModelError, wire::WireError.
  /// Throws Stopped (model_store.hpp) when `stop` is set before all models are open. After a throw no other program has
  /// seen this host. `stop` must outlive the host.
  Host(HostOptions options, Log log, const std::atomic<bool>& stop);
  ~Host();

  /// Serves until `stop` is set or the session ends, then leaves within a second. The exit code: 0, or 2 when an older
  /// program of the same name is in the session.
  [[nodiscard]] int run();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::host_service
