/// Holds the objects of the haptic thread and the memory of their meshes.
///
///     objects, base meshes, pages, --> [check, write into the pool] --> arrivals
///     regions, retirements, withdrawals
///     departures                     --> [free]
///
/// Regions, retirements and withdrawals are checked, and refused without a change if they are wrong. So the haptic thread
/// can use what it gets without further checks.
///
/// One thread, not the haptic one. Allocates.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "hrtc_service/servo/intake_link.hpp"
#include "hrtc_service/servo/touch_object.hpp"
#include "spm/cache.hpp"
#include "spm/pool.hpp"

namespace tactus::hrtc_service {

class TouchObjects {
 public:
  /// Allocates the memory of all meshes.
  explicit TouchObjects(const spm::PoolSettings& settings);

  /// Adds an object whose base mesh has passed spm::violations. Returns nothing if its index is in use or the base mesh
  /// does not fit.
  [[nodiscard]] std::optional<Arrival> add(const ObjectDescription& description, const spm::BaseMesh& base,
                                           std::uint32_t max_pages);
  /// Adds a page to the directory of an object. If the result is not kAccepted, `arrival` is unchanged.
  [[nodiscard]] spm::AcceptResult add_page(std::uint32_t object, const spm::Page& page, Arrival& arrival);
  /// Drops a page. Returns nothing if the object does not have it.
  [[nodiscard]] std::optional<Arrival> drop_page(std::uint32_t object, spm::PageId page);
  /// Writes a region into the pool, see Cache::accept. If the result is not kAccepted, `arrival` is unchanged.
  [[nodiscard]] spm::AcceptResult add_region(std::uint32_t object, const spm::RegionData& region,
                                             const spm::ListSummary& expected, Arrival& arrival);
  /// Retires a loaded region. Returns nothing if it is not loaded or is already retired.
  [[nodiscard]] std::optional<Arrival> retire(std::uint32_t object, spm::RegionId region);
  /// Withdraws an object. Returns nothing if there is no such object or it is already withdrawn.
  [[nodiscard]] std::optional<Arrival> withdraw(std::uint32_t object);
  /// Frees a region, a page or an object that the haptic thread has returned.
  void free(const Departure& departure);

  /// Returns whether the haptic thread may use an object with this index, withdrawn or not.
  [[nodiscard]] bool is_index_used(std::uint32_t object) const noexcept { return objects_[object] != nullptr; }
  /// Returns the serial number of the object with this index, withdrawn or not; 0 if there is none. No two objects have
  /// the same number.
  [[nodiscard]] std::uint64_t serial_at(std::uint32_t object) const noexcept {
    return objects_[object] == nullptr ? 0 : objects_[object]->serial;
  }
  /// Returns an object that is not withdrawn, or null.
  [[nodiscard]] TouchObject* find(std::uint32_t object) noexcept;
  [[nodiscard]] const TouchObject* find(std::uint32_t object) const noexcept;
  /// Returns whether a region of an object that is not withdrawn is loaded and not retired.
  [[nodiscard]] bool is_in_use(std::uint32_t object, spm::RegionId region) const noexcept;
  /// Returns which objects there are, by index.
  [[nodiscard]] std::array<KeptObject, kMaxObjects> kept_objects() const noexcept;
  /// Returns the pages of an object, also those that the haptic thread is to return. The object must exist.
  [[nodiscard]] const std::vector<std::unique_ptr<const spm::RegionPage>>& pages(std::uint32_t object) const noexcept {
    return objects_[object]->pages;
  }
  /// Returns the index of an object in the cache. The object must exist.
  [[nodiscard]] spm::ObjectIndex cache_index(std::uint32_t object) const noexcept {
    return objects_[object]->cache_index;
  }
  [[nodiscard]] const spm::Pool& pool() const noexcept { return pool_; }
  [[nodiscard]] const spm::Cache& cache() const noexcept { return cache_; }
  [[nodiscard]] const spm::NodePool& nodes() const noexcept { return nodes_; }

 private:
  struct Object {
    TouchObject touch;
    std::uint64_t serial = 0;
    spm::ObjectIndex cache_index{};
    spm::ModelSummary summary{};
    // The pages, which the grid of the haptic thread uses, and a grid with the same pages for this thread.
    std::vector<std::unique_ptr<const spm::RegionPage>> pages;
    std::optional<spm::RegionGrid> grid;
    std::set<spm::RegionId> retired;  // loaded regions that the haptic thread is to return
    bool is_withdrawn = false;
  };
  [[nodiscard]] Object* not_withdrawn(std::uint32_t object) const noexcept;

  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::Cache cache_;
  std::array<std::unique_ptr<Object>, kMaxObjects> objects_;
  std::uint64_t added_ = 0;  // objects
};

}  // namespace tactus::hrtc_service
