/// Writes the contact log of an HRTC.
///
/// The haptic thread identifies an object by its index, which a later object may get. The log numbers the objects in
/// the order of their arrival, so that a number always means the same object. After the end of a gateway, the servo
/// has objects that the log of the next gateway does not contain yet. Their queries are not logged.
///
/// Service thread.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>

#include "hrtc_service/loader.hpp"
#include "hrtc_service/servo/contact_query.hpp"
#include "trace/contact_log.hpp"

namespace tactus::hrtc_service {

class ContactLogger {
 public:
  /// `queries` must outlive it. Throws trace::LogError naming a file that cannot be created.
  ContactLogger(const std::filesystem::path& file, ContactQuery::LogRing& queries);

  /// Adds an object, before the haptic thread receives it.
  void add(const ObjectDescription& object);
  /// Writes the queries that the haptic thread has logged. Returns false after a failed write.
  bool drain();
  /// Writes the queries logged so far, then the totals of this object. Call it when the haptic thread has returned the
  /// object, and at the end for each remaining object.
  void close(const Loader::ObjectInfo& object);
  /// Closes the file. Returns whether it has all entries. No entry may be added afterwards.
  [[nodiscard]] bool finish() { return log_.close(); }

 private:
  trace::ContactLogWriter log_;
  RingReader<trace::LoggedQuery, ContactQuery::kLogEntries> queries_;
  std::array<std::uint32_t, kMaxObjects> numbers_;  // in the log, by object index; kNone: not in the log yet
  std::uint32_t next_number_ = 0;
  trace::LoggedQuery query_;
};

}  // namespace tactus::hrtc_service
