/// Another process of tactus-latency, and the channel to it.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "latency/channel.hpp"
#include "netem/pair.hpp"

namespace tactus::latency {

class Helper {
 public:
  using Start = std::function<pid_t(std::vector<std::string>)>;

  /// Starts `program serve` with `options`, in the caller's namespace unless `start` does otherwise. Without a path the
  /// program is in the directory of the running one. `stop` must outlive this. Throws LatencyError and LinkError.
  Helper(const std::string& program, const std::vector<std::string>& options, const std::atomic<bool>& stop,
         const Start& start = netem::start_program);
  /// Ends the process; first by SIGINT, so that it removes its shared memory.
  ~Helper();
  Helper(const Helper&) = delete;
  Helper& operator=(const Helper&) = delete;

  [[nodiscard]] Channel& channel() noexcept { return channel_; }

 private:
  Helper(const std::string& program, const std::vector<std::string>& options, const std::atomic<bool>& stop,
         const Start& start, std::pair<int, int> ends);

  Channel channel_;
  pid_t pid_;
};

}  // namespace tactus::latency
