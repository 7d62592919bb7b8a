/// Runs a VE host as a service: connects a HostCore to the topics of a session, and opens its models.
///
///     readers --> inbox --> one thread: HostCore --> writers
///
/// DDS callbacks only fill the inbox. When an HRTC joins, it gets bulk writers in a partition of its own, so an HRTC
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

/// Receives one line for each event, in the threads that call the constructor and run().
using Log = std::function<void(session::Severity, const std::string&)>;

struct HostOptions {
  wire::SessionAddress address;
  std::vector<ObjectConfig> objects;
  std::filesystem::path cache;        ///< for models that have to be built
  std::array<double, 3> at{0, 0, 0};  ///< m, position of the first object without a pose; others follow along x
  /// True: once the models are open, raises the priority of the calling thread and of the DDS threads, if the system
  /// allows it. All HRTCs wait for these few threads; on a busy machine, threads of ordinary priority would be slower.
  bool raise_priority = false;
};

class Host {
 public:
  /// Opens or builds all models, and then joins the session. Throws HostError, spm::offline::ModelError or
  /// wire::WireError, and Stopped (model_store.hpp) if `stop` is set before all models are open. If it throws, no other
  /// program has discovered this host. `stop` must outlive the host.
  Host(HostOptions options, Log log, const std::atomic<bool>& stop);
  ~Host();

  /// Serves until `stop` is set or the session ends, and then leaves within a second. Returns the exit status of the
  /// program: 0, or 2 if an older program with the same name is in the session.
  [[nodiscard]] int run();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::host_service
