/// Selects the participant announcements to send and to receive, and drops the others.
///
/// Whenever Fast DDS 2.9.1 discovers a participant, it announces its own participant to the multicast group and to
/// every known participant. If n participants join at the same time, they send about n^3 datagrams. Nearly all of them
/// repeat a recent one.
///
/// While 20 HRTCs join, they send 3,300 announcements to single participants. An earlier filter used the short interval
/// for single participants too, and let 14,100 pass. We did not measure without a filter. If 12 participants that only
/// read bulk ignore each other, their joining takes a quarter fewer discovery datagrams.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "wire/library.hpp"
#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

/// Decides which announcements to send and to receive. Threads: any.
class Announcements {
 public:
  using Locator = rtps::Locator_t;
  /// Min time between equal announcements to the group, or to a participant that no group reaches.
  static constexpr std::int64_t kGroupIntervalNs = 90'000'000;
  /// Min time between equal announcements to a participant that the group reaches too.
  static constexpr std::int64_t kUnicastIntervalNs = 1'900'000'000;

  /// Returns the sequence number of the announcement in an RTPS message; none if the message contains none.
  [[nodiscard]] static std::optional<std::uint64_t> sequence_of(const std::uint8_t* message, std::uint32_t size);

  /// Returns the locators in `to` to which `sender` has not sent this announcement within the interval. `sender` only
  /// identifies the sending object. The library sends to single locators and to the group in different calls.
  /// A group counts as existing if it was in `to` of any call in the last kUnicastIntervalNs.
  [[nodiscard]] std::vector<Locator> due(const void* sender, std::uint64_t sequence, const std::vector<Locator>& to,
                                         std::int64_t now_ns);

  /// `ignored`: name of the participants whose received announcements are dropped; empty: none are.
  explicit Announcements(std::string ignored = {}) : ignored_name_{std::move(ignored)} {}

  /// Reads a received message; false if it is the announcement of an ignored participant. After the first announcement
  /// of a participant, announcements to its locator are due again, even if an earlier participant at the same locator
  /// received them.
  [[nodiscard]] bool on_received(const std::uint8_t* message, std::uint32_t size);

 private:
  void forget(std::uint32_t port, const std::uint8_t* address);

  struct Sent {
    std::uint64_t sequence;
    std::int64_t time_ns;
  };
  std::mutex mutex_;
  std::map<std::pair<const void*, Locator>, Sent> sent_;
  std::optional<std::int64_t> group_ns_;  // time of the newest call of `due` with a group in `to`
  std::string ignored_name_;
  std::map<GuidPrefix, bool> discovered_;  // discovered participants; false: ignored
};

}  // namespace tactus::wire
