/// Stores the runs of a study in a folder, so that an interrupted study can continue, and evaluates them over seeds.
#pragma once

#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "study/experiments.hpp"
#include "study/statistics.hpp"

namespace tactus::study {

struct Run {
  std::string scenario, profile;
  std::uint64_t seed = 0;
  Figures figures;
};

/// Locks a file against other FileLocks, of this process and of others, until the end of its life.
class FileLock {
 public:
  /// Makes the file if it is missing. Throws std::runtime_error if it cannot be written or is locked.
  explicit FileLock(const std::filesystem::path& file);
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;
  ~FileLock();

 private:
  int descriptor_;
};

/// Has at most one run of each scenario, link and seed. One thread at a time.
class RunLog {
 public:
  /// Continues with the existing runs. `study` is a line that identifies the study. Throws std::runtime_error when the
  /// folder cannot be written, has runs of another study, or is that of another RunLog.
  RunLog(const std::filesystem::path& folder, const std::string& study);

  [[nodiscard]] bool has(const std::string& scenario, const std::string& profile, std::uint64_t seed) const;
  /// Writes the run to disk before it returns, unless it has the run. Throws std::runtime_error.
  void add(const Run& run);
  [[nodiscard]] const std::vector<Run>& runs() const noexcept { return runs_; }

 private:
  [[nodiscard]] bool append(Run run);

  std::filesystem::path file_;
  FileLock lock_;
  std::ofstream out_;
  std::vector<Run> runs_;
  std::set<std::tuple<std::string, std::string, std::uint64_t>> keys_;  // scenario, link and seed of each run
};

/// Estimates of one figure over the seeds.
struct FigureEstimates {
  std::string name, unit;
  Estimate value;
  Estimate difference;  ///< value minus the baseline's value with the same seed; empty for the baseline itself
};
/// The figures of one experiment over one link.
struct LinkResult {
  std::string scenario, profile;
  Section section = Section::kForces;
  std::vector<FigureEstimates> figures;
};
/// Returns the results in the order of experiments and their links. Omits links without a run.
[[nodiscard]] std::vector<LinkResult> results_by_link(const std::vector<Run>& runs,
                                                      const std::vector<Experiment>& experiments);

/// Returns the name of the file for the trace of the user with this index. Different runs and users have different
/// names: other characters than A-Z, a-z, 0-9, '.', '_' and '-' become '%' and two hexadecimal digits, as in a URL.
[[nodiscard]] std::string trace_file_name(const Run& run, std::size_t user);

/// Writes the file under another name and renames it, so that `file` is never incomplete. Throws std::runtime_error.
void write_file(const std::filesystem::path& file, const std::string& text);

}  // namespace tactus::study
