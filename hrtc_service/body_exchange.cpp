#include "hrtc_service/body_exchange.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <mutex>

#include "realtime/periodic_clock.hpp"
#include "session/units.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kReleasedEndpointsNs = 2000 * kMs;  // lifetime of the endpoints after the release of an object

}  // namespace

BodyExchange::BodyExchange(wire::Participants& participants, BodyLink& link, Gateway& gateway)
    : participants_{participants},
      copies_out_{link.copies},
      reports_in_{link.reports},
      gateway_{gateway},
      claims_out_{participants, wire::topics::kObjectClaim},
      poses_out_{participants, wire::topics::kObjectPose} {}
BodyExchange::~BodyExchange() = default;

void BodyExchange::add(const ObjectDescription& object) {
  if (!object.body) return;
  slots_[object.index].id = object.id;
  slots_[object.index].centre = plain(object.body->centre);
  slots_out_.post(slots_);
}

void BodyExchange::remove(std::uint32_t object_index, std::uint64_t object_id) {
  slots_[object_index] = {};
  const std::uint64_t posted = slots_out_.post(slots_);
  if (const auto at = endpoints_.find(object_id); at != endpoints_.end()) {
    dropped_.add(posted, std::move(at->second.writer));
    endpoints_.erase(at);
  }
  const std::lock_guard lock{ring_mutex_};
  past_implausible_ += copy_admissions_[object_index].implausible();
  copy_admissions_[object_index] = {};
  copy_received_ns_[object_index] = 0;
}

void BodyExchange::on_copy(std::uint32_t object, const session::ObjectCopy& copy) {
  if (copy.origin.participant == participants_.origin().participant) return;
  const std::int64_t now_ns = realtime::monotonic_ns();
  const std::int64_t session_now_ns = now_ns + session_offset_ns_.load(std::memory_order_relaxed);
  const std::lock_guard lock{ring_mutex_};
  if (!copy_admissions_[object].accept(copy, now_ns, session_now_ns)) return;
  copy_received_ns_[object].store(now_ns, std::memory_order_relaxed);
  const std::int64_t transit_ns = session_now_ns - copy.session_time_ns;
  if (transit_ns > copy_transit_ns_.load(std::memory_order_relaxed))
    copy_transit_ns_.store(transit_ns, std::memory_order_relaxed);
  (void)copies_out_.push({object, copy.copy_index, copy.fencing, sharing::sample_of(copy)});
}

void BodyExchange::sync_endpoints(std::int64_t now_ns) {
  for (const OwnershipClient::BodyStatus& body : gateway_.ownership().bodies()) {
    if (!body.is_touched) continue;
    Endpoints& endpoints = endpoints_[body.id];
    endpoints.held_ns = now_ns;
    if (endpoints.writer != nullptr) continue;
    endpoints.object = body.object_index;
    const wire::EndpointOptions where{wire::group_partition(body.id)};
    endpoints.writer =
        std::make_unique<wire::Writer<session::ObjectCopy>>(participants_, wire::topics::kObjectCopy, where);
    endpoints.reader = std::make_unique<wire::Reader<session::ObjectCopy>>(
        participants_, wire::topics::kObjectCopy,
        [this, object = body.object_index](session::ObjectCopy&& copy) { on_copy(object, copy); }, where);
    slots_[body.object_index].copies = endpoints.writer.get();
    slots_out_.post(slots_);
  }
  for (auto at = endpoints_.begin(); at != endpoints_.end();) {
    if (now_ns - at->second.held_ns < kReleasedEndpointsNs) {
      ++at;
      continue;
    }
    slots_[at->second.object].copies = nullptr;
    dropped_.add(slots_out_.post(slots_), std::move(at->second.writer));
    at = endpoints_.erase(at);
  }
}

void BodyExchange::tick(std::int64_t now_ns, const session::ClockMap& clock) {
  dropped_.collect([this](std::uint64_t number) { return slots_out_.is_adopted(number); });
  if (gateway_.ownership().bodies().empty()) return;
  session_offset_ns_ = clock.session_time(now_ns) - now_ns;
  sync_endpoints(now_ns);
  for (const auto& [id, endpoints] : endpoints_)
    gateway_.on_peer_received(endpoints.object, copy_received_ns_[endpoints.object].load(std::memory_order_relaxed));
  if (const std::int64_t transit_ns = copy_transit_ns_.exchange(-1); transit_ns >= 0)
    gateway_.on_transit(transit_ns, clock.session_time(now_ns));
}

void BodyExchange::admit_groups() {
  for (const auto& [id, endpoints] : endpoints_) {
    const session::ObjectGrant& group = gateway_.ownership().group(endpoints.object);
    const std::lock_guard lock{ring_mutex_};
    session::CopyAdmission& admission = copy_admissions_[endpoints.object];
    if (admission.fencing() != group.fencing) admission.set_group(group);
  }
}

void BodyExchange::after_tick() {
  admit_groups();
  for (const session::ObjectClaim& claim : gateway_.claims()) (void)claims_out_.send(claim);
}

std::uint64_t BodyExchange::implausible() const {
  const std::lock_guard lock{ring_mutex_};
  std::uint64_t all = past_implausible_;
  for (const session::CopyAdmission& admission : copy_admissions_) all += admission.implausible();
  return all;
}

void BodyExchange::send() {
  const Slots& slots = slots_out_.latest();
  BodyReports reports;
  if (!reports_in_.take(reports)) return;
  for (std::uint32_t i = 0; i < reports.count; ++i) {
    const BodyReport& body = reports.bodies[i];
    const Slot& slot = slots[body.object];
    Sent& sent = sent_[body.object];
    if (slot.id == 0) continue;
    if (body.copies > 0 && slot.copies != nullptr) {
      session::ObjectCopy copy;
      copy.origin = participants_.origin();
      copy.object_id = slot.id;
      copy.sequence = ++sent.copy_sequence;
      copy.fencing = body.coupling_fencing;
      copy.copy_index = body.copy_index;
      sharing::put_sample(body.sample, body.copies, copy);
      (void)slot.copies->send(copy);
    }
    if (body.publish_fencing == 0 || reports.time_ns - sent.pose_sent_ns < kPosePeriodNs) continue;
    sent.pose_sent_ns = reports.time_ns;
    session::ObjectPose pose;
    pose.origin = participants_.origin();
    pose.object_id = slot.id;
    pose.sequence = ++sent.pose_sequence;
    pose.fencing = body.publish_fencing;
    pose.session_time_ns = reports.session_ns;
    sharing::put_state(body.state, vec(slot.centre), pose);
    (void)poses_out_.send(pose);
  }
}

}  // namespace tactus::hrtc_service
