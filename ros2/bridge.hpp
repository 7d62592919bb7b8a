/// Connects a session with a ROS domain: joins the session as a viewer and the domain as a participant, and runs both.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>

#include "spm/pool.hpp"
#include "wire/participants.hpp"

namespace tactus::ros2 {

struct BridgeOptions {
  wire::SessionAddress address;
  spm::PoolSettings pool;       ///< for the meshes of all objects
  int domain = 0;               ///< of ROS
  double rate = 250;            ///< Hz, of probes and poses
  std::string frame = "world";  ///< name of the world frame
  bool takes_targets = true;    ///< false: target poses are ignored
  std::string hrtc;             ///< HRTC that gives probes to users from ROS; empty: the one with the fewest users
  std::function<void(const std::string&)> log;  ///< receives one line for each event
};

class Bridge {
 public:
  /// Joins the session and the ROS domain. Throws wire::WireError.
  explicit Bridge(BridgeOptions options);
  ~Bridge();
  Bridge(const Bridge&) = delete;
  Bridge& operator=(const Bridge&) = delete;

  /// Runs until `stop` is set or an older program has this program's name. Returns the exit status: 0, or 2 if the name
  /// is taken.
  [[nodiscard]] int run(const std::atomic<bool>& stop);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::ros2
