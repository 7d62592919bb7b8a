/// Duration of each stage of a build.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tactus::spm::offline {

/// Records the start of every stage. One thread.
class StageTimes {
 public:
  struct Stage {
    std::string name;
    double seconds = 0;      ///< wall time
    double cpu_seconds = 0;  ///< CPU time of all threads of the process
  };

  /// Starts a stage and ends the previous one, if it is different. The times of a stage that starts again add up.
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

/// Peak resident memory of this process in bytes; 0 if the system does not report it.
[[nodiscard]] double peak_resident_bytes();

}  // namespace tactus::spm::offline
