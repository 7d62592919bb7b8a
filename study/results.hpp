/// The runs of a study in a folder, one line each, so that an interrupted study can continue; and their cells.
///
/// Not realtime.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "study/experiments.hpp"
#include "study/statistics.hpp"

namespace tactus::study {

struct Run {
  std::string scenario, profile;
  std::uint64_t seed = 0;
  Figures figures;
};

/// One thread at a time.
class RunLog {
 public:
  /// Continues with the existing runs. `study`: a line that identifies the study. Throws std::runtime_error when the
  /// folder cannot be written or has runs of another study.
  RunLog(const std::filesystem::path& folder, const std::string& study);

  [[nodiscard]] bool has(const std::string& scenario, const std::string& profile, std::uint64_t seed) const;
  /// The run is on disk when it returns. Throws std::runtime_error.
  void add(const Run& run);
  [[nodiscard]] const std::vector<Run>& runs() const noexcept { return runs_; }

 private:
  std::filesystem::path file_;
  std::ofstream out_;
  std::vector<Run> runs_;
};

/// A figure over the seeds of a cell.
struct CellFigure {
  std::string name, unit;
  Estimate value;
  Estimate difference;  ///< from the baseline's run of the same seed; empty in the baseline's own cell
};
struct Cell {
  std::string scenario, profile;
  Topic topic = Topic::kForces;
  std::vector<CellFigure> figures;
};
/// In the order of experiments and their links, without those that have no run.
[[nodiscard]] std::vector<Cell> cells_of(const std::vector<Run>& runs, const std::vector<Experiment>& experiments);

/// Writes a file beside `file` and renames it. Throws std::runtime_error.
void write_file(const std::filesystem::path& file, const std::string& text);

}  // namespace tactus::study
