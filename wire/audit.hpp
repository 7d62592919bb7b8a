/// The audit log of a secured session: who joined, who was refused, and why.
///
/// One JSON object in each line. The next call of `write` writes the first of equal events. Further ones are counted
/// and written as one line after 1 s, then after 2 s, 4 s and so on, at most 60 s. An event that does not occur for
/// this interval and 60 s more counts as new. Events that cannot be written are written later. Above kMaxBytes, the
/// file becomes FILE.1, and a new one begins, so two files use at most twice this size. Only the owner can read them.
///
///     {"time":"2026-11-26T10:00:00Z","session":"lab","program":"desk","event":"false sender",
///      "subject":"user laptop","detail":"tactus_stop","count":3}
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "realtime/inheriting_mutex.hpp"

namespace tactus::wire {

struct AuditEvent {
  std::string event;    ///< what was refused (docs/reference/audit.md)
  std::string subject;  ///< role and name of the member; with `from`, as the sender states them
  std::string from;     ///< address of the sender, if known
  std::string detail;

  [[nodiscard]] auto key() const { return std::tie(event, subject, from, detail); }
  [[nodiscard]] bool operator<(const AuditEvent& other) const { return key() < other.key(); }
};

class AuditLog {
 public:
  static constexpr std::uintmax_t kMaxBytes = 16u << 20u;
  /// Max number of different events that are recorded; further ones are only counted, as the event `further events`.
  static constexpr std::size_t kMaxEvents = 256;

  AuditLog(std::filesystem::path file, std::string session, std::string program);

  /// Any thread; does not write.
  void add(AuditEvent event);
  /// Writes the events that are due; also the others if there are kMaxEvents, or if `all`. Returns why the file cannot
  /// be written; empty if it can. One thread.
  [[nodiscard]] std::string write(std::int64_t now_ns, bool all = false);

 private:
  struct Repeated {
    std::uint64_t count = 0;  // since the last line
    std::int64_t due_ns = 0, interval_ns = 0;
  };

  [[nodiscard]] std::vector<std::pair<AuditEvent, std::uint64_t>> take_due(std::int64_t now_ns, bool all);
  void put_back(const std::vector<std::pair<AuditEvent, std::uint64_t>>& events);

  const std::filesystem::path file_;
  const std::string session_, program_;
  realtime::InheritingMutex mutex_;  // Members calls `add` under a mutex of this kind
  std::map<AuditEvent, Repeated> events_;
};

}  // namespace tactus::wire
