/// The contact log of an HRTC whose objects come and go.
///
/// The haptic thread names an object by its index, which comes again with another object once the first is gone. The
/// log numbers the objects in the order in which they came, so that an entry always means the same one.
///
/// Service thread.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>

#include "hrtc_service/contact_query.hpp"
#include "hrtc_service/loader.hpp"
#include "trace/contact_log.hpp"

namespace tactus::hrtc_service {

class ContactJournal {
 public:
  /// `queries` must outlive it. Throws trace::LogError naming a file that cannot be created.
  ContactJournal(const std::filesystem::path& file, ContactQuery::LogRing& queries);

  /// An object that is shown from now on: before the haptic thread gets it.
  void add(const TouchObject& object);
  /// Writes what the haptic thread has logged. False after a failed write.
  bool drain();
  /// An object that the haptic thread has forgotten, or the end: writes what was logged of it, and its totals.
  void close(const Loader::ObjectInfo& object);

 private:
  trace::ContactLogWriter log_;
  ContactQuery::LogRing& queries_;
  std::array<std::uint32_t, kMaxObjects> numbers_{};  // in the log, by object index
  std::uint32_t next_number_ = 0;
  trace::LoggedQuery query_;
};

}  // namespace tactus::hrtc_service
