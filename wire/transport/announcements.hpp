/// Selects which participant announcements to send.
///
/// Fast DDS 2.9.1 announces a participant to the multicast group and to every known participant whenever it discovers
/// one. If n participants join at the same time, that is n^3 datagrams, and nearly all of them repeat a recent one.
/// Figures: decision 11, not measured again since; none compares with no filter at all. When 20 HRTCs join, 3,300
/// announcements go to single participants; with a rule that ignored the group it was 14,100. When participants that
/// only read bulk ignore each other, 12 that join receive a quarter fewer discovery datagrams.
#pragma once

#include <fastdds/rtps/common/Locator.h>

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

/// Records which announcement was sent to which locator. Threads: any.
class Announcements {
 public:
  using Locator = eprosima::fastrtps::rtps::Locator_t;
  static constexpr std::int64_t kGroupIntervalNs = 90'000'000;       ///< min interval to a group, or without a group
  static constexpr std::int64_t kUnicastIntervalNs = 1'900'000'000;  ///< min interval to one that the group reaches too

  /// Sequence number of the announcement in an RTPS message; none if there is no announcement.
  [[nodiscard]] static std::optional<std::uint64_t> sequence_of(const std::uint8_t* message, std::uint32_t size);

  /// The locators in `to` to which this sender (an address) has not sent this announcement within the interval. The
  /// library sends to single locators and to the group separately, so the group exists if `to` had one recently.
  [[nodiscard]] std::vector<Locator> due(const void* sender, std::uint64_t sequence, const std::vector<Locator>& to,
                                         std::int64_t now_ns);

  /// `ignored`: name of participants whose announcements are dropped; empty: none.
  explicit Announcements(std::string ignored = {}) : ignored_name_{std::move(ignored)} {}

  /// Reads a received message. After the first announcement of a participant, announcements to its locator are due
  /// again, even if an earlier participant with the same locator received them. False if the participant is ignored.
  [[nodiscard]] bool on_received(const std::uint8_t* message, std::uint32_t size);

 private:
  void forget(std::uint32_t port, const std::uint8_t* address);

  struct Sent {
    std::uint64_t sequence;
    std::int64_t time_ns;
  };
  std::mutex mutex_;
  std::map<std::pair<const void*, Locator>, Sent> sent_;
  std::optional<std::int64_t> group_ns_;  // newest announcement to the group
  std::string ignored_name_;
  std::map<GuidPrefix, bool> discovered_;  // discovered participants; false: ignored
};

}  // namespace tactus::wire
