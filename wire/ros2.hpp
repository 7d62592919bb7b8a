/// Topics in a DDS domain of ROS 2: writers and readers of encoded messages, which need no ROS.
///
/// ROS 2 maps names to DDS: topic `/tactus/tf` is `rt/tactus/tf`, and type `tf2_msgs/msg/TFMessage` is
/// `tf2_msgs::msg::dds_::TFMessage_`. Each endpoint has the hash of its type in USER_DATA. Sources: REP 2016, and
/// namespace_prefix.cpp of rmw_fastrtps.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "wire/error.hpp"

namespace tactus::wire {

struct RosType {
  const char* name;  ///< in DDS
  const char* hash;  ///< RIHS01_ and 64 hexadecimal digits
};

/// Max domain of ROS 2: the ports of higher domains do not exist.
inline constexpr int kMaxRosDomain = 232;

/// A participant in a domain of ROS. Must outlive its endpoints. One in a process, because Fast DDS has one table of
/// profiles. Not while another thread constructs a Participants.
class RosDomain {
 public:
  /// Joins `domain` with the profiles of `qos`/ros2.xml. Throws WireError with the file, the domain and the library's
  /// message.
  RosDomain(int domain, const std::filesystem::path& qos);
  ~RosDomain();
  RosDomain(const RosDomain&) = delete;
  RosDomain& operator=(const RosDomain&) = delete;

  /// Topic and type of a discovered writer, names of DDS.
  struct Discovered {
    std::string topic, type;
  };
  /// Returns the writers of other participants that were discovered since the last call. Stores at most
  /// 1,024 writers between two calls, and drops further ones.
  [[nodiscard]] std::vector<Discovered> take_discovered();

  struct Impl;
  [[nodiscard]] Impl& impl() noexcept { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

/// One thread at a time.
class RosWriter {
 public:
  /// `topic`: name of ROS, for example /tactus/tf. `profile`: of qos/ros2.xml. Throws WireError.
  RosWriter(RosDomain& domain, const std::string& topic, const RosType& type, const std::string& profile);
  ~RosWriter();
  RosWriter(RosWriter&&) noexcept;
  RosWriter& operator=(RosWriter&&) noexcept;

  /// Sends a message in CDR with its encapsulation header. False if DDS refuses it. May block and allocate.
  bool send(std::span<const std::uint8_t> message);
  /// Number of matched readers.
  [[nodiscard]] int matched() const;
  /// Number of readers that have been matched since the beginning.
  [[nodiscard]] int matches() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// One thread at a time. Drops messages of more than 1 KiB.
class RosReader {
 public:
  RosReader(RosDomain& domain, const std::string& topic, const RosType& type, const std::string& profile);
  ~RosReader();
  RosReader(RosReader&&) noexcept;
  RosReader& operator=(RosReader&&) noexcept;

  /// Sets `message` to the newest message, in CDR with its encapsulation header. False if none has arrived since the
  /// last call. A message is not trusted.
  [[nodiscard]] bool take(std::vector<std::uint8_t>& message);
  /// Number of matched writers.
  [[nodiscard]] int matched() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::wire
