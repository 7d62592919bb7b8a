/// How long each stage of a build took.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tactus::spm::offline {

/// Told of every stage as it begins; one thread.
class StageTimes {
 public:
  struct Stage {
    std::string name;
    double seconds = 0;      ///< on the wall
    double cpu_seconds = 0;  ///< of all threads of the process
  };

  /// Ends the stage before, unless it is the same; a stage that comes again goes on where it stopped.
  void begin(std::string_view stage);
  /// Ends the last stage.
  void end();

  [[nodiscard]] const std::vector<Stage>& stages() const noexcept { return stages_; }
  [[nodiscard]] Stage sum() const;

 private:
  std::vector<Stage> stages_;
  std::size_t at_ = 0;
  bool running_ = false;
  double since_ = 0, cpu_since_ = 0;
};

/// The most memory that this process has had resident so far, in bytes; 0 when the system does not tell.
[[nodiscard]] double peak_resident_bytes();

}  // namespace tactus::spm::offline
