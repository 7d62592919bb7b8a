#include "wire/audit.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>
#include <nlohmann/json.hpp>
#include <utility>

#include "keys/member.hpp"

namespace tactus::wire {
namespace {

constexpr char kFurther[] = "further events";

/// Keeps the lines valid, whatever bytes a sender has sent.
std::string line_of(const nlohmann::ordered_json& object) {
  return object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

}  // namespace

AuditLog::AuditLog(std::filesystem::path file, std::string session, std::string program)
    : file_{std::move(file)}, session_{std::move(session)}, program_{std::move(program)} {}

void AuditLog::add(AuditEvent event) {
  const std::lock_guard<std::mutex> lock{mutex_};
  if (pending_.size() >= kMaxEvents && pending_.count(event) == 0) event = {kFurther, "", "", ""};
  ++pending_[std::move(event)];
}

std::string AuditLog::write() {
  std::map<AuditEvent, std::uint64_t> events;
  {
    const std::lock_guard<std::mutex> lock{mutex_};
    events.swap(pending_);
  }
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
  std::error_code ignored;
  if (std::filesystem::file_size(file_, ignored) > kMaxBytes && !ignored)
    std::filesystem::rename(file_, file_.string() + ".1", ignored);
  const int file = ::open(file_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NOFOLLOW, S_IRUSR | S_IWUSR);
  if (file < 0) return file_.string() + ": " + std::strerror(errno);
  errno = ENOSPC;  // for a write that is too short
  const bool is_written = ::write(file, lines.data(), lines.size()) == static_cast<ssize_t>(lines.size());
  const std::string error = is_written ? "" : file_.string() + ": " + std::strerror(errno);
  ::close(file);
  return error;
}

}  // namespace tactus::wire
