#include "hrtc_service/shown_sender.hpp"

#include <algorithm>
#include <vector>

#include "session/units.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMinBetweenNs = 50 * kMs;      // between two samples of an object whose mesh changes
constexpr std::int64_t kMaxBetweenNs = 500 * kMs;     // between two samples of any object
constexpr std::int64_t kRequestTimeoutNs = 20 * kMs;  // the servo answers in the next cycle, unless the object is gone

}  // namespace

void ShownSender::send(std::int64_t now_ns, const session::Origin& origin) {
  for (const Loader::ObjectInfo& object : loader_.objects()) {
    if (object.index != report_.object || object.id != requested_id_) continue;
    session::ShownRegions sample;
    sample.origin = origin;
    sample.object_id = object.id;
    sample.digest = object.digest;
    sample.mesh_hash = report_.mesh_hash;
    sample.complete = report_.count <= report_.regions.size();
    const std::size_t count = std::min<std::size_t>(report_.count, report_.regions.size());
    for (std::size_t i = 0; i < count; ++i)
      if (const spm::Forest::InUse& region = report_.regions[i]; region.applied > 0)
        sample.regions.push_back({spm::index(region.region), region.applied});
    (void)out_.send(sample);
    sent_[object.index] = {object.id, report_.mesh_hash, now_ns};
  }
}

void ShownSender::request_next(std::int64_t now_ns) {
  if (now_ns - requested_ns_ < kRequestTimeoutNs) return;
  const MeshHashes& hashes = mesh_hashes_.latest();
  const Loader::ObjectInfo* next = nullptr;
  const std::vector<Loader::ObjectInfo> objects = loader_.objects();
  std::int64_t longest_ns = 0;
  for (const Loader::ObjectInfo& object : objects) {
    const Sent& sent = sent_[object.index];
    const bool has_changed = sent.object_id != object.id || sent.mesh_hash != hashes[object.index];
    const std::int64_t since_ns = now_ns - sent.at_ns;
    if (since_ns < (has_changed ? kMinBetweenNs : kMaxBetweenNs) || since_ns <= longest_ns) continue;
    next = &object;
    longest_ns = since_ns;
  }
  if (next == nullptr) return;
  requested_ns_ = now_ns;
  requested_id_ = next->id;
  link_.request_shown(next->index);
}

void ShownSender::tick(std::int64_t now_ns, const session::Origin& origin) {
  if (out_.matched() == 0) {
    (void)reports_.take(report_);  // of the time when a reader was matched
    requested_ns_ = 0;
    return;
  }
  if (reports_.take(report_)) {
    send(now_ns, origin);
    requested_ns_ = 0;
  }
  request_next(now_ns);
}

}  // namespace tactus::hrtc_service
