/// Owns a program's DDS participants in a session, one for each traffic class.
///
/// The three classes use three DDS domains. They have separate sockets, receive threads and locks, so a mesh transfer
/// does not delay probe states. Measured on a saturated link, p99 of the probe's delay: 0.1 ms with a participant for
/// each class, 61 ms with one participant for all (docs/reference/qos.md).
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "session/severity.hpp"
#include "wire/address/address.hpp"
#include "wire/error.hpp"

namespace tactus::wire {

/// Owns the three participants and the profiles of every endpoint. Must outlive its Writers and Readers. Threads: any.
class Participants {
 public:
  /// Reads `address.qos` and joins; takes about 10 ms. Throws WireError for a name or domain out of bounds, a missing
  /// or broken profile (with file, profile and topic), a peer or server whose name does not resolve, and when DDS
  /// cannot join.
  explicit Participants(SessionAddress address);
  ~Participants();
  Participants(const Participants&) = delete;
  Participants& operator=(const Participants&) = delete;

  [[nodiscard]] const SessionAddress& address() const noexcept;

  /// The origin for a sample that this program sends now: session, participant, incarnation and time.
  [[nodiscard]] session::Origin origin() const noexcept;

  /// The discovery servers that were present and are gone; their lease of 1 s has ended. Meanwhile the program does not
  /// find programs that start, but keeps its connections.
  [[nodiscard]] std::vector<std::string> lost_servers() const;

  /// Returns false if the keys of this program do not permit it to write a topic.
  [[nodiscard]] bool may_write(const char* topic) const;
  /// Returns whether the keys of this program, an HRTC, permit it to serve a user whom the program with the id `client`
  /// brings. If they do not, the audit log names that program.
  [[nodiscard]] bool may_serve(const std::string& user, std::uint64_t client) const;
  /// Throws WireError if the keys of this program restrict it to other users.
  void expect_permitted(const std::string& user) const;

  /// Max encoded size of the pieces of a chunk whose message fits one Ethernet frame, padding included. With keys it is
  /// smaller, because each message has the bytes of its protection, and a proof of its origin for each of at most two
  /// readers.
  [[nodiscard]] std::size_t chunk_bytes() const noexcept;

  /// True if the probe participant's threads run at `probe_priority`; false if that is 0, if the system refused it, or
  /// if the session is secured and this program has Tactus in a shared library.
  [[nodiscard]] bool probe_is_realtime() const noexcept;

  struct Impl;
  [[nodiscard]] Impl& impl() noexcept { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

/// Environment variables by which Fast DDS would use discovery servers, a profile file or a file of variables that
/// Tactus does not know, or would publish statistics. A program that joins removes them from its environment.
inline constexpr std::array kIgnoredVariables{"ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE",
                                              "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_ENVIRONMENT_FILE",
                                              "FASTDDS_STATISTICS"};

/// Throws WireError if the keys of this address cannot be used now, or do not permit one of these objects. A host calls
/// it before it opens its models, which may take minutes.
void check_keys(SessionAddress address, const std::vector<std::string>& objects);

/// Receives the errors of the DDS library, which begin with "dds: ", and reports of this module, for example of
/// endpoints whose QoS does not match.
using LogSink = std::function<void(session::Severity, const std::string&)>;
/// Sets the sink of the whole process. Without one, the errors of the library are dropped, and the reports go to the
/// standard error output. A thread of the library calls the sink.
void set_log_sink(LogSink sink);

}  // namespace tactus::wire
