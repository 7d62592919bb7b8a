/// Receives the samples of a session in encoded form, for recorders and other observers.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "session/messages.hpp"
#include "wire/participants.hpp"

namespace tactus::wire {

/// One reader of a tap.
struct TapTopic {
  std::string name;        ///< of the topic; a topic with two profiles has two readers
  std::string type;        ///< name in idl_text()
  std::string partitions;  ///< partitions that the reader reads, separated by ", "; "" is the session as a whole
};

/// A decoded sample of any topic.
using AnySample = std::variant<session::RosterEntry, session::CatalogueEntry, session::Demand, session::Metrics,
                               session::ShownRegions, session::Control, session::ForceReset, session::SessionEnd,
                               session::BulkChunk, session::EmergencyStop, session::ProbeState, session::DevicePose,
                               session::DeviceCommand, session::Intent, session::ObjectPose, session::ObjectClaim,
                               session::ObjectGrant, session::ObjectCopy, session::ClockSample>;

/// Decodes a sample that a Tap has passed encoded. None if it is damaged or invalid (session/check.hpp), or if no topic has
/// this name.
[[nodiscard]] std::optional<AnySample> decode(const std::string& topic, std::span<const std::uint8_t> encoded);

/// Reads the selected topics in all partitions of the session. Drops and reports the samples that a Reader would drop,
/// except those of another user than the partition names. Writers send each best-effort sample to a tap's readers too;
/// for class bulk this doubles the traffic.
class Tap {
 public:
  /// `topic`: index in topics(). `encoded`: the sample with its encapsulation header, valid during the call. Several
  /// DDS threads call it, one call at a time for each topic.
  using OnSample = std::function<void(std::size_t topic, std::span<const std::uint8_t> encoded)>;
  /// Called after OnSample with the same sample.
  using OnDecoded = std::function<void(const AnySample& sample)>;

  /// Returns whether to read a topic.
  using Selection = std::function<bool(const std::string& topic, TrafficClass traffic)>;

  /// `participants` must have no Reader or Writer, because a tap registers other types under the same names. Throws
  /// WireError.
  Tap(Participants& participants, const Selection& is_selected, OnSample on_sample, OnDecoded on_decoded = {});
  /// After this returns no callback runs.
  ~Tap();

  [[nodiscard]] const std::vector<TapTopic>& topics() const noexcept;
  /// Number of samples dropped because they were above the rate limit of their participant (TopicSpec::max_rate), for
  /// example those that wait while this program is suspended. Thread: any.
  [[nodiscard]] std::uint64_t excess() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The text of idl/tactus.idl.
[[nodiscard]] const char* idl_text() noexcept;

}  // namespace tactus::wire
