/// Models ready to serve: `.spm` files as they are, other model files built once and kept by what is in them.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "spm/offline/model_file.hpp"

namespace tactus::host_service {

/// `$XDG_CACHE_HOME/tactus`, else `~/.cache/tactus`, else a folder among the temporary files.
[[nodiscard]] std::filesystem::path default_cache_directory();

class ModelStore {
 public:
  /// Gets one line for each event worth telling.
  using Log = std::function<void(const std::string&)>;

  ModelStore(std::filesystem::path cache, Log log);

  /// Opens a `.spm` file; any other is imported and built (seconds to minutes), unless the cache has the result for
  /// the same bytes. What is broken in the cache is built again. Throws spm::offline::ModelError.
  [[nodiscard]] spm::offline::MappedModel open(const std::filesystem::path& model) const;

 private:
  std::filesystem::path cache_;
  Log log_;
};

}  // namespace tactus::host_service
