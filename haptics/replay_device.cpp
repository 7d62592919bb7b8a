#include "haptics/replay_device.hpp"

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>

namespace tactus::haptics {

namespace {

/// Reads exactly four finite numbers with commas between them.
bool parse(const std::string& line, std::array<double, 4>& numbers) {
  const char* at = line.c_str();
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    char* end = nullptr;
    numbers[i] = std::strtod(at, &end);
    if (end == at || !std::isfinite(numbers[i])) return false;
    at = end + std::strspn(end, " \t\r");
    if (*at != (i + 1 < numbers.size() ? ',' : '\0')) return false;
    ++at;
  }
  return true;
}

}  // namespace

ReplayDevice::ReplayDevice(const std::string& path, const DeviceSpec& spec) : spec_{spec} {
  std::ifstream file{path};
  if (!file) throw DeviceError{"replay " + path + ": cannot be opened: " + std::strerror(errno)};
  std::string line;
  bool names_allowed = true;
  for (std::size_t number = 1; std::getline(file, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos || line[0] == '#') continue;
    std::array<double, 4> values{};
    if (!parse(line, values)) {
      if (names_allowed && line.find_first_of("0123456789") == std::string::npos) {
        names_allowed = false;
        continue;
      }
      throw DeviceError{"replay " + path + ":" + std::to_string(number) + ": found '" + line.substr(0, 80) +
                        "', expected 'time_s,x,y,z'"};
    }
    names_allowed = false;
    if (!poses_.empty() && values[0] <= poses_.back().time) {
      throw DeviceError{"replay " + path + ":" + std::to_string(number) + ": time " + std::to_string(values[0]) +
                        " s is not after the previous time, " + std::to_string(poses_.back().time) + " s"};
    }
    poses_.push_back({values[0], {values[1], values[2], values[3]}});
  }
  if (poses_.empty()) throw DeviceError{"replay " + path + ": found no pose, expected lines 'time_s,x,y,z'"};
}

DeviceState ReplayDevice::read(std::int64_t now_ns) noexcept {
  if (!started_) {
    started_ = true;
    start_ns_ = now_ns;
  }
  const double time = poses_.front().time + static_cast<double>(now_ns - start_ns_) * 1e-9;
  while (next_ < poses_.size() && poses_[next_].time <= time) ++next_;
  DeviceState state;
  state.time_ns = now_ns;
  if (next_ == poses_.size()) {
    ended_ = true;
    state.position = poses_.back().position;
    return state;
  }
  const TimedPosition& after = poses_[next_];
  const TimedPosition& before = poses_[next_ - 1];
  state.velocity = (after.position - before.position) / (after.time - before.time);
  state.position = before.position + state.velocity * (time - before.time);
  return state;
}

}  // namespace tactus::haptics
