/// Which announcements of a participant are worth sending.
///
/// Fast DDS 2.9.1 announces a participant to the group and to everyone it knows whenever it finds one: where n join
/// together that is n^3 datagrams, nearly all of which tell what their receiver was told a moment ago.
/// Figures: decision 11, not measured again since; none compares with no filter at all. When 20 HRTCs join, 3,300
/// announcements go to single participants; with a rule that did not count the group it was 14,100. When participants
/// that only read bulk ignore each other, 12 that join take in a quarter less of discovery's datagrams.
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

/// What has been announced to whom. Threads: any.
class Announcements {
 public:
  using Locator = eprosima::fastrtps::rtps::Locator_t;
  static constexpr std::int64_t kGroupRestNs = 90'000'000;     ///< to a group, or where no group is
  static constexpr std::int64_t kKnownRestNs = 1'900'000'000;  ///< to one whom the group reaches too

  /// Sequence number of the announcement that an RTPS message carries; none when it is no announcement.
  [[nodiscard]] static std::optional<std::uint64_t> sequence_of(const std::uint8_t* message, std::uint32_t size);

  /// Those of `to` who have not been sent this announcement by this sender (an address) of late. The library sends to
  /// single ones and to the group one after the other: there is a group when one was among `to` of late.
  [[nodiscard]] std::vector<Locator> due(const void* sender, std::uint64_t sequence, const std::vector<Locator>& to,
                                         std::int64_t now_ns);

  /// `ignored`: participants of this name are not to be met; empty: all are.
  explicit Announcements(std::string ignored = {}) : ignored_name_{std::move(ignored)} {}

  /// A message came. When it is the first announcement of a participant, who it is has been told nothing, though
  /// another before it may have listened at the same place. False when it announces one who is not to be met.
  [[nodiscard]] bool on_received(const std::uint8_t* message, std::uint32_t size);

 private:
  void forget(std::uint32_t port, const std::uint8_t* address);

  struct Sent {
    std::uint64_t sequence;
    std::int64_t time_ns;
  };
  std::mutex mutex_;
  std::map<std::pair<const void*, Locator>, Sent> sent_;
  std::optional<std::int64_t> group_ns_;  // when it was to be sent to the group last
  std::string ignored_name_;
  std::map<GuidPrefix, bool> met_;  // whether it is to be met
};

}  // namespace tactus::wire
