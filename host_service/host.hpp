/// A VE host as a service: a HostCore between the topics of a session, with models from files.
///
///     readers --> inbox --> one thread: HostCore --> writers
///
/// The callbacks of DDS only fill the inbox. Each HRTC has its own bulk writers in its own partition, made when it
/// joins, so a frozen one holds up nobody else. Never computes a force.
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
  std::array<double, 3> at{0, 0, 0};  ///< m, where the first object without a pose stands; others follow along x
  /// From when the models are there, the calling thread and the threads of DDS get more of a short machine than others,
  /// where that is allowed. All controllers wait for these few, and where a crowd of them shares the machine, equal
  /// shares would leave each waiting.
  bool before_others = false;
};

class Host {
 public:
  /// Opens or builds every model, then joins the session. Throws HostError, spm::offline::ModelError, wire::WireError
  /// or, when `stop` is set meanwhile, Stopped of model_store.hpp; then nobody has seen it. `stop` must outlive it.
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
