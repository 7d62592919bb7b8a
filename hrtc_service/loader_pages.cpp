// Pages of directories: which the loader requests, and what it does with those that come.
#include <algorithm>
#include <utility>

#include "hrtc_service/loader.hpp"
#include "spm/codec/page_codec.hpp"
#include "spm/directory.hpp"

namespace tactus::hrtc_service {
namespace {

/// Time to contact of a page that no probe is near, s.
constexpr double kNotUrgent = 0.5;
/// Time after which a page that no probe is near may be dropped.
constexpr std::int64_t kUnusedNs = 1'000'000'000;

}  // namespace

Loader::Page::Page(const spm::Page& page) : grid{page}, notes(page.regions.size()) {
  for (const spm::Region& region : page.regions) lists.push_back(spm::list_summary(region));
}

Loader::Page* Loader::Object::find_page(std::uint32_t region) const noexcept {
  const auto after = std::upper_bound(
      pages.begin(), pages.end(), region,
      [](std::uint32_t number, const std::unique_ptr<Page>& page) { return number < page->grid.first_region(); });
  if (after == pages.begin()) return nullptr;
  Page* const page = (after - 1)->get();
  return region < page->grid.end_region() ? page : nullptr;
}

Loader::Page* Loader::Object::find_page(spm::PageId page) const noexcept {
  const auto at =
      std::lower_bound(pages.begin(), pages.end(), page,
                       [](const std::unique_ptr<Page>& each, spm::PageId id) { return each->grid.id() < id; });
  return at != pages.end() && (*at)->grid.id() == page ? at->get() : nullptr;
}

/// Sets the missing pages that the probes may touch within two prediction horizons. The second one is for the regions
/// of a page, which the loader can only request after the page has come.
void Loader::find_missing_pages(Object& object, const std::array<ReportedProbe, kMaxProbes>& probes, double lead) {
  object.wanted_pages.clear();
  if (settings_.wants_whole_directory) {
    if (object.pages.empty()) object.wanted_pages.push_back({session::kAllPages, 0});
    return;
  }
  const Placement placement = object.ready ? object.placement : Placement{object.entry.pose, object.entry.scale};
  PlacedSpheres out;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ReportedProbe& probe = probes[i];
    if (!probe.active) continue;
    for (const spm::PlacedSphere& sphere : spheres(probe, placement, out)) {
      // The pages at the sphere, and those that it reaches at twice its speed, in steps.
      constexpr int kSteps = 4;
      const double margin = settings_.margin / placement.scale();
      for (int step = 0; step <= kSteps; ++step) {
        const double time = 2 * lead * step / kSteps;
        const double reach =
            sphere.radius + margin + time * std::max(speeds_[i], settings_.min_speed) / placement.scale();
        want_pages(object, sphere.centre, reach, time / 2);
      }
    }
    if (probe.in_contact && settings_.tool == nullptr)
      want_pages(object, placement.to_model(probe.proxy), (settings_.radius + settings_.margin) / placement.scale(), 0);
  }
  for (const spm::PageId page : object.pages_in_servo) want_page(object, page, kNotUrgent);
}

/// Wants the pages that a sphere meets, for a contact in that time. Model frame.
void Loader::want_pages(Object& object, const Vec3d& centre, double radius, double contact) {
  object.grid.for_each_page(centre, radius, [&](spm::PageId page, const auto*) { want_page(object, page, contact); });
}

void Loader::want_page(Object& object, spm::PageId page, double contact) {
  if (Page* const here = object.find_page(page); here != nullptr) {
    here->near_ns = last_tick_ns_;
    return;
  }
  // Without room, the page would come again and again.
  const bool is_full = object.is_full && last_tick_ns_ - object.full_ns < kUnusedNs;
  if (is_full || settings_.wants_whole_directory) return;
  const auto contact_in_us = static_cast<std::uint32_t>(std::min(contact, kNotUrgent) * 1e6);
  const auto same = std::find_if(object.wanted_pages.begin(), object.wanted_pages.end(),
                                 [&](const auto& wanted) { return wanted.region == session::number_of(page); });
  if (same != object.wanted_pages.end())
    same->contact_in_us = std::min(same->contact_in_us, contact_in_us);
  else if (object.wanted_pages.size() < session::kMaxWanted)
    object.wanted_pages.push_back({session::number_of(page), contact_in_us});
}

void Loader::on_pages(Object& object, const session::DeliveryClient::Message& message) {
  const auto refuse = [&](const std::string& reason) {
    ++figures_.decode_errors;
    report_warning("object " + object.info.name + ": a part of its directory is refused: " + reason);
    delivery_.answer_refused(object.info.id, message.region);
  };
  if (object.refused) return delivery_.answer_refused(object.info.id, message.region);
  const std::span<const std::uint8_t> bytes{message.bytes};
  std::vector<spm::Page> pages;
  if (message.region == session::kAllPages) {
    auto decoded = spm::codec::decode_pages(bytes, object.summary);
    if (!decoded) return refuse(decoded.error().text);
    pages = std::move(*decoded);
  } else {
    auto decoded = spm::codec::decode_page(bytes, object.summary);
    if (!decoded) return refuse(decoded.error().text);
    if (session::number_of(decoded->id) != message.region) return refuse("it is another page than requested");
    pages.push_back(std::move(*decoded));
  }
  for (spm::Page& page : pages) {
    if (object.grid.find(page.id) != nullptr) continue;
    if (!add_page(object, std::move(page))) {
      if (object.is_full) return delivery_.answer_refused(object.info.id, message.region);
      return refuse("its regions are also in another page");
    }
  }
  delivery_.answer_page_stored(object.info.id, message.region);
  last_prediction_ns_ = next_prediction_ns_ = 0;
}

/// Returns false if the page does not fit into the memory for directories, or contradicts the other pages.
bool Loader::add_page(Object& object, spm::Page page) {
  const std::uint64_t takes = spm::page_bytes(page.regions);
  object.pages_in_servo.erase(page.id);
  if (!has_room(object, takes)) drop_unused_pages();
  if (!has_room(object, takes)) {
    object.full_ns = last_tick_ns_;
    if (!std::exchange(object.is_full, true))
      report_warning("object " + object.info.name +
                     ": parts stay coarse: the memory for directories is full; raise --memory");
    return false;
  }
  object.is_full = false;
  auto added = std::make_unique<Page>(page);
  added->near_ns = last_tick_ns_;
  if (!object.grid.can_insert(added->grid)) return false;
  object.directory_bytes += takes;
  directory_bytes_ += takes;
  object.grid.insert(added->grid);
  const auto next =
      std::upper_bound(object.pages.begin(), object.pages.end(), page.id,
                       [](spm::PageId id, const std::unique_ptr<Page>& each) { return id < each->grid.id(); });
  object.pages.insert(next, std::move(added));

  const std::uint32_t slots_left = pool_.slots - base_slots_;
  const auto largest = std::max_element(page.regions.begin(), page.regions.end(),
                                        [](const auto& a, const auto& b) { return a.part_count < b.part_count; });
  if (largest != page.regions.end() && largest->part_count > slots_left &&
      !std::exchange(object.has_large_regions, true))
    report_warning("object " + object.info.name + ": parts stay coarse: a region needs " +
                   std::to_string(largest->part_count) + " slots, the pool has " + std::to_string(slots_left) +
                   " besides base meshes; raise --memory or --pool");

  for (const std::uint32_t region : std::exchange(object.regions_in_servo, {})) {
    if (object.find_page(region) != nullptr)
      process_region_answer(object, region, spm::AcceptResult::kLoaded);
    else
      object.regions_in_servo.push_back(region);
  }
  if (object.ready)
    intake_.add_page(object.info.index, page);
  else
    object.pages_to_send.push_back(std::move(page));
  return true;
}

bool Loader::has_room(const Object& object, std::uint64_t bytes) const noexcept {
  return bytes <= settings_.directory_bytes - directory_bytes_ &&
         object.grid.pages() + object.pages_in_servo.size() < max_pages_of(object.summary);
}

/// Whether a region of the page is in the store or the pool, or was wanted lately.
bool Loader::is_in_use(const Object& object, const Page& page) const {
  const auto wanted = object.wanted_regions.lower_bound(page.grid.first_region());
  if (wanted != object.wanted_regions.end() && wanted->first < page.grid.end_region()) return true;
  return std::any_of(page.notes.begin(), page.notes.end(), [&](const RegionProgress& note) {
    return note.store_state() != StoreState::kAbsent || note.pool_state() != PoolState::kNotLoaded ||
           note.belongs_in_pool != 0;
  });
}

/// Drops the pages that have been unused for longest, of all objects: up to an eighth of all, so that the search is
/// rare.
void Loader::drop_unused_pages() {
  constexpr std::size_t kShare = 8;
  struct Unused {
    std::int64_t near_ns;
    Object* object;
    spm::PageId page;
  };
  std::vector<Unused> unused;
  std::size_t pages = 0;
  for (const auto& [id, object] : objects_) {
    if (object->withdrawn || object->refused) continue;
    pages += object->pages.size();
    for (const auto& page : object->pages)
      if (last_tick_ns_ - page->near_ns >= kUnusedNs && !is_in_use(*object, *page))
        unused.push_back({page->near_ns, object.get(), page->grid.id()});
  }
  std::sort(unused.begin(), unused.end(), [](const Unused& a, const Unused& b) { return a.near_ns < b.near_ns; });
  unused.resize(std::min(unused.size(), pages / kShare + 1));
  for (const Unused& each : unused) drop_page(*each.object, each.page);
}

void Loader::drop_page(Object& object, spm::PageId page) {
  const auto at =
      std::find_if(object.pages.begin(), object.pages.end(), [&](const auto& each) { return each->grid.id() == page; });
  const std::uint64_t bytes = spm::page_bytes((*at)->grid);
  object.directory_bytes -= bytes;
  directory_bytes_ -= bytes;
  object.grid.remove((*at)->grid);
  object.pages.erase(at);
  delivery_.forget_page(object.info.id, session::number_of(page));
  if (object.ready)
    intake_.drop_page(object.info.index, page);
  else
    std::erase_if(object.pages_to_send, [&](const spm::Page& each) { return each.id == page; });
}

void Loader::process_page_answer(Object& object, spm::PageId page, spm::AcceptResult result) {
  if (result == spm::AcceptResult::kAccepted) return;
  if (result == spm::AcceptResult::kLoaded) {
    if (object.grid.find(page) == nullptr) object.pages_in_servo.insert(page);
    return;
  }
  ++figures_.refused_other;
  object.full_ns = last_tick_ns_;
  if (!std::exchange(object.is_full, true))
    report_warning("object " + object.info.name + ": parts stay coarse: the servo has refused a page");
  if (const Page* const here = object.find_page(page); here != nullptr && !is_in_use(object, *here))
    drop_page(object, page);
}

/// Returns the bytes that hosts may have in flight for missing pages, which the store does not hold.
std::uint64_t Loader::page_credit() const noexcept {
  constexpr std::uint64_t kPageCredit = 64u << 10;
  const bool is_missing = std::any_of(objects_.begin(), objects_.end(),
                                      [](const auto& object) { return !object.second->wanted_pages.empty(); });
  return is_missing ? kPageCredit : 0;
}

}  // namespace tactus::hrtc_service
