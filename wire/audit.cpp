#include "wire/audit.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

#include "keys/member.hpp"

namespace tactus::wire {
namespace {

constexpr char kFurther[] = "further events";
constexpr std::int64_t kMinIntervalNs = 1'000'000'000, kMaxIntervalNs = 60'000'000'000;

/// Keeps the lines valid, whatever bytes a sender has sent.
std::string line_of(const nlohmann::ordered_json& object) {
  return object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

/// Opens a file to append to it. A regular file gets the permissions 0600, also if it existed.
int open_private(const std::filesystem::path& path) {
  const int file = ::open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NOFOLLOW, S_IRUSR | S_IWUSR);
  struct stat status {};
  if (file >= 0 && ::fstat(file, &status) == 0 && S_ISREG(status.st_mode)) (void)::fchmod(file, S_IRUSR | S_IWUSR);
  return file;
}

}  // namespace

AuditLog::AuditLog(std::filesystem::path file, std::string session, std::string program)
    : file_{std::move(file)}, session_{std::move(session)}, program_{std::move(program)} {}

void AuditLog::add(AuditEvent event) {
  const std::lock_guard lock{mutex_};
  if (events_.size() >= kMaxEvents && events_.count(event) == 0) event = {kFurther, "", "", ""};
  ++events_[std::move(event)].count;
}

std::vector<std::pair<AuditEvent, std::uint64_t>> AuditLog::take_due(std::int64_t now_ns, bool all) {
  std::vector<std::pair<AuditEvent, std::uint64_t>> due;
  const std::lock_guard lock{mutex_};
  all = all || events_.size() >= kMaxEvents;
  for (auto& [event, repeated] : events_) {
    if (repeated.count == 0 || (!all && now_ns < repeated.due_ns)) continue;
    due.emplace_back(event, std::exchange(repeated.count, 0));
    repeated.interval_ns = std::clamp(2 * repeated.interval_ns, kMinIntervalNs, kMaxIntervalNs);
    repeated.due_ns = now_ns + repeated.interval_ns;
  }
  std::erase_if(events_, [&](const auto& entry) { return all || now_ns >= entry.second.due_ns + kMaxIntervalNs; });
  return due;
}

std::string AuditLog::write(std::int64_t now_ns, bool all) {
  const std::vector<std::pair<AuditEvent, std::uint64_t>> events = take_due(now_ns, all);
  if (events.empty()) return "";
  const std::string time = keys::utc_text(std::time(nullptr), "%Y-%m-%dT%H:%M:%SZ");
  std::string lines;
  for (const auto& [event, count] : events) {
    nlohmann::ordered_json object{{"time", time}, {"session", session_}, {"program", program_}, {"event", event.event}};
    for (const auto& [name, text] :
         {std::pair{"subject", &event.subject}, {"from", &event.from}, {"detail", &event.detail}})
      if (!text->empty()) object[name] = *text;
    object["count"] = count;
    lines += line_of(object);
  }
  int file = open_private(file_);
  if (file >= 0 && ::lseek(file, 0, SEEK_END) > static_cast<off_t>(kMaxBytes) &&
      ::rename(file_.c_str(), (file_.string() + ".1").c_str()) == 0) {
    ::close(file);
    file = open_private(file_);
  }
  if (file < 0) {
    const std::string error = file_.string() + ": " + std::strerror(errno);
    put_back(events);
    return error;
  }
  const off_t end = ::lseek(file, 0, SEEK_END);
  errno = ENOSPC;  // for a write that is too short
  const bool is_written = ::write(file, lines.data(), lines.size()) == static_cast<ssize_t>(lines.size());
  const std::string error = is_written ? "" : file_.string() + ": " + std::strerror(errno);
  if (!is_written) {
    (void)!::ftruncate(file, end);  // no part of a line remains
    put_back(events);
  }
  ::close(file);
  return error;
}

/// The next call of `write` writes these events.
void AuditLog::put_back(const std::vector<std::pair<AuditEvent, std::uint64_t>>& events) {
  const std::lock_guard lock{mutex_};
  for (const auto& [event, count] : events) {
    const bool has_entry = events_.size() < kMaxEvents || events_.count(event) > 0;
    Repeated& repeated = events_[has_entry ? event : AuditEvent{kFurther, "", "", ""}];
    repeated.count += count;
    repeated.due_ns = 0;
  }
}

}  // namespace tactus::wire
