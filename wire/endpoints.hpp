/// Typed ends of topics. A Writer sends plain structs, a Reader hands them over checked; DDS stays behind both.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "wire/topics.hpp"

namespace tactus::wire {

/// What differs between two ends of one topic.
struct EndpointOptions {
  /// Narrows the end to a part of the session, e.g. `user_partition("alice")`; both ends must name the same. Empty: the
  /// session as a whole.
  std::string partition;
};
/// Partition of the samples of one user (device_pose, device_command, intent): permissions can name it.
[[nodiscard]] std::string user_partition(const std::string& user);
/// Partition of the bulk stream from any host to one HRTC.
[[nodiscard]] std::string hrtc_partition(const std::string& hrtc);
/// Partition of metrics that tell which controllers' coded probe states get lost; sent only while some do.
inline constexpr const char* kLossesPartition = "losses";
/// Partition of the whole probe states of users who collaborate.
[[nodiscard]] std::string group_partition(std::uint64_t group);

enum class SendStatus {
  kSent,     ///< handed to DDS
  kInvalid,  ///< not sent: a bound, a number or the origin is wrong; see `last_fault`
  kBlocked   ///< not sent: a reliable history stayed full for the profile's max_blocking_time
};

/// Typed sending end of one topic. Destroying it leaves the topic. One thread at a time; `matched` from any.
template <class Sample>
class Writer {
 public:
  /// Takes its QoS from the profile that `topic` names. Throws WireError with the topic when DDS refuses it.
  Writer(Participants& participants, const TopicSpec<Sample>& topic, const EndpointOptions& options = {});
  ~Writer();
  Writer(Writer&&) noexcept;
  Writer& operator=(Writer&&) noexcept;

  /// Checks, converts and sends. Its origin must be of this program (`Participants::origin`). May block and allocate,
  /// so it is for wire threads, never for the haptic thread.
  [[nodiscard]] SendStatus send(const Sample& sample) noexcept;

  /// Readers that this end has found, without those of its own Participants.
  [[nodiscard]] int matched() const noexcept;
  /// Why the last send was kInvalid; empty when none was. Static text.
  [[nodiscard]] const char* last_fault() const noexcept;
  /// Waits until every matched reliable reader has all that was sent; false when `limit` passes first.
  bool wait_acknowledged(std::chrono::milliseconds limit) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// What became of the samples that reached a Reader, since it was made.
struct ReaderCounts {
  std::uint64_t received = 0;  ///< handed to the callback
  std::uint64_t invalid = 0;   ///< undecodable, out of bounds or not finite; dropped
  std::uint64_t foreign = 0;   ///< of another session; dropped
  std::uint64_t lost = 0;      ///< never came, as far as DDS noticed; on keep-last topics also those overwritten
};

/// Typed receiving end of one topic. Samples of its own Participants are not handed over.
template <class Sample>
class Reader {
 public:
  /// Runs in a thread of DDS, one call at a time; must return soon, not throw and not destroy the Reader.
  using OnSample = std::function<void(Sample&&)>;

  Reader(Participants& participants, const TopicSpec<Sample>& topic, OnSample on_sample,
         const EndpointOptions& options = {});
  /// After this returns no callback runs.
  ~Reader();
  Reader(Reader&&) noexcept;
  Reader& operator=(Reader&&) noexcept;

  /// Writers that this end has found, without those of its own Participants.
  [[nodiscard]] int matched() const noexcept;
  [[nodiscard]] ReaderCounts counts() const noexcept;
  /// Why the last invalid sample was dropped; empty when none was. Static text.
  [[nodiscard]] const char* last_fault() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::wire
