/// Data of an object in the haptic thread, and the messages between that thread and the intake.
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
inline constexpr double kHandNear = 0.15;       ///< m; the surroundings of a body are refined if a hand is this near
static_assert(kMaxObjects <= 64, "bits in NearObjects");

using sharing::Placement;

/// An object without its mesh.
struct ObjectDescription {
  std::uint32_t index = 0;  ///< index in the haptic thread, below kMaxObjects; bit in NearObjects
  std::uint64_t id = 0;
  std::uint64_t digest = 0;  ///< of the model
  std::string name;          ///< in the session, for log lines
  Placement placement;       ///< at its arrival
  session::Material material;
  std::optional<sharing::SharedBody> body;  ///< only of a movable object
};

/// An object of the haptic thread. TouchObjects makes it, and destroys it after its Departure or after the end of the
/// haptic thread. Until then only the haptic thread uses `forest`.
struct TouchObject : ObjectDescription {
  spm::CellBox bounds;   ///< model frame
  double deviation = 0;  ///< max distance of any version of the mesh from the finest, file units
  std::unique_ptr<spm::Forest> forest;
};

/// Finds the parts of a fixed object that a body near a hand can touch. The mesh of these parts must be the finest. The
/// fixed object has `bounds` and the placement `stands`; the body has `placement`. Calls `visit(centre, radius)` with
/// spheres in the model frame of the fixed object. `has_hand_near(point, distance)`: whether some tip is within that
/// distance of a point, world frame.
template <class HandNear, class Visit>
void for_each_sphere_under(const sharing::SharedBody& body, const Placement& placement, const spm::CellBox& bounds,
                           const Placement& stands, HandNear&& has_hand_near, Visit&& visit) noexcept {
  if (!has_hand_near(sharing::centre_of(body, placement), body.settings.half.norm() + kHandNear)) return;
  const double radius = sharing::kBodySearchDistance / stands.scale();
  sharing::for_each_search_point(body, placement, stands, bounds, [&](const Vec3d& place) { visit(place, radius); });
}

/// The objects that a tip could touch, from the loader's last search. Objects that arrived after the search count as
/// near, and all objects do if the tip has moved too far since.
struct NearObjects {
  std::uint64_t found = 0;     ///< objects near the tip, by index bit
  std::uint64_t searched = 0;  ///< objects that the search covered, by index bit
  Plain3 centre{};             ///< position of the tip at the search, world
  double moved = 0;            ///< max displacement of the tip since the search for which `found` is complete, m

  /// Returns the objects that count as near a tip at this position, by index bit.
  [[nodiscard]] std::uint64_t at(const Vec3d& tip) const noexcept {
    if (!tip.allFinite()) return 0;
    return (tip - vec(centre)).squaredNorm() <= moved * moved ? found | ~searched : ~std::uint64_t{0};
  }
};

/// A message from the intake to the haptic thread: an object, a page of its directory or a region has been loaded, a
/// region is to be retired, or an object is withdrawn.
struct Arrival {
  enum class Kind : std::uint8_t {
    kObject,
    kRegion,
    kRetire,
    kWithdraw,  ///< the last arrival of an object
    kPage,
    kDropPage  ///< the page is to be returned
  } kind = Kind::kObject;
  TouchObject* object = nullptr;
  spm::RegionId region{};
  spm::RegionList list{};                 ///< only of kRegion
  const spm::RegionPage* page = nullptr;  ///< only of kPage and kDropPage
};

/// A message from the haptic thread to the intake: no record of the region is applied any more, the page is no longer
/// used, or the haptic thread has removed a withdrawn object with all its regions and pages.
struct Departure {
  std::uint32_t object = 0;               ///< index
  spm::RegionId region{spm::kNone};       ///< kNone: a page or the withdrawn object
  const spm::RegionPage* page = nullptr;  ///< null: a region or the withdrawn object
  [[nodiscard]] bool is_object() const noexcept { return spm::index(region) == spm::kNone && page == nullptr; }
};

using ArrivalRing = boost::lockfree::spsc_queue<Arrival>;
using DepartureRing = boost::lockfree::spsc_queue<Departure>;

/// A sphere within which an object's mesh is the same as in the last cycle. Model frame.
struct UnchangedSphere {
  Plain3 centre{};
  double squared_radius = std::numeric_limits<double>::infinity();
  bool appeared = false;  ///< the object had no mesh in the last cycle
};

/// Combines the surfaces of several objects near one probe, at their placements now and in the last cycle. Stores
/// pointers to its arguments until `clear`. Realtime.
class ObjectsSurface final : public haptics::Surface {
 public:
  /// Sets the caches for sweeps; null for none. They must outlive the surface.
  void set_caches(spm::CandidateCaches* caches) noexcept { caches_ = caches; }
  void clear() noexcept {
    count_ = 0;
    moving_ = 0;
    reached_change_ = false;
    version_ = spm::Version::kCurrent;
  }
  /// Adds an object. `before` is its placement in the last cycle, null if it has not moved.
  void add(const TouchObject& object, const Placement& now, const Placement* before,
           const UnchangedSphere& unchanged) noexcept {
    entries_[count_++] = {&object, &now, before, unchanged};
    if (before != nullptr) ++moving_;
  }
  /// Returns the objects at their current placements with their meshes of the last cycle. For sweeps only.
  [[nodiscard]] ObjectsSurface on_meshes_before() const noexcept;
  /// Returns whether a sweep reached a part of a mesh that may have changed since the last cycle.
  [[nodiscard]] bool reached_change() const noexcept { return reached_change_; }
  [[nodiscard]] std::uint32_t count() const noexcept { return count_; }
  [[nodiscard]] const TouchObject& operator[](std::uint32_t i) const noexcept { return *entries_[i].object; }
  [[nodiscard]] const Placement& placement(std::uint32_t i) const noexcept { return *entries_[i].now; }

  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius,
                           haptics::SurfaceHit& hit) noexcept override;
  [[nodiscard]] bool closest(const Vec3d& point, double within, haptics::SurfaceHit& hit) const noexcept override;
  [[nodiscard]] bool moving() const noexcept override { return moving_ > 0; }
  [[nodiscard]] bool sweep_moving(const Vec3d& from, const Vec3d& to, double radius,
                                  haptics::SurfaceHit& hit) noexcept override;
  [[nodiscard]] Vec3d moved_point(std::uint32_t object, const Vec3d& point) const noexcept override;
  /// Returns the position that the surface point at `point` had in the last cycle.
  [[nodiscard]] Vec3d previous_point(std::uint32_t object, const Vec3d& point) const noexcept;
  [[nodiscard]] Vec3d rotated_direction(std::uint32_t object, const Vec3d& direction) const noexcept override;

 private:
  struct Entry {
    const TouchObject* object = nullptr;
    const Placement* now = nullptr;
    const Placement* previous = nullptr;
    UnchangedSphere unchanged;
  };
  void add_sweep_hit(const Entry& entry, const Vec3d& from_model, const Vec3d& to_model, double radius, bool& found,
                     haptics::SurfaceHit& hit) noexcept;
  [[nodiscard]] const Entry* moved(std::uint32_t object) const noexcept;

  std::array<Entry, kMaxObjects> entries_{};
  std::uint32_t count_ = 0;
  std::uint32_t moving_ = 0;
  spm::Version version_ = spm::Version::kCurrent;
  bool reached_change_ = false;
  spm::CandidateCaches* caches_ = nullptr;
};

}  // namespace tactus::hrtc_service
