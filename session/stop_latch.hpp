/// Emergency stops and resets: which stops stand, so that forces are off, and who has acknowledged what.
///
///     issuer           host, HRTC                         operator
///       | stop (1)         |                                  |
///       |----------------->| stopped                          |
///       | stop (1)         |                                  |
///       |----------------->| known: nothing changes           |
///       |      roster: (issuer: stop 1)                       |
///       |<-----------------|--------------------------------->|
///       | acknowledged     |         reset, names (issuer, 1) |
///       |                  |<---------------------------------|
///       |                  | running                          |
///
/// A stop is named by its issuer, the incarnation of the issuer and a number that grows. A later stop of an issuer
/// replaces its earlier ones, and a reset that names a stop ends the earlier ones of that issuer too. So the state of
/// an issuer is two numbers, and each of them only grows: neither order nor repetition of samples matters. A stop
/// stands while its number is larger than the largest that a reset has named. A reset may arrive before the stop that
/// it names.
///
/// No DDS and no clock in it; one thread at a time.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "session/roster.hpp"

namespace tactus::session {

/// What one program has received. It records kMaxStops issuers at most. For a new one it forgets the issuer without a
/// standing stop that has been quiet for longest. When all have standing stops it raises a stop of its own instead,
/// which a reset has to name like any other.
class StopLatch {
 public:
  /// `self` issues the stop that stands for those that find no room. Allocates; the rest allocates nothing, but
  /// `standing`.
  explicit StopLatch(const Origin& self);

  /// True when forces are off for a reason that was unknown before.
  bool on_stop(const StopName& stop);
  /// True when it was unknown. Repeated resets change nothing: a fault that came between them stays.
  bool on_reset(const ForceReset& reset);
  /// Takes over the stops that stand at another program, but no resets. True as of `on_stop`.
  bool on_roster(const RosterEntry& entry);

  [[nodiscard]] bool stopped() const noexcept;
  [[nodiscard]] std::uint32_t resets() const noexcept { return resets_; }
  /// Grows whenever `records` changes.
  [[nodiscard]] std::uint64_t changes() const noexcept { return changes_; }
  /// For the roster entry of this program.
  [[nodiscard]] const std::vector<StopRecord>& records() const noexcept { return records_; }

 private:
  [[nodiscard]] StopRecord* find_or_add(std::uint64_t participant, std::uint64_t incarnation);
  [[nodiscard]] bool is_own(const StopRecord& record) const noexcept;
  bool raise_own_stop();
  void set(StopRecord& record, std::uint32_t StopRecord::*number, std::uint32_t value);

  Origin self_;
  std::vector<StopRecord> records_;  // the one that changed last stands last
  std::uint32_t resets_ = 0;
  std::uint64_t changes_ = 0;
};

/// The stops that stand at a program with these records.
[[nodiscard]] std::vector<StopName> standing(const std::vector<StopRecord>& records);

/// Whether the program of this roster entry has obeyed; for hosts and HRTCs.
[[nodiscard]] bool acknowledges(const RosterEntry& entry, const EmergencyStop& stop);
[[nodiscard]] bool acknowledges(const RosterEntry& entry, const ForceReset& reset);

/// Names of the hosts and HRTCs of a session.
struct Acknowledgement {
  std::vector<std::string> hrtcs, hosts;  ///< that have acknowledged
  std::vector<std::string> missing;       ///< that have not
};
/// Who has acknowledged `sample`, an EmergencyStop or a ForceReset. Its sender repeats it until nobody is missing.
template <class Sample>
[[nodiscard]] Acknowledgement acknowledgement(const Roster& roster, const Sample& sample) {
  Acknowledgement result;
  roster.for_each([&](const RosterEntry& entry) {
    if (entry.role != Role::kHost && entry.role != Role::kHrtc) return;
    auto& list = !acknowledges(entry, sample) ? result.missing
                 : entry.role == Role::kHost  ? result.hosts
                                              : result.hrtcs;
    list.push_back(entry.name);
  });
  return result;
}

}  // namespace tactus::session
