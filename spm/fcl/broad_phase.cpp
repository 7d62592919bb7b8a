#include "spm/fcl/broad_phase.hpp"

#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/geometry/shape/box.h>
#include <fcl/narrowphase/collision_object.h>

#include <algorithm>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <tuple>

namespace tactus::spm::fcl {

namespace {

struct Object {
  std::uint32_t number = 0;
  WorldBox box;
  std::unique_ptr<::fcl::CollisionObjectd> shape;
};

// Makes a box for FCL. FCL stores a box as centre and edges. Their rounding may make the box smaller, so this function
// adds a margin. Pairs that FCL finds only because of the margin fail the exact test in add_pair().
std::unique_ptr<::fcl::CollisionObjectd> shape_of(const WorldBox& box) {
  constexpr double kSlack = 1e-12;
  const Vec3d margin = Vec3d::Constant(kSlack * (1 + box.low.cwiseAbs().cwiseMax(box.high.cwiseAbs()).maxCoeff()));
  const Vec3d edges = box.high - box.low + 2 * margin;
  ::fcl::Transform3d pose = ::fcl::Transform3d::Identity();
  pose.translation() = 0.5 * (box.low + box.high);
  auto shape = std::make_unique<::fcl::CollisionObjectd>(std::make_shared<::fcl::Boxd>(edges), pose);
  shape->computeAABB();
  return shape;
}

bool intersects(const BoundingSphere& sphere, const WorldBox& box) {
  const Vec3d nearest = sphere.centre.cwiseMax(box.low).cwiseMin(box.high);
  return (sphere.centre - nearest).squaredNorm() <= sphere.radius * sphere.radius;
}

struct Query {
  const BoundingSphere* sphere;
  std::uint32_t probe;
  std::vector<NearPair>* pairs;
};

// FCL calls this for each object whose box intersects the box of the probe's sphere. Returns false, so that FCL
// continues.
bool add_pair(::fcl::CollisionObjectd* a, ::fcl::CollisionObjectd* b, void* data) {
  const auto& query = *static_cast<const Query*>(data);
  // The shapes of objects have user data, the shape of a probe has none.
  const void* user = a->getUserData() != nullptr ? a->getUserData() : b->getUserData();
  const auto& object = *static_cast<const Object*>(user);
  if (intersects(*query.sphere, object.box)) query.pairs->push_back({query.probe, object.number});
  return false;
}

}  // namespace

struct BroadPhase::Manager {
  ::fcl::DynamicAABBTreeCollisionManagerd tree;
  std::map<std::uint32_t, Object> objects;  // a map does not move its values, to which FCL has pointers
};

BroadPhase::BroadPhase() : manager_{std::make_unique<Manager>()} {}
BroadPhase::~BroadPhase() = default;
BroadPhase::BroadPhase(BroadPhase&&) noexcept = default;
BroadPhase& BroadPhase::operator=(BroadPhase&&) noexcept = default;

void BroadPhase::put(std::uint32_t object, const WorldBox& box) {
  if (!box.low.allFinite() || !box.high.allFinite() || (box.low.array() > box.high.array()).any()) {
    throw std::invalid_argument("BroadPhase::put: the box of object " + std::to_string(object) +
                                " is inverted or not finite");
  }
  remove(object);
  Object& entry = manager_->objects[object];
  entry = {object, box, shape_of(box)};
  entry.shape->setUserData(&entry);
  manager_->tree.registerObject(entry.shape.get());
  manager_->tree.setup();
}

void BroadPhase::remove(std::uint32_t object) {
  const auto found = manager_->objects.find(object);
  if (found == manager_->objects.end()) return;
  manager_->tree.unregisterObject(found->second.shape.get());
  manager_->tree.setup();
  manager_->objects.erase(found);
}

std::vector<NearPair> BroadPhase::find_near_pairs(std::span<const BoundingSphere> probes) const {
  std::vector<NearPair> pairs;
  for (std::uint32_t i = 0; i < probes.size(); ++i) {
    const BoundingSphere& sphere = probes[i];
    if (!sphere.centre.allFinite() || !(sphere.radius >= 0)) {
      std::ostringstream text;
      text << "BroadPhase::find_near_pairs: probe " << i << ": found radius " << sphere.radius << " and centre "
           << sphere.centre.transpose() << ", expected finite numbers and a radius of at least 0";
      throw std::invalid_argument(text.str());
    }
    const Vec3d reach = Vec3d::Constant(sphere.radius);
    const auto shape = shape_of({sphere.centre - reach, sphere.centre + reach});
    Query query{&sphere, i, &pairs};
    manager_->tree.collide(shape.get(), &query, add_pair);
  }
  std::sort(pairs.begin(), pairs.end(), [](const NearPair& a, const NearPair& b) {
    return std::tie(a.probe, a.object) < std::tie(b.probe, b.object);
  });
  return pairs;
}

}  // namespace tactus::spm::fcl
