#include "hrtc_service/gateway.hpp"

#include <utility>

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMaxTransitNs = 1'000'000'000;  // a larger difference is a wrong time stamp

}  // namespace

Gateway::Gateway(const spm::PoolSettings& pool, const session::Origin& self, const GatewaySettings& settings,
                 ServoLink& link)
    : link_{link},
      reports_in_{link.reports},
      body_reports_in_{link.bodies.reports},
      near_out_{link.near_objects},
      loader_{pool, self, settings.loader, link.intake},
      ownership_{self, link.bodies.granted, settings.ownership} {
  link_.set_in_session(false);
  loader_.on_event = [this](session::Severity severity, const std::string& text) {
    if (on_event) on_event(severity, text);
  };
  loader_.on_object_found = [this](const session::CatalogueEntry& entry) {
    if (on_object_found) on_object_found(entry);
  };
  loader_.on_object = [this](const ObjectDescription& object) {
    if (object.body) {
      ownership_.add(object.index, object.id, *object.body);
      movable_[object.id] = Movable{loader_.entry(object.index)};
    }
    if (on_object) on_object(object);
  };
  loader_.on_object_withdrawn = [this](const ObjectDescription& object) {
    ownership_.withdraw(object.index);
    movable_.erase(object.id);
  };
  loader_.on_object_gone = [this](const Loader::ObjectInfo& object) {
    if (on_object_gone) on_object_gone(object);
  };
}

void Gateway::on_pose(const session::ObjectPose& pose, std::int64_t now_ns, std::int64_t session_now_ns) {
  on_transit(session_now_ns - pose.session_time_ns, session_now_ns);
  ownership_.on_pose(pose, now_ns);
}

void Gateway::on_transit(std::int64_t transit_ns, std::int64_t session_now_ns) noexcept {
  if (transit_ns >= 0 && transit_ns < kMaxTransitNs) transit_.on_transit(transit_ns, session_now_ns);
}

void Gateway::take_reports() {
  has_new_reports_ = reports_in_.take(probe_reports_);
  if (!has_new_reports_) return;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ProbeOutput& probe = probe_reports_.probes[i];
    reported_probes_[i] = {probe.active,           (probe.status & session::kInContact) != 0,
                           probe_reports_.time_ns, vec(probe.device),
                           vec(probe.proxy),       quaternion(probe.orientation)};
  }
}

/// Passes the current poses of movable objects to the loader.
void Gateway::move_objects() {
  for (const OwnershipClient::BodyStatus& body : ownership_.bodies()) {
    const auto at = movable_.find(body.id);
    if (at == movable_.end()) continue;
    auto& [entry, moved] = at->second;
    if (body.pose.position == entry.pose.position && body.pose.orientation == entry.pose.orientation) continue;
    moved = true;
    entry.pose = body.pose;
    loader_.on_moved(body.object_index, Placement{entry.pose, entry.scale});
  }
}

void Gateway::tick(std::int64_t now_ns, const session::ClockMap& clock) {
  link_.beat();
  take_reports();
  claims_.clear();
  if (!ownership_.bodies().empty()) {
    if (body_reports_in_.take(body_reports_)) ownership_.on_reports(body_reports_);
    ownership_.on_transits(transit_);
    claims_ = ownership_.tick(now_ns, clock);
    move_objects();
  }
  loader_.tick(now_ns, reported_probes_, near_objects_);
  near_out_.post(near_objects_);
}

std::vector<session::CatalogueEntry> Gateway::collect_moved() {
  std::vector<session::CatalogueEntry> moved;
  for (auto& [id, movable] : movable_)
    if (std::exchange(movable.moved, false)) moved.push_back(movable.entry);
  return moved;
}

}  // namespace tactus::hrtc_service
