#include "hrtc_service/stop_switch.hpp"

#include <mutex>

namespace tactus::hrtc_service {

StopSwitch::StopSwitch(const session::Origin& self, ServoLink& link)
    : link_{link}, latch_{self}, resets_before_{link.stop().resets} {
  if (!link.stop().stopped) return;
  latch_.issue_stop();
  post_to_haptic_thread();
}

void StopSwitch::post_to_haptic_thread() noexcept {
  link_.set_stop({latch_.stopped(), resets_before_ + latch_.resets()});
}

bool StopSwitch::on_stop(const session::StopName& stop) {
  const std::lock_guard lock{mutex_};
  const bool is_new = latch_.on_stop(stop);
  post_to_haptic_thread();
  return is_new;
}

bool StopSwitch::on_reset(const session::ForceReset& reset) {
  const std::lock_guard lock{mutex_};
  const bool is_new = latch_.on_reset(reset);
  post_to_haptic_thread();
  return is_new;
}

bool StopSwitch::on_roster(const session::RosterEntry& entry) {
  if (entry.stops.empty()) return false;
  const std::lock_guard lock{mutex_};
  const bool is_new = latch_.on_roster(entry);
  post_to_haptic_thread();
  return is_new;
}

bool StopSwitch::issue_local_stop() {
  const std::uint32_t requests = link_.local_stops();
  if (requests == link_.local_stops_issued()) return false;
  const std::lock_guard lock{mutex_};
  latch_.issue_stop();
  post_to_haptic_thread();
  link_.set_local_stops_issued(requests);  // after the stop word, so that the haptic thread is stopped all the time
  return true;
}

bool StopSwitch::stopped() const {
  const std::lock_guard lock{mutex_};
  return latch_.stopped();
}

bool StopSwitch::acknowledge(std::vector<session::StopRecord>& records) {
  records.reserve(session::kMaxStops);
  const std::lock_guard lock{mutex_};
  if (latch_.changes() == acknowledged_ || !link_.obeys_stop()) return false;
  acknowledged_ = latch_.changes();
  records = latch_.records();
  return true;
}

}  // namespace tactus::hrtc_service
