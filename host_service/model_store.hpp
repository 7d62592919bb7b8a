/// Opens models: `.spm` files directly; other files are built once and cached by their content.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>

#include "spm/offline/model_file.hpp"

namespace tactus::host_service {

/// `$XDG_CACHE_HOME/tactus`, else `~/.cache/tactus`, else a folder in the directory of temporary files.
[[nodiscard]] std::filesystem::path default_cache_directory();

/// `stop` was set before all models were open.
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

  /// Opens a `.spm` file. Imports and builds any other file (seconds to minutes), unless the cache has the result for
  /// the same bytes. Rebuilds a damaged cache entry. Throws spm::offline::ModelError. Throws Stopped within about 20 ms
  /// of `stop`, or once a built model has been written. The importer cannot be interrupted: its thread, which owns
  /// nothing of the caller, may then run on, so end the program without destroying its globals.
  [[nodiscard]] spm::offline::MappedModel open(const std::filesystem::path& model) const;

 private:
  std::filesystem::path cache_;
  Log log_;
  const std::atomic<bool>& stop_;
};

}  // namespace tactus::host_service
