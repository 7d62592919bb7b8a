/// A controller's flight recorder as a service runs it: keeps the last seconds in a thread of its own and writes them
/// when something has happened.
#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "hrtc_service/flight_recorder.hpp"
#include "hrtc_service/flight_store.hpp"

namespace tactus::hrtc_service {

struct FlightOptions {
  double seconds = 30;           ///< kept; 0: nothing is recorded
  std::filesystem::path folder;  ///< of files that something gave reason for; made when it is not there
  std::filesystem::path file;    ///< written at the end; empty: none
};

class FlightSaver {
 public:
  /// Throws std::runtime_error when `file` is where none can be written. Allocates what the haptic thread needs; the
  /// rest as it is recorded, up to `max_bytes()`.
  FlightSaver(const FlightOptions& options, const trace::FlightStart& start, std::uint32_t probes);
  ~FlightSaver();

  /// For the haptic thread's cycle.
  [[nodiscard]] FlightRecorder& recorder() noexcept { return recorder_; }
  [[nodiscard]] std::uint64_t max_bytes() const noexcept { return max_bytes_; }

  /// Called in the keeper's thread, with a line for operators. Set before `start`.
  std::function<void(bool trouble, const std::string&)> on_event;

  /// The objects that the haptic thread touches must be there until `stop`.
  void start();
  /// Has a file written half a second from now, so that what follows is in it; what else happens until then goes into
  /// the same. At most kMaxFiles in a run, for what an operator asks for (`asked`) any number.
  void save(const std::string& reason, bool requested);
  /// Ends the thread, and writes the file that is wanted at the end. After the haptic thread's. False when that failed.
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
