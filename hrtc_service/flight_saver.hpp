/// Runs the flight recorder of an HRTC: a separate thread holds the last seconds and writes them to a file after an
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

#include "hrtc_service/flight_recorder.hpp"
#include "hrtc_service/flight_store.hpp"

namespace tactus::hrtc_service {

struct FlightOptions {
  double seconds = 30;                                                  ///< recorded; 0: nothing is recorded
  std::uint64_t max_bytes = std::numeric_limits<std::uint64_t>::max();  ///< beyond it the oldest cycles are removed
  std::filesystem::path folder;  ///< of the files that events cause; created when missing
  std::filesystem::path file;    ///< written at the end; empty: none
};

/// Limits the recorder to an eighth of `memory_bytes`, and returns how much of them it takes at most. Where an eighth
/// does not hold a second of all probes, nothing is recorded.
[[nodiscard]] std::uint64_t limit_flight(FlightOptions& options, std::uint64_t memory_bytes, double period,
                                         std::uint32_t probes) noexcept;

class FlightSaver {
 public:
  /// Throws std::runtime_error when `file` cannot be written. Allocates the memory of the haptic thread at once, the
  /// rest during recording, up to `max_bytes()`.
  FlightSaver(const FlightOptions& options, const trace::FlightStart& start, std::uint32_t probes);
  ~FlightSaver();

  /// The observer for the haptic thread's cycle.
  [[nodiscard]] FlightRecorder& recorder() noexcept { return recorder_; }
  [[nodiscard]] std::uint64_t max_bytes() const noexcept { return max_bytes_; }

  /// Called in the thread of the flight recorder, with a line for operators. Set before `start`.
  std::function<void(bool trouble, const std::string&)> on_event;

  /// The objects that the haptic thread touches must exist until `stop`.
  void start();
  /// Requests a file, which is written half a second later, so that it contains the cycles after the event. Events
  /// until then share that file. At most kMaxFiles in a run; files that an operator requests (`asked`) have no limit.
  void save(const std::string& reason, bool requested);
  /// Ends the thread and writes `file`. Call it after the haptic thread has ended. False when writing failed.
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
  std::string reason_;  // of a file that is due
  std::chrono::steady_clock::time_point due_;
  bool ending_ = false;
  std::uint32_t files_ = 0;
  std::uint64_t lost_published_ = 0;
  bool end_published_ = false;
  std::thread thread_;
};

}  // namespace tactus::hrtc_service
