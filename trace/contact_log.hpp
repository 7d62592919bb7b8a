/// Writes and reads the contact log of an HRTC. An audit checks the logged contacts after the session.
///
/// The file has tagged, little-endian entries: one for each object when the HRTC adds it, one per cycle for each probe
/// and each object near it, and one summary per object at the end. A contact is identified by the corner positions of
/// its triangle, so the audit needs the model, but no face numbers. Writing may block: not for the haptic thread. If
/// the HRTC was killed, the last entry of its log may be truncated; reading ends before this entry.
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

/// Returns a 64-bit hash of a triangle's oriented corner positions, the same for its three rotations. Realtime.
[[nodiscard]] std::uint64_t triangle_key(const std::array<float, 9>& corners) noexcept;

struct LoggedObject {
  std::uint32_t index = 0;
  std::uint64_t digest = 0;
  double scale = 1;  ///< metres per file unit
  std::string name;
};

struct LoggedContact {
  std::uint64_t triangle;  ///< triangle_key() of the triangle
  float depth;             ///< file units
};

/// The contacts of one probe with one object in one cycle.
struct LoggedQuery {
  static constexpr std::uint32_t kMaxContacts = 512;
  std::int64_t time_ns = 0;  ///< time of the cycle, monotonic clock of the HRTC
  std::uint32_t object = 0;  ///< LoggedObject::index
  std::uint32_t probe = 0;
  std::array<double, 3> centre{};  ///< of the tip, or the coupling point of a tool; model frame, file units
  double radius = 0;               ///< radius of the tip, file units
  std::uint64_t mesh_hash = 0;
  std::uint32_t since_change = 0;  ///< number of cycles since a region was refined or coarsened; 0: in this cycle
  bool exact = false;
  bool truncated = false;  ///< there were more than kMaxContacts contacts
  std::uint32_t contact_count = 0;
  std::array<LoggedContact, kMaxContacts> contacts;
};

/// Totals of the loader for an object over the whole session.
struct LoggedTotals {
  std::uint32_t object = 0;
  std::uint64_t records_received = 0;        ///< number of received records, with repetitions
  std::uint64_t records_received_again = 0;  ///< number of these that had been received before
  std::uint64_t regions_received = 0;
  std::uint64_t regions_released = 0;
};

class ContactLogWriter {
 public:
  /// Throws LogError that names the file if it cannot be created.
  explicit ContactLogWriter(const std::filesystem::path& path);
  /// Closes the file and ignores errors.
  ~ContactLogWriter();
  ContactLogWriter(const ContactLogWriter&) = delete;
  ContactLogWriter& operator=(const ContactLogWriter&) = delete;

  void write(const LoggedObject& object);
  void write(const LoggedQuery& query);
  void write(const LoggedTotals& totals);
  /// Gives the buffered entries to the system, so that they remain if this program is killed.
  void flush();
  /// False after a failed write, for example on a full disk. Writes are buffered: a failure may show only in a later
  /// write, a flush or at the close. Earlier entries remain readable.
  [[nodiscard]] bool healthy() const noexcept { return healthy_; }
  /// Writes the buffered entries. Returns whether the file has all entries. No entry may be written afterwards.
  [[nodiscard]] bool close();

 private:
  void put(const void* data, std::size_t size);
  std::FILE* file_;
  bool healthy_ = true;
};

/// Reads entries in order. All functions throw LogError if the file cannot be read, is not a log or has another
/// version, or if an entry is damaged.
class ContactLogReader {
 public:
  explicit ContactLogReader(const std::filesystem::path& path);
  ~ContactLogReader();
  ContactLogReader(const ContactLogReader&) = delete;
  ContactLogReader& operator=(const ContactLogReader&) = delete;

  enum class Entry { kEnd, kObject, kQuery, kTotals };
  /// Reads the next entry into `object`, `query` or `totals`, and returns its kind; kEnd at the end of the file.
  [[nodiscard]] Entry next();
  /// True if the last entry is truncated. Call after kEnd.
  [[nodiscard]] bool is_truncated() const noexcept { return is_truncated_; }
  LoggedObject object;
  LoggedQuery query;
  LoggedTotals totals;

 private:
  [[nodiscard]] bool get(void* data, std::size_t size);
  std::FILE* file_;
  std::string name_;
  bool is_truncated_ = false;
};

}  // namespace tactus::trace
