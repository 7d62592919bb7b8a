/// The log from which an HRTC's contacts can be checked afterwards: what was touched, where, and whether that was
/// exact.
///
/// A file of tagged, little-endian entries: objects as they appear, one entry for each probe and near object in a
/// cycle, and one summary for each object at the end. A contact is named by the positions of its corners, so that
/// whoever checks needs no numbering but the model itself. Writing buffers and flushes; not for the haptic thread. A
/// truncated last entry (a killed HRTC) is where reading ends.
#pragma once

#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "spm/model.hpp"

namespace tactus::trace {

class LogError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Names a triangle by its oriented corner positions: equal for its three rotations, up to 64-bit collisions. Realtime.
[[nodiscard]] std::uint64_t triangle_key(const std::array<float, 9>& corners) noexcept;

struct LoggedObject {
  std::uint32_t index = 0;
  std::uint64_t digest = 0;
  double scale = 1;  ///< metres per file unit
  std::string name;
};

struct LoggedContact {
  std::uint64_t triangle;  ///< triangle_key
  float depth;             ///< file units
};

/// One probe against one object in one cycle.
struct LoggedQuery {
  static constexpr std::uint32_t kMaxContacts = 512;
  std::int64_t time_ns = 0;
  std::uint32_t object = 0;
  std::uint32_t probe = 0;
  std::array<double, 3> centre{};  ///< of the tip, model frame, file units
  double radius = 0;               ///< file units
  std::uint64_t mesh_hash = 0;
  std::uint32_t since_change = 0;  ///< cycles since a region was refined or coarsened; 0: in this one
  bool exact = false;
  bool truncated = false;  ///< more contacts than kMaxContacts
  std::uint32_t contact_count = 0;
  std::array<LoggedContact, kMaxContacts> contacts;
};

/// What the loader did for an object in the whole session.
struct LoggedTotals {
  std::uint32_t object = 0;
  std::uint64_t records_received = 0;  ///< each time counted
  std::uint64_t records_returned = 0;  ///< of these, again after having been freed
  std::uint64_t regions_received = 0;
  std::uint64_t regions_released = 0;
};

class ContactLogWriter {
 public:
  /// Throws LogError naming the file when it cannot be made.
  explicit ContactLogWriter(const std::filesystem::path& path);
  ~ContactLogWriter();
  ContactLogWriter(const ContactLogWriter&) = delete;
  ContactLogWriter& operator=(const ContactLogWriter&) = delete;

  void write(const LoggedObject& object);
  void write(const LoggedQuery& query);
  void write(const LoggedTotals& totals);
  /// False once a write has failed (disk full): what was written before stays readable.
  [[nodiscard]] bool healthy() const noexcept { return healthy_; }

 private:
  void put(const void* data, std::size_t size);
  std::FILE* file_;
  bool healthy_ = true;
};

/// Calls the handlers for each entry in order. Throws LogError for a file that is missing, not a log, of a later
/// version or corrupt before its end.
class ContactLogReader {
 public:
  explicit ContactLogReader(const std::filesystem::path& path);
  ~ContactLogReader();
  ContactLogReader(const ContactLogReader&) = delete;
  ContactLogReader& operator=(const ContactLogReader&) = delete;

  enum class Entry { kEnd, kObject, kQuery, kTotals };
  /// Reads the next entry into the one of the three members that the answer names.
  [[nodiscard]] Entry next();
  /// After kEnd: the file ends within an entry.
  [[nodiscard]] bool torn() const noexcept { return torn_; }
  LoggedObject object;
  LoggedQuery query;
  LoggedTotals totals;

 private:
  [[nodiscard]] bool get(void* data, std::size_t size);
  std::FILE* file_;
  std::string name_;
  bool torn_ = false;
};

}  // namespace tactus::trace
