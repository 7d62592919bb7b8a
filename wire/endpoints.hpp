/// Typed endpoints of topics. A Writer sends plain structs, and a Reader delivers validated ones. Neither exposes DDS.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "wire/topics.hpp"

namespace tactus::wire {

/// Options of one endpoint of a topic.
struct EndpointOptions {
  /// Restricts the endpoint to a part of the session, for example `user_partition("alice")`. Writer and reader must
  /// have the same partition. Empty: the session as a whole.
  std::string partition;
};
/// Partition of the samples of one user: device_pose, device_command and intent. DDS permissions can name it.
[[nodiscard]] std::string user_partition(const std::string& user);
/// Partition of the bulk stream from any host to one HRTC.
[[nodiscard]] std::string hrtc_partition(const std::string& hrtc);
/// Partition of metrics samples with one figure for each HRTC: the lost share of its deadband-coded probe states. An
/// HRTC sends these samples only while it loses states.
inline constexpr const char* kLossesPartition = "losses";
/// Partition of the full-rate probe states of users who collaborate, and of the copies of one object.
[[nodiscard]] std::string group_partition(std::uint64_t group);

enum class SendStatus {
  kSent,     ///< passed to DDS
  kInvalid,  ///< not sent, because a field is invalid; see `invalid_reason`
  kBlocked   ///< not sent: a reliable history stayed full for the profile's max_blocking_time
};

/// Typed writer of one topic. Its destructor leaves the topic. One thread at a time; any thread may call `matched`.
template <class Sample>
class Writer {
 public:
  /// Uses the QoS profile that `topic` names. Throws WireError, which names the topic, if DDS refuses the endpoint.
  Writer(Participants& participants, const TopicSpec<Sample>& topic, const EndpointOptions& options = {});
  ~Writer();
  Writer(Writer&&) noexcept;
  Writer& operator=(Writer&&) noexcept;

  /// Checks, converts and sends. The origin must be this program's (`Participants::origin`). May block and allocate:
  /// not for the haptic thread.
  [[nodiscard]] SendStatus send(const Sample& sample) noexcept;

  /// Number of matched readers, except those that use the same Participants.
  [[nodiscard]] int matched() const noexcept;
  /// The invalid field of the last sample that `send` refused as kInvalid; empty if there was none. Static text.
  [[nodiscard]] const char* invalid_reason() const noexcept;
  /// Waits until every matched reliable reader has acknowledged all samples. False if `limit` passes first.
  bool wait_acknowledged(std::chrono::milliseconds limit) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Numbers of samples since the construction of a Reader.
struct ReaderCounts {
  std::uint64_t received = 0;  ///< passed to the callback
  std::uint64_t invalid = 0;   ///< undecodable, out of bounds or not finite; dropped
  std::uint64_t foreign = 0;   ///< of another session; dropped
  std::uint64_t refused = 0;   ///< with keys: of another member than it claims, or not permitted; dropped
  std::uint64_t excess = 0;    ///< above TopicSpec::max_rate of their participant; dropped
  std::uint64_t lost = 0;      ///< lost according to DDS; on keep-last topics also samples that newer ones replaced
};

/// Typed reader of one topic. Ignores samples that its own Participants sent.
template <class Sample>
class Reader {
 public:
  /// Runs in a DDS thread, one call at a time. It must return soon, and must not throw or destroy the Reader.
  using OnSample = std::function<void(Sample&&)>;

  Reader(Participants& participants, const TopicSpec<Sample>& topic, OnSample on_sample,
         const EndpointOptions& options = {});
  /// After this returns no callback runs.
  ~Reader();
  Reader(Reader&&) noexcept;
  Reader& operator=(Reader&&) noexcept;

  /// Number of matched writers, except those that use the same Participants.
  [[nodiscard]] int matched() const noexcept;
  [[nodiscard]] ReaderCounts counts() const noexcept;
  /// The invalid field of the last sample that counts as `invalid`; empty if there was none. Static text.
  [[nodiscard]] const char* invalid_reason() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::wire
