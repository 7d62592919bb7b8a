/// Runs the flight recorder of an HRTC: a thread stores the last seconds of cycles, and writes them to a file after an
/// event such as a fault.
#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <mutex>
#include <string>
#include <thread>

#include "hrtc_service/servo/flight_recorder.hpp"
#include "hrtc_service/servo/flight_store.hpp"

namespace tactus::hrtc_service {

struct FlightOptions {
  double seconds = 30;                                                  ///< stored time; 0: nothing is recorded
  std::uint64_t max_bytes = std::numeric_limits<std::uint64_t>::max();  ///< if exceeded, old cycles are dropped
  std::filesystem::path folder;                                         ///< for the files of events; created if missing
  std::filesystem::path file;                                           ///< for the recording at the end; empty: none
};

/// Sets the max memory of the recorder, at most an eighth of `memory_bytes`, and returns it. If a second of cycles with
/// all probes needs more, sets `seconds` to 0 and returns 0. `period`: period of cycles, s.
[[nodiscard]] std::uint64_t limit_flight(FlightOptions& options, std::uint64_t memory_bytes, double period,
                                         std::uint32_t probes) noexcept;

class FlightSaver {
 public:
  /// Allocates the memory that the haptic thread uses. Further memory, up to `max_bytes()`, is allocated during
  /// recording. Leaves `file` as it is. Throws std::runtime_error if `file` cannot be written, or if another user has
  /// made `folder`.
  FlightSaver(const FlightOptions& options, const trace::FlightStart& start, std::uint32_t probes);
  ~FlightSaver();

  /// Returns the observer for the haptic thread's cycle.
  [[nodiscard]] FlightRecorder& recorder() noexcept { return recorder_; }
  [[nodiscard]] std::uint64_t max_bytes() const noexcept { return max_bytes_; }

  /// Called with a line for operators, in the thread of the flight recorder. Set it before `start`.
  std::function<void(bool is_warning, const std::string&)> on_event;

  /// Starts the thread.
  void start();
  /// Requests a file. It is written half a second later, so that it contains the cycles after the event. Further events
  /// in this half second add their reasons to the same file. After kMaxFiles files, ignores all events except requests
  /// of an operator (`requested`).
  void save(const std::string& reason, bool requested);
  /// Ends the thread and writes `file`. Call it after the haptic thread has ended. Returns false if writing failed.
  bool stop();

  static constexpr std::uint32_t kMaxFiles = 20;

 private:
  void run();
  [[nodiscard]] bool write(const std::filesystem::path& file, const std::string& reason);

  FlightOptions options_;
  std::string participant_;
  FlightRecorder recorder_;
  std::uint64_t max_bytes_;
  FlightStore store_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::string reason_;  // reason of the requested file; empty: none requested
  std::chrono::steady_clock::time_point due_;
  bool ending_ = false;
  std::uint32_t files_ = 0;
  std::uint64_t lost_reported_ = 0;
  bool is_end_reported_ = false;
  std::thread thread_;
};

}  // namespace tactus::hrtc_service
