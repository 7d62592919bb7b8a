#include "hrtc_service/servo/flight_saver.hpp"

#include <pthread.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <ctime>
#include <stdexcept>

#include "trace/private_file.hpp"

namespace tactus::hrtc_service {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr auto kDrainPeriod = milliseconds{20};
constexpr auto kSaveDelay = milliseconds{500};

/// Returns the number of cycles in a second, the period of recorded states.
std::uint32_t cycles_per_second(const trace::FlightStart& start) {
  return static_cast<std::uint32_t>(std::max(1.0, std::round(1 / start.period)));
}

/// Returns the current time for a file name.
std::string now_text() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  std::array<char, 32> out{};
  std::strftime(out.data(), out.size(), "%Y%m%dT%H%M%SZ", &parts);
  return out.data();
}

/// Throws if another user has made the folder: that user could read the recordings, and let a link lead them to another
/// place.
void check_owner(const std::filesystem::path& folder) {
  struct stat status {};
  if (::stat(folder.c_str(), &status) == 0 && status.st_uid != ::geteuid() && status.st_uid != 0)
    throw std::runtime_error("the folder " + folder.string() +
                             " for flight recordings belongs to another user; name another with --flight-folder");
}

/// Makes a folder that only its owner can read.
void make_private_folder(const std::filesystem::path& folder) {
  namespace fs = std::filesystem;
  if (fs::create_directories(folder)) fs::permissions(folder, fs::perms::owner_all);
  check_owner(folder);
}

}  // namespace

std::uint64_t limit_flight(FlightOptions& options, std::uint64_t memory_bytes, double period,
                           std::uint32_t probes) noexcept {
  if (options.seconds <= 0) return 0;
  options.max_bytes = std::min(FlightStore::bytes_for(options.seconds, period, probes), memory_bytes / 8);
  if (options.max_bytes >= FlightStore::bytes_for(std::min(options.seconds, 1.0), period, probes))
    return options.max_bytes;
  options.seconds = 0;
  return 0;
}

FlightSaver::FlightSaver(const FlightOptions& options, const trace::FlightStart& start, std::uint32_t probes)
    : options_{options},
      participant_{start.participant},
      recorder_{cycles_per_second(start)},
      max_bytes_{std::min(FlightStore::bytes_for(options.seconds, start.period, probes), options.max_bytes)},
      store_{recorder_, start, options.seconds, max_bytes_} {
  check_owner(options.folder);
  if (!options.file.empty()) {
    if (!trace::PrivateFile::can_write(options.file))
      throw std::runtime_error("cannot write the flight recording " + options.file.string() + ": " +
                               std::strerror(errno));
  }
}

FlightSaver::~FlightSaver() {
  options_.file.clear();
  static_cast<void>(stop());
}

void FlightSaver::start() {
  thread_ = std::thread{[this] {
    pthread_setname_np(pthread_self(), "flight");
    run();
  }};
}

void FlightSaver::save(const std::string& reason, bool requested) {
  const std::lock_guard lock{mutex_};
  if (!requested && files_ >= kMaxFiles) return;
  if (reason_.empty()) {
    due_ = steady_clock::now() + kSaveDelay;
    reason_ = reason;
  } else if (reason_.find(reason) == std::string::npos) {
    reason_ += "; " + reason;
  }
}

bool FlightSaver::stop() {
  {
    const std::lock_guard lock{mutex_};
    ending_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
  if (options_.file.empty()) return true;
  const bool written = write(options_.file, "the end");
  options_.file.clear();
  return written;
}

bool FlightSaver::write(const std::filesystem::path& file, const std::string& reason) {
  try {
    if (file.parent_path() == options_.folder)
      make_private_folder(options_.folder);
    else if (file.has_parent_path())
      std::filesystem::create_directories(file.parent_path());
    const std::uint64_t cycles = store_.write(file, reason);
    if (on_event) on_event(false, "flight recording " + file.string() + ": " + std::to_string(cycles) + " cycles");
    return true;
  } catch (const std::exception& error) {
    if (on_event) on_event(true, std::string{"no flight recording: "} + error.what());
    return false;
  }
}

void FlightSaver::run() {
  std::unique_lock lock{mutex_};
  while (!ending_ || !reason_.empty()) {
    wake_.wait_for(lock, kDrainPeriod, [this] { return ending_; });
    std::string reason;
    if (!reason_.empty() && (ending_ || steady_clock::now() >= due_)) {
      reason.swap(reason_);
      ++files_;
    }
    const std::uint32_t number = files_;
    lock.unlock();
    store_.drain();
    if (!reason.empty()) {
      const std::string name = participant_ + "-" + now_text() + "-" + std::to_string(number) + ".mcap";
      static_cast<void>(write(options_.folder / name, reason));
    }
    if (store_.lost() > lost_reported_) {
      lost_reported_ = store_.lost();
      if (on_event)
        on_event(true, "the flight recorder fell behind: " + std::to_string(lost_reported_) + " cycles lost");
    }
    if (recorder_.lost_at_end() != 0 && !is_end_reported_) {
      is_end_reported_ = true;
      if (on_event) on_event(true, "the flight recorder has ended: it fell too far behind");
    }
    lock.lock();
  }
}

}  // namespace tactus::hrtc_service
