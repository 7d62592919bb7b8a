// Replaces FCL's tree of boxes in WebAssembly, where FCL is missing: tests each pair. A page has one object.
#include "spm/fcl/broad_phase.hpp"

#include <algorithm>
#include <map>
#include <stdexcept>

namespace tactus::spm::fcl {

struct BroadPhase::Manager {
  std::map<std::uint32_t, WorldBox> boxes;
};

BroadPhase::BroadPhase() : manager_{std::make_unique<Manager>()} {}
BroadPhase::~BroadPhase() = default;
BroadPhase::BroadPhase(BroadPhase&&) noexcept = default;
BroadPhase& BroadPhase::operator=(BroadPhase&&) noexcept = default;

void BroadPhase::put(std::uint32_t object, const WorldBox& box) {
  if (!box.low.allFinite() || !box.high.allFinite() || (box.low.array() > box.high.array()).any())
    throw std::invalid_argument("bounds of object " + std::to_string(object) + " are not a box");
  manager_->boxes[object] = box;
}

void BroadPhase::remove(std::uint32_t object) { manager_->boxes.erase(object); }

std::vector<NearPair> BroadPhase::find_near_pairs(std::span<const BoundingSphere> probes) const {
  std::vector<NearPair> pairs;
  for (std::uint32_t probe = 0; probe < probes.size(); ++probe) {
    const BoundingSphere& sphere = probes[probe];
    if (!sphere.centre.allFinite() || !(sphere.radius >= 0)) throw std::invalid_argument("a probe is not finite");
    for (const auto& [object, box] : manager_->boxes) {
      const Vec3d nearest = sphere.centre.cwiseMax(box.low).cwiseMin(box.high);
      if ((nearest - sphere.centre).norm() <= sphere.radius) pairs.push_back({probe, object});
    }
  }
  return pairs;
}

}  // namespace tactus::spm::fcl
