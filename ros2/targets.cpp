#include "ros2/targets.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "ros2/names.hpp"
#include "session/messages.hpp"
#include "session/printable.hpp"
#include "session/units.hpp"
#include "trace/cdr.hpp"

namespace tactus::ros2 {
namespace {

constexpr std::string_view kBegin = "rt/tactus/", kEnd = "/target_pose";
constexpr std::int64_t kReportNs = 1000 * kMs;  // between two reports about a topic
constexpr std::int64_t kRetryNs = 1000 * kMs;   // from a refusal to the next request of a probe
constexpr std::int64_t kUnusedNs = 5000 * kMs;  // after this time without a publisher, a topic has no reader any more
constexpr double kMaxCoordinate = 100;          // m, as for a page
constexpr double kUnitTolerance = 1e-3;

/// The begin of a text from the network, without control characters.
std::string printable_begin(std::string text) {
  text.resize(std::min(text.size(), session::kMaxName));
  return session::printable(text);
}

/// True for names that a page may choose too.
bool is_plain(const std::string& user) {
  constexpr std::size_t kMax = 32;
  constexpr std::string_view kOthers = "-_.";
  return user.size() <= kMax && std::all_of(user.begin(), user.end(), [&](char byte) {
           return (byte >= 'a' && byte <= 'z') || (byte >= 'A' && byte <= 'Z') || (byte >= '0' && byte <= '9') ||
                  kOthers.find(byte) != std::string_view::npos;
         });
}

}  // namespace

std::optional<std::string> target_user(const std::string& dds_topic) {
  const std::string_view topic = dds_topic;
  if (topic.size() <= kBegin.size() + kEnd.size() || !topic.starts_with(kBegin) || !topic.ends_with(kEnd))
    return std::nullopt;
  return name_of(topic.substr(kBegin.size(), topic.size() - kBegin.size() - kEnd.size()));
}

std::string fault_of(const PoseStamped& target, const std::string& frame) {
  if (target.header.frame_id != frame)
    return "found frame '" + printable_begin(target.header.frame_id) + "', expected '" + frame + "'";
  const auto& position = target.pose.position;
  if (!std::all_of(position.begin(), position.end(), [](double at) { return std::abs(at) <= kMaxCoordinate; }))
    return "found a position that is not within 100 m of the origin";
  double square = 0;
  for (const double number : target.pose.orientation) square += number * number;
  if (!(std::abs(std::sqrt(square) - 1) <= kUnitTolerance)) return "found an orientation that is no unit quaternion";
  return {};
}

Targets::Targets(viewer::PointedUsers& users, wire::RosDomain& domain, TargetSettings settings,
                 std::function<void(const std::string&)> on_event)
    : users_{users}, domain_{domain}, settings_{std::move(settings)}, on_event_{std::move(on_event)} {
  users_.on_refused = [this](viewer::SourceId source, const std::string& reason) {
    const auto topic = topics_.find(source);
    if (topic == topics_.end()) return;
    topic->second.refused_ns = now_ns_;
    report(topic->second, "has no probe: " + reason);
  };
}

/// Reports a text once, until another one follows, and at most one a second.
void Targets::report(Topic& topic, const std::string& text) const {
  if (topic.report == text || (!topic.report.empty() && now_ns_ - topic.reported_ns < kReportNs)) return;
  topic.report = text;
  topic.reported_ns = now_ns_;
  on_event_("target poses of " + topic.user + ": " + text);
}

void Targets::add_topic(const wire::RosDomain::Discovered& writer, std::int64_t now_ns) {
  const std::optional<std::string> user = target_user(writer.topic);
  if (!user) return;
  const std::string topic = "/tactus/" + ros_name(*user) + std::string{kEnd};
  if (writer.type != PoseStamped::kType.name)
    return on_event_("topic " + topic + ": found type " + printable_begin(writer.type) + ", expected " +
                     PoseStamped::kType.name);
  if (!is_plain(*user))
    return on_event_("topic " + topic +
                     " is ignored: expected a user name of at most 32 letters, digits, '-', '_', '.'");
  const viewer::SourceId source = session::id_of(*user);
  if (topics_.count(source) != 0) return;
  if (topics_.size() >= kMaxTopics)
    return on_event_("topic " + topic + " is ignored: " + std::to_string(kMaxTopics) + " have target poses already");
  try {
    topics_.emplace(source, Topic{*user, {domain_, topic, PoseStamped::kType, "ros2_target_reader"}, now_ns, 0, {}, 0});
  } catch (const wire::WireError& error) {
    on_event_(error.what());
  }
}

void Targets::process(viewer::SourceId source, Topic& topic, std::int64_t now_ns) {
  if (!topic.reader.take(message_)) return;
  PoseStamped target;
  try {
    trace::CdrReader read{message_};
    read(target);
  } catch (const trace::CdrError& error) {
    return report(topic, error.what());
  }
  if (const std::string fault = fault_of(target, settings_.frame); !fault.empty()) return report(topic, fault);
  if (!users_.has_user(source)) {
    if (topic.refused_ns != 0 && now_ns - topic.refused_ns < kRetryNs) return;
    users_.on_touch(source, {topic.user, settings_.hrtc}, now_ns);
  }
  users_.on_hand(source, {target.pose.position, false, target.pose.orientation}, now_ns);
}

void Targets::step(std::int64_t now_ns) {
  now_ns_ = now_ns;
  for (const wire::RosDomain::Discovered& writer : domain_.take_discovered()) add_topic(writer, now_ns);
  for (auto& [source, topic] : topics_) {
    process(source, topic, now_ns);
    if (topic.reader.matched() > 0) topic.used_ns = now_ns;
  }
  std::erase_if(topics_, [&](const auto& topic) {
    return now_ns - topic.second.used_ns > kUnusedNs && !users_.has_user(topic.first);
  });
}

}  // namespace tactus::ros2
