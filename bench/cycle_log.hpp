/// Checks every cycle of an HRTC with users while it runs, by its flight recordings.
///
/// Requests a recording every few seconds. Recordings overlap, so together they contain all cycles. A recording is
/// deleted once its cycles are checked.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "tests/support/process.hpp"
#include "trace/flight_file.hpp"

namespace tactus::bench {

/// Checks the forces of successive recordings of one HRTC against its limits.
class ForceChecker {
 public:
  /// Checks the cycles of a recording that no earlier recording contained. Throws trace::FlightError.
  void check(const std::filesystem::path& recording);

  [[nodiscard]] std::uint64_t cycles() const noexcept { return cycles_; }
  /// Number of cycles between two checked cycles that no recording contains.
  [[nodiscard]] std::uint64_t missing() const noexcept { return missing_; }
  /// Number of forces and torques that break a rule: not finite, above the limit, changed faster than the slew limit,
  /// or not zero in spite of a fault or of a pose that is too old; and of cycles whose time is not after that of the
  /// cycle before.
  [[nodiscard]] std::uint64_t violations() const noexcept { return violations_; }
  /// The first violations, one sentence each.
  [[nodiscard]] const std::vector<std::string>& texts() const noexcept { return texts_; }
  /// Largest force and largest change of a force in one cycle, N.
  [[nodiscard]] double max_force() const noexcept { return max_force_; }
  [[nodiscard]] double max_step() const noexcept { return max_step_; }

 private:
  void check(const trace::FlightProbe& probe);
  void check(const trace::FlightTouch& touch);
  /// Returns the change since the cycle before.
  double check(const trace::FlightProbe& probe, const char* what, const std::array<double, 3>& now,
               const std::array<double, 3>& before, double max, double slew);
  void report(std::uint64_t cycle, const std::string& text);

  trace::FlightStart start_;
  std::map<std::uint32_t, trace::FlightProbe> before_;  // by number of the probe: in the last checked cycle with it
  std::uint64_t checked_ = 0;                           // number of the last checked cycle; 0: none
  std::int64_t time_ns_ = 0;                            // of this cycle
  std::uint64_t cycles_ = 0, missing_ = 0, violations_ = 0;
  std::vector<std::string> texts_;
  double max_force_ = 0, max_step_ = 0;
};

/// Requests and checks the recordings of a running HRTC.
class CycleLog {
 public:
  /// Time for which the HRTC stores cycles, s: `--flight-recorder`. It may be suspended for 3 s between two recordings.
  static constexpr int kStored = 8;

  /// The HRTC, started with `--flight-recorder` kStored, must outlive the log.
  explicit CycleLog(e2e::Process& hrtc) : hrtc_{hrtc} {}
  /// Checks the recordings that are complete, and requests the next one. Call it about once a second.
  void poll();
  [[nodiscard]] ForceChecker& checker() noexcept { return checker_; }

 private:
  e2e::Process& hrtc_;
  ForceChecker checker_;
  std::size_t read_ = 0;  // bytes of the HRTC's output
  std::int64_t requested_ns_ = 0;
};

}  // namespace tactus::bench
