/// The contact log of an HRTC, from which its contacts can be checked afterwards: contacts, positions, and whether they
/// were exact.
///
/// A file of tagged, little-endian entries: each object when it appears, one entry per cycle for each probe and near
/// object, and one summary per object at the end. The positions of its corners identify a contact, so that a checker
/// needs only the model and no numbering. Writing buffers and flushes; not for the haptic thread. Reading ends at a
/// truncated last entry (after a killed HRTC).
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

/// A key from a triangle's oriented corner positions: equal for its three rotations, up to 64-bit collisions. Realtime.
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
  std::uint32_t since_change = 0;  ///< cycles since a region was refined or coarsened; 0: this cycle
  bool exact = false;
  bool truncated = false;  ///< more contacts than kMaxContacts
  std::uint32_t contact_count = 0;
  std::array<LoggedContact, kMaxContacts> contacts;
};

/// Figures of the loader for an object over the whole session.
struct LoggedTotals {
  std::uint32_t object = 0;
  std::uint64_t records_received = 0;  ///< including repetitions
  std::uint64_t records_returned = 0;  ///< of these, received again after an eviction
  std::uint64_t regions_received = 0;
  std::uint64_t regions_released = 0;
};

class ContactLogWriter {
 public:
  /// Throws LogError naming a file that cannot be created.
  explicit ContactLogWriter(const std::filesystem::path& path);
  ~ContactLogWriter();
  ContactLogWriter(const ContactLogWriter&) = delete;
  ContactLogWriter& operator=(const ContactLogWriter&) = delete;

  void write(const LoggedObject& object);
  void write(const LoggedQuery& query);
  void write(const LoggedTotals& totals);
  /// False after a failed write (disk full); earlier entries stay readable.
  [[nodiscard]] bool healthy() const noexcept { return healthy_; }

 private:
  void put(const void* data, std::size_t size);
  std::FILE* file_;
  bool healthy_ = true;
};

/// Reads entries in order. Throws LogError for a file that is missing, not a log, of another version, or corrupt before
/// its end.
class ContactLogReader {
 public:
  explicit ContactLogReader(const std::filesystem::path& path);
  ~ContactLogReader();
  ContactLogReader(const ContactLogReader&) = delete;
  ContactLogReader& operator=(const ContactLogReader&) = delete;

  enum class Entry { kEnd, kObject, kQuery, kTotals };
  /// Reads the next entry into the member that corresponds to the result.
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
