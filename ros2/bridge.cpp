#include "ros2/bridge.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include "realtime/process.hpp"
#include "ros2/publisher.hpp"
#include "ros2/targets.hpp"
#include "viewer/viewer_participant.hpp"
#include "wire/error.hpp"
#include "wire/ros2.hpp"

namespace tactus::ros2 {
namespace {

using realtime::monotonic_ns;

/// Refinement in a tick. It takes some 0.5 ms.
constexpr std::uint32_t kBudget = 1u << 14;
constexpr std::int64_t kTargetsNs = 4'000'000;  // between two reads of target poses

std::int64_t since_1970_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

/// Returns the ROS domain. Throws WireError if the session uses it. Call it after the session's domain was checked.
int free_domain(const BridgeOptions& options) {
  const int first = options.address.domain, last = first + wire::kTrafficClasses - 1;
  if (options.domain < first || options.domain > last) return options.domain;
  throw wire::WireError("--ros-domain: found " + std::to_string(options.domain) +
                        ", a domain of the session, expected one outside " + std::to_string(first) + " to " +
                        std::to_string(last));
}

}  // namespace

struct Bridge::Impl {
  explicit Impl(BridgeOptions given)
      : options{std::move(given)},
        participant{
            {.address = options.address, .settings = {.pool = options.pool, .budget = kBudget}, .source = "topic"}},
        domain{free_domain(options), options.address.qos},
        publisher{participant.core(), domain, options.frame, options.log},
        targets{participant.users(), domain, {options.frame, options.hrtc}, options.log} {
    participant.core().on_event = options.log;
  }

  BridgeOptions options;
  viewer::ViewerParticipant participant;
  wire::RosDomain domain;
  Publisher publisher;
  Targets targets;
};

Bridge::Bridge(BridgeOptions options) : impl_{std::make_unique<Impl>(std::move(options))} {}
Bridge::~Bridge() = default;

int Bridge::run(const std::atomic<bool>& stop) {
  Impl& bridge = *impl_;
  viewer::ViewerCore& core = bridge.participant.core();
  const auto period_ns = static_cast<std::int64_t>(1e9 / bridge.options.rate);
  std::int64_t publish_ns = monotonic_ns(), targets_ns = publish_ns;
  while (!stop && !core.is_name_taken()) {
    // Once in each round, so that the session goes on when a publication takes longer than its period.
    const std::int64_t wait_ns = std::max<std::int64_t>(std::min(publish_ns, targets_ns) - monotonic_ns(), 0);
    bridge.participant.step(std::chrono::microseconds{(wait_ns + 999) / 1000});
    const std::int64_t now_ns = monotonic_ns();
    if (now_ns >= targets_ns) {
      targets_ns = now_ns + kTargetsNs;
      if (bridge.options.takes_targets) bridge.targets.step(now_ns);
    }
    if (now_ns < publish_ns) continue;
    bridge.publisher.publish(now_ns, since_1970_ns());
    publish_ns = std::max(publish_ns + period_ns, monotonic_ns());
    if (bridge.publisher.wants_meshes()) bridge.participant.load_meshes();
  }
  bridge.participant.leave();
  return core.is_name_taken() ? 2 : 0;
}

}  // namespace tactus::ros2
