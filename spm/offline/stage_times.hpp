/// Measures the duration of each stage of a build.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tactus::spm::offline {

/// A stopwatch with one sum for each stage. One thread.
class StageTimes {
 public:
  struct Stage {
    std::string name;
    double seconds = 0;      ///< wall time, s
    double cpu_seconds = 0;  ///< CPU time of all threads of the process, s
  };

  /// Ends the running stage and starts `stage`; does nothing if `stage` is running. If a stage starts again, its times
  /// add up.
  void begin(std::string_view stage);
  /// Ends the running stage.
  void end();

  [[nodiscard]] const std::vector<Stage>& stages() const noexcept { return stages_; }
  /// The sum of all stages, under the name "all".
  [[nodiscard]] Stage sum() const;

 private:
  std::vector<Stage> stages_;
  std::size_t at_ = 0;  // index of the running stage
  bool running_ = false;
  double since_ = 0, cpu_since_ = 0;  // wall time and CPU time at the start of the running stage, s
};

/// Maximum resident memory of this process so far, in bytes; 0 if the system does not report it.
[[nodiscard]] double peak_resident_bytes();

}  // namespace tactus::spm::offline
