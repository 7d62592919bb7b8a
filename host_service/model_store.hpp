/// Models ready to serve: `.spm` files as they are, other model files built once and kept by what is in them.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>

#include "spm/offline/model_file.hpp"

namespace tactus::host_service {

/// `$XDG_CACHE_HOME/tactus`, else `~/.cache/tactus`, else a folder among the temporary files.
[[nodiscard]] std::filesystem::path default_cache_directory();

/// `stop` was set before all models were there.
class Stopped : public std::runtime_error {
 public:
  Stopped() : std::runtime_error{"asked to stop"} {}
};

class ModelStore {
 public:
  /// Gets one line for each event worth telling, in the thread that opens.
  using Log = std::function<void(const std::string&)>;

  /// `stop` must outlive the store.
  ModelStore(std::filesystem::path cache, Log log, const std::atomic<bool>& stop);

  /// Opens a `.spm` file; any other is imported and built (seconds to minutes), unless the cache has the result for
  /// the same bytes. What is broken in the cache is built again. Throws spm::offline::ModelError, and Stopped within
  /// about 20 ms of `stop`, or once a built model has been written. A thread without anything of the caller's may then
  /// go on until its importer returns, which nothing can interrupt: end the program without destroying its globals.
  [[nodiscard]] spm::offline::MappedModel open(const std::filesystem::path& model) const;

 private:
  std::filesystem::path cache_;
  Log log_;
  const std::atomic<bool>& stop_;
};

}  // namespace tactus::host_service
