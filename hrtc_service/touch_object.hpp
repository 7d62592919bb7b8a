/// The haptic thread's view of an object, and the messages between that thread and the loader.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <boost/lockfree/spsc_queue.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "haptics/surface.hpp"
#include "session/messages.hpp"
#include "sharing/body.hpp"
#include "sharing/scene.hpp"
#include "spm/forest.hpp"

namespace tactus::hrtc_service {

using spm::Vec3d;

/// A vector as plain numbers, for structs that threads copy.
using Plain3 = std::array<double, 3>;
using Plain4 = std::array<double, 4>;
[[nodiscard]] inline Plain3 plain(const Vec3d& v) noexcept { return {v[0], v[1], v[2]}; }
/// x, y, z, w.
[[nodiscard]] inline Plain4 plain(const Eigen::Quaterniond& q) noexcept { return {q.x(), q.y(), q.z(), q.w()}; }
[[nodiscard]] inline Eigen::Quaterniond quaternion(const Plain4& q) noexcept { return {q[3], q[0], q[1], q[2]}; }
[[nodiscard]] inline Vec3d vec(const Plain3& v) noexcept { return {v[0], v[1], v[2]}; }

inline constexpr std::uint32_t kMaxProbes = 8;
inline constexpr std::uint32_t kMaxObjects = spm::kMaxObjects;
inline constexpr std::uint32_t kMaxBodies = 8;  ///< objects that an HRTC can move; further ones stay fixed
inline constexpr double kHandNear = 0.15;       ///< m; a hand so near to a body refines the surroundings of the body
static_assert(kMaxObjects <= 64, "bits in NearObjects");

using sharing::Placement;

/// Made by the loader, which also destroys it: after its Departure, or after the haptic thread has ended. In between
/// only the haptic thread touches `forest`.
struct TouchObject {
  std::uint32_t index = 0;  ///< of the cache, and bit in NearObjects
  std::uint64_t id = 0;
  std::uint64_t digest = 0;  ///< of the model
  std::string name;          ///< in the session; for messages
  Placement placement;       ///< at the time of its arrival
  session::Material material;
  std::optional<sharing::SharedBody> body;  ///< when it can move
  spm::CellBox bounds;                      ///< model frame
  double deviation = 0;                     ///< file units; no version of the mesh is further from the finest
  std::unique_ptr<spm::Forest> forest;
};

/// Finds where a body near a hand can touch an object that does not move: there the mesh must be the finest one. Calls
/// `visit(centre, radius)` with spheres in the model frame of the object with these bounds and this placement.
/// `hand_near(point, distance)`: whether some tip is that near to a point of the world.
template <class HandNear, class Visit>
void for_each_place_under(const sharing::SharedBody& body, const Placement& placement, const spm::CellBox& bounds,
                          const Placement& stands, HandNear&& hand_near, Visit&& visit) noexcept {
  if (!hand_near(sharing::centre_of(body, placement), body.settings.half.norm() + kHandNear)) return;
  const double radius = sharing::kBodySearchDistance / stands.scale();
  sharing::for_each_search_point(body, placement, stands, bounds, [&](const Vec3d& place) { visit(place, radius); });
}

/// The objects that a tip could touch, from the loader's last search. The tip moves and objects arrive before the next
/// search, so everything that this search does not cover counts as near.
struct NearObjects {
  std::uint64_t found = 0;   ///< by index bit
  std::uint64_t sought = 0;  ///< the objects that the search covered
  Plain3 centre{};           ///< world; of the tip at the search
  double moved = 0;          ///< m; within this distance from there, the tip can only touch the objects found

  [[nodiscard]] std::uint64_t at(const Vec3d& tip) const noexcept {
    if (!tip.allFinite()) return 0;
    return (tip - vec(centre)).squaredNorm() <= moved * moved ? found | ~sought : ~std::uint64_t{0};
  }
};

/// Loader to haptic thread.
struct Arrival {
  enum class Kind : std::uint8_t {
    kObject,
    kRegion,
    kRetire,
    kWithdraw  ///< the object; nothing else of it arrives afterwards
  } kind = Kind::kObject;
  TouchObject* object = nullptr;
  spm::RegionId region{};
  spm::RegionList list;  ///< kRegion
};

/// Haptic thread to loader: no record of the region is applied any more. Or, of a withdrawn object: the haptic thread
/// has removed the object and its regions.
struct Departure {
  std::uint32_t object = 0;
  spm::RegionId region{spm::kNone};  ///< kNone: the object
  [[nodiscard]] bool is_object() const noexcept { return spm::index(region) == spm::kNone; }
};

using ArrivalRing = boost::lockfree::spsc_queue<Arrival>;
using DepartureRing = boost::lockfree::spsc_queue<Departure>;

/// A sphere within which an object's mesh is the same as in the last cycle. Model frame.
struct Unchanged {
  Plain3 centre{};
  double squared_radius = std::numeric_limits<double>::infinity();
  bool appeared = false;  ///< in the last cycle there was no mesh
};

/// The surfaces of several objects as one surface for one probe, at their current placements and at those of the last
/// cycle. Borrows its arguments for a cycle. Realtime.
class ObjectsSurface final : public haptics::Surface {
 public:
  /// For sweeps; may be null. Must outlive the surface.
  void set_caches(spm::CandidateCaches* caches) noexcept { caches_ = caches; }
  void clear() noexcept {
    count_ = 0;
    moving_ = 0;
    met_change_ = false;
    version_ = spm::Version::kNow;
  }
  /// `before` null: the object has not moved.
  void add(const TouchObject& object, const Placement& now, const Placement* before,
           const Unchanged& unchanged) noexcept {
    entries_[count_++] = {&object, &now, before, unchanged};
    if (before != nullptr) ++moving_;
  }
  /// The objects at their current placements with their meshes of the last cycle. For sweeps only.
  [[nodiscard]] ObjectsSurface on_meshes_before() const noexcept;
  /// A sweep reached a part of a mesh that may have changed since the last cycle.
  [[nodiscard]] bool met_change() const noexcept { return met_change_; }
  [[nodiscard]] std::uint32_t count() const noexcept { return count_; }
  [[nodiscard]] const TouchObject& operator[](std::uint32_t i) const noexcept { return *entries_[i].object; }
  [[nodiscard]] const Placement& placement(std::uint32_t i) const noexcept { return *entries_[i].now; }

  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius,
                           haptics::SurfaceHit& hit) noexcept override;
  [[nodiscard]] bool closest(const Vec3d& point, double within, haptics::SurfaceHit& hit) const noexcept override;
  [[nodiscard]] bool moving() const noexcept override { return moving_ > 0; }
  [[nodiscard]] bool sweep_moving(const Vec3d& from, const Vec3d& to, double radius,
                                  haptics::SurfaceHit& hit) noexcept override;
  [[nodiscard]] Vec3d carried(std::uint32_t object, const Vec3d& point) const noexcept override;
  /// The position in the last step of the surface point that is now at `point`.
  [[nodiscard]] Vec3d carried_from(std::uint32_t object, const Vec3d& point) const noexcept;
  [[nodiscard]] Vec3d turned(std::uint32_t object, const Vec3d& direction) const noexcept override;

 private:
  struct Entry {
    const TouchObject* object = nullptr;
    const Placement* now = nullptr;
    const Placement* before = nullptr;
    Unchanged unchanged;
  };
  void take_earlier(const Entry& entry, const Vec3d& from_model, const Vec3d& to_model, double radius, bool& found,
                    haptics::SurfaceHit& hit) noexcept;
  [[nodiscard]] const Entry* moved(std::uint32_t object) const noexcept;

  std::array<Entry, kMaxObjects> entries_{};
  std::uint32_t count_ = 0;
  std::uint32_t moving_ = 0;
  spm::Version version_ = spm::Version::kNow;
  bool met_change_ = false;
  spm::CandidateCaches* caches_ = nullptr;
};

}  // namespace tactus::hrtc_service
