/// Finds the faces that a tip touches, decides whether the contact is exact, and logs faces and decision.
///
/// Haptic thread. Realtime after construction.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "hrtc_service/servo/probe.hpp"
#include "hrtc_service/servo/shared_ring.hpp"
#include "trace/contact_log.hpp"

namespace tactus::hrtc_service {

class ContactQuery {
 public:
  static constexpr std::uint32_t kLogEntries = 4096;
  using LogRing = SharedRing<trace::LoggedQuery, kLogEntries>;

  /// `radius`: radius of the tips, m. `log` must outlive the query; null: nothing is logged.
  ContactQuery(double radius, LogRing* log) : radius_{radius} {
    if (log != nullptr) log_.emplace(*log);
  }

  /// Sets contacts, session::kExact, session::kContactsTruncated and error bound of `output` for a tip at `tip`, world.
  /// Only the log uses `probe`, `now_ns` and `cycles_since_change`, the number of cycles since the mesh of an object
  /// changed, by object index.
  void run(std::uint32_t probe, const Vec3d& tip, std::int64_t now_ns, const ObjectsSurface& surface,
           const std::array<std::uint32_t, kMaxObjects>& cycles_since_change, ProbeOutput& output) noexcept;

  [[nodiscard]] bool is_logging() const noexcept { return log_.has_value(); }
  /// Returns the number of log entries that were lost because the ring was full.
  [[nodiscard]] std::uint64_t log_dropped() const noexcept { return log_dropped_; }

 private:
  static constexpr std::uint32_t kMaxContacts = 2048;
  void log(const TouchObject& object, const Vec3d& centre, double radius, std::uint32_t found) noexcept;

  double radius_;
  std::optional<RingWriter<trace::LoggedQuery, kLogEntries>> log_;
  std::array<spm::Contact, kMaxContacts> contacts_;
  trace::LoggedQuery entry_;
  std::uint64_t log_dropped_ = 0;
};

}  // namespace tactus::hrtc_service
