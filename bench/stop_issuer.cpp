#include "bench/stop_issuer.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "bench/live_session.hpp"
#include "realtime/realtime.hpp"
#include "session/stop_latch.hpp"
#include "session/units.hpp"

namespace tactus::bench {
namespace {

using realtime::monotonic_ns;

constexpr std::int64_t kRepeatNs = 20 * kMs;  // as of tactus control
constexpr std::int64_t kPatienceNs = 5000 * kMs;
// The operator's machine has processors of its own. Here the operator shares the processors with all other programs, so
// it publishes at a real-time priority, below that of the threads that receive probe samples (50).
constexpr int kPriority = 40;

}  // namespace

StopIssuer::StopIssuer(const wire::SessionAddress& address, std::vector<std::string> receivers)
    : participants_{address},
      receivers_{std::move(receivers)},
      roster_{participants_.origin(), {}},
      stop_out_{participants_, wire::topics::kStop},
      reset_out_{participants_, wire::topics::kReset},
      reader_{participants_, wire::topics::kRoster,
              [this](session::RosterEntry&& entry) { inbox_.put(std::move(entry)); }} {}

void StopIssuer::wait_for_receivers() {
  const std::int64_t end_ns = monotonic_ns() + 20'000 * kMs;
  const int count = static_cast<int>(receivers_.size());
  const auto is_present = [this](const std::string& name) { return roster_.find(session::id_of(name)) != nullptr; };
  while (stop_out_.matched() < count || reset_out_.matched() < count ||
         !std::all_of(receivers_.begin(), receivers_.end(), is_present)) {
    if (realtime::stop_signal() || monotonic_ns() >= end_ns)
      throw std::runtime_error{"the operator has not discovered all hosts and HRTCs"};
    receive_until(monotonic_ns() + kRepeatNs);
  }
}

std::int64_t StopIssuer::stop() {
  Delivery<session::EmergencyStop> delivery{{participants_.origin(), ++stops_, "benchmark"}};
  deliver(stop_out_, delivery);
  newest_ = delivery.sample.name();
  was_repeated_ = delivery.writes > 1;
  return delivery.first_ns;
}

void StopIssuer::reset() {
  Delivery<session::ForceReset> delivery{{participants_.origin(), ++resets_, {newest_}, "benchmark"}};
  deliver(reset_out_, delivery);
  if (!delivery.is_acknowledged) throw std::runtime_error{"a reset was not acknowledged within 5 s"};
}

/// Uses a thread of its own, because programs that the calling thread starts would inherit its priority.
template <class Sample>
void StopIssuer::deliver(wire::Writer<Sample>& out, Delivery<Sample>& delivery) {
  receive_until(0);
  in_own_thread([&] {
    priority_note_ = realtime::enter_realtime("operator", kPriority);
    do {
      delivery.sample.origin = participants_.origin();
      const std::int64_t now_ns = monotonic_ns();
      if (delivery.first_ns == 0) delivery.first_ns = now_ns;
      if (out.send(delivery.sample) == wire::SendStatus::kInvalid)
        throw std::runtime_error{std::string{"the sample was not sent: "} + out.invalid_reason()};
      ++delivery.writes;
      do {
        receive_until(now_ns + kRepeatNs);
        delivery.is_acknowledged = is_acknowledged(delivery.sample);
      } while (!delivery.is_acknowledged && monotonic_ns() < now_ns + kRepeatNs);
    } while (!delivery.is_acknowledged && !realtime::stop_signal() && monotonic_ns() < delivery.first_ns + kPatienceNs);
  });
}

template <class Sample>
bool StopIssuer::is_acknowledged(const Sample& sample) const {
  return std::all_of(receivers_.begin(), receivers_.end(), [&](const std::string& name) {
    const session::RosterEntry* const entry = roster_.find(session::id_of(name));
    return entry != nullptr && session::acknowledges(*entry, sample);
  });
}

/// Applies the entries that have arrived. If there are none, waits for the first one until this time.
void StopIssuer::receive_until(std::int64_t until_ns) {
  const std::int64_t left_ns = std::max<std::int64_t>(0, until_ns - monotonic_ns());
  for (const auto& arrived : inbox_.take(std::chrono::microseconds{(left_ns + kUs - 1) / kUs}))
    (void)roster_.on_entry(arrived.sample, arrived.at_ns);
}

}  // namespace tactus::bench
