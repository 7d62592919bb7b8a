/// Records which emergency stops stand (are in force), and which programs have acknowledged stops and resets. While a
/// stop stands, forces are off.
///
///     issuer           host, HRTC                         operator
///       | stop (1)         |                                  |
///       |----------------->| stopped                          |
///       | stop (1)         |                                  |
///       |----------------->| recorded: nothing changes        |
///       |      roster: (issuer: stop 1)                       |
///       |<-----------------|--------------------------------->|
///       | acknowledged     |         reset, names (issuer, 1) |
///       |                  |<---------------------------------|
///       |                  | running                          |
///
/// The name of a stop is its issuer, the issuer's incarnation and a growing number. A later stop of an issuer replaces
/// its earlier ones, and a reset that names a stop also ends the earlier ones of that issuer. So the stops of an
/// issuer are described by two numbers that only grow: the newest stop, and the newest stop that a reset has ended. A
/// stop stands while its number is larger than the second one.
///
/// A reset ends only stops that the program has received, because a reset with a larger number must not disable later
/// stops in advance. The sender repeats its reset until no stop that it names stands at any program in its roster. A
/// stop that arrives later stands until the next reset that names it.
///
/// A host or HRTC forwards the stops that stand, so that a program that joins gets them. A forwarded stop may be
/// forged. If its issuer then sends a stop itself that the forwarded one would hide, this program issues a stop of its
/// own.
///
/// No DDS and no clock; one thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "session/roster.hpp"

namespace tactus::session {

/// Issuers of stops that one program records besides itself, and issuers of resets. Neither takes the records of the
/// other, so a reset can end all recorded stops and stay recorded next to them.
inline constexpr std::size_t kMaxResetIssuers = 8;
inline constexpr std::size_t kMaxStopIssuers = kMaxStops - kMaxResetIssuers - 1;

/// The stops and resets that one program has received: at most one record for each issuer. If no record is free for the
/// stop of a new issuer, the program drops the stop that was received least recently of those that do not stand. If all
/// stand, the program issues a stop of its own instead. A reset has to name that stop like any other. If no record is
/// free for a new issuer of resets, the program drops the reset that was received least recently. Only a reset that its
/// sender repeats while more than kMaxResetIssuers others do the same can therefore count twice.
class StopLatch {
 public:
  /// `self`: issuer of the stop that replaces stops without a record. Only the constructor and `standing_stops`
  /// allocate.
  explicit StopLatch(const Origin& self);

  /// Applies a stop that its issuer has sent. Returns true when the stop is new and a stop stands.
  bool on_stop(const StopName& stop);
  /// Issues a stop of this program. A reset that was sent before does not end it, even if an earlier stop of this
  /// program stands.
  void issue_stop();
  /// Applies a reset. Returns true when the reset is new. A repeated reset only ends stops that it names and that
  /// arrived after it, or again after their records were dropped, so a fault since the first one stays latched.
  bool on_reset(const ForceReset& reset);
  /// Applies the stops that stand in the roster entry of a host or an HRTC, but no resets. Returns true if a stop is
  /// new and stands.
  bool on_roster(const RosterEntry& entry);

  [[nodiscard]] bool stopped() const noexcept;
  /// Number of resets applied.
  [[nodiscard]] std::uint32_t resets() const noexcept { return resets_; }
  /// Grows whenever `records` changes.
  [[nodiscard]] std::uint64_t changes() const noexcept { return changes_; }
  /// The records to publish in the roster entry of this program.
  [[nodiscard]] const std::vector<StopRecord>& records() const noexcept { return records_; }

 private:
  [[nodiscard]] bool is_first_from_issuer(const StopName& stop);
  bool record_stop(const StopName& stop);
  [[nodiscard]] bool is_own(std::uint64_t participant, std::uint64_t incarnation) const noexcept;
  [[nodiscard]] StopRecord* find(std::uint64_t participant, std::uint64_t incarnation) noexcept;
  [[nodiscard]] StopRecord& find_or_add(std::uint64_t participant, std::uint64_t incarnation);
  [[nodiscard]] StopRecord* find_or_add_stop(const StopName& stop);
  [[nodiscard]] StopRecord& find_or_add_reset(const Origin& issuer);
  [[nodiscard]] bool drop_a_stop();
  void drop_a_reset();
  bool raise_own_stop();
  void raise(std::uint32_t& number, std::uint32_t value) noexcept;

  Origin self_;
  std::vector<StopRecord> records_;  // the most recently received last
  std::vector<StopName> direct_;     // newest stop that each issuer itself has sent; the most recently received last
  std::uint32_t resets_ = 0;
  std::uint64_t changes_ = 0;
};

/// Whether the program of this entry is a host or an HRTC. Only these list stops and acknowledge them.
[[nodiscard]] bool lists_stops(const RosterEntry& entry) noexcept;

/// Names of the stops that stand in these records.
[[nodiscard]] std::vector<StopName> standing_stops(const std::vector<StopRecord>& records);
/// The newest standing stop of each issuer, in the roster entries of hosts and HRTCs.
[[nodiscard]] std::vector<StopName> standing_stops(const Roster& roster);

/// Whether the program of this entry, a host or an HRTC, has acknowledged the sample. A standing stop of its own also
/// acknowledges any stop, because a program without a free record issues its own stop.
[[nodiscard]] bool acknowledges(const RosterEntry& entry, const EmergencyStop& stop);
/// A reset is acknowledged when the program has applied it and no stop that it names stands there.
[[nodiscard]] bool acknowledges(const RosterEntry& entry, const ForceReset& reset);

/// Names of the hosts and HRTCs of a session, by whether they have acknowledged a sample.
struct Acknowledgement {
  std::vector<std::string> hrtcs, hosts;  ///< that have acknowledged
  std::vector<std::string> missing;       ///< that have not
};

/// The hosts and HRTCs that have to acknowledge the stops and resets of a sender: all that it has found, except those
/// that have left. One that sends no heartbeat may still exert forces, so it is missing until it has acknowledged.
class Recipients {
 public:
  /// Records the newest entries. The sender calls it before `acknowledgement`, and more often than
  /// RosterSettings::forget_ns.
  void update(const Roster& roster);
  /// Forgets all.
  void clear() noexcept { entries_.clear(); }
  /// Lists the hosts and HRTCs that have acknowledged `sample`, an EmergencyStop or a ForceReset, and those that have
  /// not. The sender repeats it until `missing` is empty.
  template <class Sample>
  [[nodiscard]] Acknowledgement acknowledgement(const Sample& sample) const {
    Acknowledgement result;
    for (const auto& [participant, entry] : entries_) {
      auto& list = !acknowledges(entry, sample) ? result.missing
                   : entry.role == Role::kHost  ? result.hosts
                                                : result.hrtcs;
      list.push_back(entry.name);
    }
    return result;
  }

 private:
  static constexpr std::size_t kMaxEntries = 4 * kMaxParticipants;  // those of forged participants remain
  std::map<std::uint64_t, RosterEntry> entries_;                    // by participant
};

/// Lists the present hosts and HRTCs that have acknowledged `sample`, and those that have not.
template <class Sample>
[[nodiscard]] Acknowledgement acknowledgement(const Roster& roster, const Sample& sample) {
  Recipients present;
  present.update(roster);
  return present.acknowledgement(sample);
}

}  // namespace tactus::session
