/// Typed endpoints of topics. A Writer sends plain structs, a Reader delivers checked ones; neither exposes DDS.
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
  /// Restricts the endpoint to a part of the session, e.g. `user_partition("alice")`; both endpoints must name the
  /// same. Empty: the session as a whole.
  std::string partition;
};
/// Partition of the samples of one user (device_pose, device_command, intent), which permissions can name.
[[nodiscard]] std::string user_partition(const std::string& user);
/// Partition of the bulk stream from any host to one HRTC.
[[nodiscard]] std::string hrtc_partition(const std::string& hrtc);
/// Partition of metrics that report losses of deadband-coded probe states by HRTC; used only while there are losses.
inline constexpr const char* kLossesPartition = "losses";
/// Partition of the full-rate probe states of users who collaborate.
[[nodiscard]] std::string group_partition(std::uint64_t group);

enum class SendStatus {
  kSent,     ///< passed to DDS
  kInvalid,  ///< not sent: a bound, a number or the origin is wrong; see `last_fault`
  kBlocked   ///< not sent: a reliable history stayed full for the profile's max_blocking_time
};

/// Typed writer of one topic. Its destructor leaves the topic. One thread at a time; `matched` from any.
template <class Sample>
class Writer {
 public:
  /// Uses the QoS profile that `topic` names. Throws WireError with the topic when DDS refuses it.
  Writer(Participants& participants, const TopicSpec<Sample>& topic, const EndpointOptions& options = {});
  ~Writer();
  Writer(Writer&&) noexcept;
  Writer& operator=(Writer&&) noexcept;

  /// Checks, converts and sends. The origin must be this program's (`Participants::origin`). May block and allocate, so
  /// it is for wire threads, never for the haptic thread.
  [[nodiscard]] SendStatus send(const Sample& sample) noexcept;

  /// Number of matched readers, except those of its own Participants.
  [[nodiscard]] int matched() const noexcept;
  /// Why the last send was kInvalid; empty when none was. Static text.
  [[nodiscard]] const char* last_fault() const noexcept;
  /// Waits until every matched reliable reader has acknowledged all samples; false when `limit` passes first.
  bool wait_acknowledged(std::chrono::milliseconds limit) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Samples that reached a Reader since its construction.
struct ReaderCounts {
  std::uint64_t received = 0;  ///< passed to the callback
  std::uint64_t invalid = 0;   ///< undecodable, out of bounds or not finite; dropped
  std::uint64_t foreign = 0;   ///< of another session; dropped
  std::uint64_t lost = 0;      ///< detected as lost by DDS; on keep-last topics also those overwritten
};

/// Typed reader of one topic. Ignores samples of its own Participants.
template <class Sample>
class Reader {
 public:
  /// Runs in a DDS thread, one call at a time; must return soon, not throw and not destroy the Reader.
  using OnSample = std::function<void(Sample&&)>;

  Reader(Participants& participants, const TopicSpec<Sample>& topic, OnSample on_sample,
         const EndpointOptions& options = {});
  /// After this returns no callback runs.
  ~Reader();
  Reader(Reader&&) noexcept;
  Reader& operator=(Reader&&) noexcept;

  /// Number of matched writers, except those of its own Participants.
  [[nodiscard]] int matched() const noexcept;
  [[nodiscard]] ReaderCounts counts() const noexcept;
  /// Why the last invalid sample was dropped; empty when none was. Static text.
  [[nodiscard]] const char* last_fault() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::wire
