/// Opens models. A `.spm` file is opened directly; any other file is built once and cached by its content.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>

#include "spm/offline/model_file.hpp"

namespace tactus::host_service {

/// Returns `$XDG_CACHE_HOME/tactus`, else `~/.cache/tactus`, else a folder in the directory of temporary files.
[[nodiscard]] std::filesystem::path default_cache_directory();

/// Thrown if `stop` is set before all models are open.
class Stopped : public std::runtime_error {
 public:
  Stopped() : std::runtime_error{"stopped by a signal"} {}
};

class ModelStore {
 public:
  /// Receives one line for each event, in the thread that calls `open`.
  using Log = std::function<void(const std::string&)>;

  /// `stop` must outlive the store.
  ModelStore(std::filesystem::path cache, Log log, const std::atomic<bool>& stop);

  /// Opens a `.spm` file. Imports and builds any other file, which takes seconds to minutes, unless the cache contains
  /// the result for the same bytes of the file and of all files that its reader requests. Rebuilds a damaged cache
  /// entry. Throws spm::offline::ModelError.
  ///
  /// If `stop` is set, throws Stopped within about 20 ms, or once a built model has been written. The importer cannot
  /// be interrupted, so its thread may continue after the throw. The thread uses no data of the caller, but it may use
  /// global objects, so end the program without destroying them.
  [[nodiscard]] spm::offline::MappedModel open(const std::filesystem::path& model) const;

 private:
  std::filesystem::path cache_;
  Log log_;
  const std::atomic<bool>& stop_;
};

}  // namespace tactus::host_service
