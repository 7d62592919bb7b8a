#include "hrtc_service/servo/intake.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <span>

#include "hrtc_service/servo/bodies.hpp"
#include "hrtc_service/servo/ring_memory.hpp"
#include "realtime/periodic_clock.hpp"
#include "session/check.hpp"
#include "spm/directory.hpp"
#include "spm/region_data.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::size_t kRingEntries = 4096;
constexpr double kMaxMaterial = 1e6;  // N/m, N s/m and friction, far above those of any device
constexpr int kMaxMessages = 1024;    // in one tick
constexpr std::int64_t kMaxTickNs = 50'000'000;
/// Max bytes of the regions of a base mesh, which the pool does not hold.
constexpr std::uint64_t kMaxDirectoryBytes = 128u << 20;

/// Copies plain values from the beginning of a message.
class MessageReader {
 public:
  explicit MessageReader(std::span<const std::byte> bytes) noexcept : left_{bytes} {}

  /// Returns false if fewer bytes are left.
  template <class T>
  [[nodiscard]] bool get(T& value) noexcept {
    static_assert(std::is_trivially_copyable_v<T>);
    if (left_.size() < sizeof(T)) return false;
    std::memcpy(&value, left_.data(), sizeof(T));
    left_ = left_.subspan(sizeof(T));
    return true;
  }
  template <class T>
  [[nodiscard]] bool get(std::vector<T>& values, std::uint32_t count) {
    static_assert(std::is_trivially_copyable_v<T>);
    const std::uint64_t bytes = std::uint64_t{count} * sizeof(T);
    if (left_.size() < bytes) return false;
    values.resize(count);
    if (bytes > 0) std::memcpy(values.data(), left_.data(), bytes);
    left_ = left_.subspan(bytes);
    return true;
  }
  [[nodiscard]] bool at_end() const noexcept { return left_.empty(); }

 private:
  std::span<const std::byte> left_;
};

bool is_valid(const IntakeObject& object) {
  return std::find(object.name.begin(), object.name.end(), '\0') != object.name.end() &&
         session::invalid_field(object.pose) == nullptr &&
         session::invalid_scale(object.scale, object.summary) == nullptr &&
         session::invalid_field(object.material) == nullptr && object.material.stiffness <= kMaxMaterial &&
         object.material.damping <= kMaxMaterial && object.material.static_friction <= kMaxMaterial &&
         session::invalid_field(object.body) == nullptr;
}

bool is_same(const session::Material& a, const session::Material& b) noexcept {
  return a.stiffness == b.stiffness && a.damping == b.damping && a.static_friction == b.static_friction &&
         a.dynamic_friction == b.dynamic_friction;
}

/// For bodies of one model and scale.
bool is_same(const sharing::SharedBody& a, const sharing::SharedBody& b) noexcept {
  return a.settings.mass == b.settings.mass && a.settings.inertia == b.settings.inertia &&
         a.settings.friction == b.settings.friction && a.ground == b.ground;
}

ObjectDescription description_of(std::uint32_t index, const IntakeObject& object) {
  ObjectDescription description;
  description.index = index;
  description.id = object.id;
  description.digest = object.summary.digest;
  description.name = object.name.data();
  description.placement = Placement{object.pose, object.scale};
  description.material = object.material;
  if (object.body.mass <= 0) return description;
  session::CatalogueEntry entry;
  entry.summary = object.summary;
  entry.scale = object.scale;
  entry.pose = object.pose;
  entry.body = object.body;
  description.body = sharing::body_of(entry);
  return description;
}

}  // namespace

Intake::Intake(const spm::PoolSettings& settings, IntakeLink& link, std::uint64_t directory_bytes)
    : link_{link},
      objects_{settings},
      messages_{link.messages},
      answers_{link.answers},
      attach_answers_{link.attach_answers},
      arrivals_{kRingEntries},
      departures_{kRingEntries},
      max_bytes_{settings.bytes() + std::min(directory_bytes, kMaxDirectoryBytes)},
      max_directory_bytes_{directory_bytes} {
  touch_memory(arrivals_);
  touch_memory(departures_);
}

/// Answers a gateway that continues with the link of an earlier one.
void Intake::attach_if_requested() {
  const std::uint32_t request = link_.attach_requests.load(std::memory_order_acquire);
  if (request == attached_) return;
  attached_ = request;
  messages_.discard();
  header_.reset();
  message_.clear();
  is_broken_ = false;
  processed_ = 0;
  kept_object_ = spm::kNone;
  const spm::Cache& cache = objects_.cache();
  const AttachAnswer answer{
      request, answers_.position(), {cache.slots_free(), cache.blocks_free()}, objects_.kept_objects()};
  for (std::uint32_t i = 0; i < kMaxObjects; ++i)
    waits_for_gateway_[i] = answer.objects[i].exists && !answer.objects[i].is_withdrawn;
  attach_answers_.post(answer);
}

/// Answers which pages and regions of a kept object are loaded. Returns true if no answer is missing.
bool Intake::answer_loaded_regions() {
  while (kept_object_ != spm::kNone && objects_.find(kept_object_) != nullptr) {
    if (const auto& pages = objects_.pages(kept_object_); next_page_ < pages.size()) {
      if (answers_.space() == 0) return false;
      const spm::PageId page = pages[next_page_++]->id();
      answer(IntakeAnswer::Kind::kPage, kept_object_, spm::RegionId{spm::index(page)}, spm::AcceptResult::kLoaded);
      continue;
    }
    const spm::Cache::LoadedAt at = objects_.cache().next_loaded(objects_.cache_index(kept_object_), next_block_);
    if (at.region == spm::kNone) break;
    if (answers_.space() == 0) return false;
    next_block_ = spm::BlockIndex{spm::index(at.block) + 1};
    if (objects_.is_in_use(kept_object_, at.region))
      answer(IntakeAnswer::Kind::kRegion, kept_object_, at.region, spm::AcceptResult::kLoaded);
  }
  kept_object_ = spm::kNone;
  return true;
}

/// Returns true if no arrival waits for space in the ring.
bool Intake::push_arrivals() {
  if (pending_ && arrivals_.push(*pending_)) pending_.reset();
  return !pending_;
}

void Intake::answer(IntakeAnswer::Kind kind, std::uint32_t object, spm::RegionId region, spm::AcceptResult result) {
  const spm::Cache& cache = objects_.cache();
  (void)answers_.push({kind, result, object, region, processed_, {cache.slots_free(), cache.blocks_free()}});
}

void Intake::process_departures() {
  Departure departure;
  while (answers_.space() > 0 && departures_.pop(departure)) {
    if (departure.page != nullptr) {
      directory_bytes_[departure.object] -= spm::page_bytes(*departure.page);
      objects_.free(departure);
      continue;
    }
    objects_.free(departure);
    if (departure.is_object()) directory_bytes_[departure.object] = 0;
    answer(departure.is_object() ? IntakeAnswer::Kind::kObjectGone : IntakeAnswer::Kind::kRegionGone, departure.object,
           departure.region, spm::AcceptResult::kAccepted);
  }
}

/// Copies bytes that have arrived. Returns whether a message is complete.
bool Intake::assemble() {
  if (!header_) {
    IntakeHeader header;
    if (messages_.waiting() < sizeof header) return false;
    (void)messages_.pop(std::as_writable_bytes(std::span{&header, 1}));
    is_broken_ = header.kind > IntakeKind::kDropPage || header.object >= kMaxObjects || header.bytes > max_bytes_;
    if (is_broken_) return false;
    header_ = header;
    message_.clear();
  }
  const std::size_t assembled = message_.size();
  message_.resize(std::min<std::uint64_t>(header_->bytes, assembled + messages_.waiting()));
  (void)messages_.pop(std::span{message_}.subspan(assembled));
  return message_.size() == header_->bytes;
}

/// `kind`: set if the object differs from that of an earlier gateway.
spm::AcceptResult Intake::add_object(IntakeAnswer::Kind& kind) {
  MessageReader in{message_};
  IntakeObject object;
  spm::BaseMesh base;
  if (!in.get(object) || object.max_pages > spm::kMaxWholePages) return spm::AcceptResult::kMalformed;
  base.summary = object.summary;
  const std::uint64_t directory = spm::directory_bytes(base.summary, objects_.pool().settings, object.max_pages);
  if (!waits_for_gateway_[header_->object] && directory > directory_bytes_left()) return spm::AcceptResult::kPoolFull;
  if (!in.get(base.positions, base.summary.base_vertices) || !in.get(base.radii, base.summary.base_vertices) ||
      !in.get(base.faces, base.summary.base_faces) || !in.at_end() || !is_valid(object) ||
      !spm::violations(base).empty())
    return spm::AcceptResult::kMalformed;
  const bool is_movable = object.body.mass > 0;
  if (waits_for_gateway_[header_->object]) {
    if (keep_object(description_of(header_->object, object))) return spm::AcceptResult::kLoaded;
    kind = IntakeAnswer::Kind::kDiffers;
    return spm::AcceptResult::kMalformed;
  }
  if (objects_.is_index_used(header_->object) || (is_movable && movable_ == kMaxBodies))
    return spm::AcceptResult::kMalformed;
  pending_ = objects_.add(description_of(header_->object, object), base, object.max_pages);
  if (!pending_) return spm::AcceptResult::kPoolFull;
  movable_ += is_movable ? 1 : 0;
  directory_bytes_[header_->object] = directory;
  return spm::AcceptResult::kAccepted;
}

/// Keeps an object of an earlier gateway. Returns false if it differs from the object of that index now.
bool Intake::keep_object(const ObjectDescription& now) {
  const TouchObject& kept = *objects_.find(now.index);
  if (kept.id != now.id || kept.digest != now.digest || kept.name != now.name ||
      kept.placement.scale() != now.placement.scale() || !is_same(kept.material, now.material) ||
      kept.body.has_value() != now.body.has_value())
    return false;
  // A body has moved since the earlier gateway sent it.
  if (kept.body ? !is_same(*kept.body, *now.body) : kept.placement.numbers() != now.placement.numbers()) return false;
  waits_for_gateway_[now.index] = false;
  kept_object_ = now.index;
  next_page_ = 0;
  next_block_ = {};
  return true;
}

std::uint64_t Intake::directory_bytes_left() const noexcept {
  return max_directory_bytes_ - std::accumulate(directory_bytes_.begin(), directory_bytes_.end(), std::uint64_t{0});
}

spm::AcceptResult Intake::add_page(spm::RegionId& number) {
  MessageReader in{message_};
  IntakePage described;
  if (!in.get(described)) return spm::AcceptResult::kMalformed;
  number = spm::RegionId{spm::index(described.id)};
  spm::Page page{described.id, described.first, {}};
  if (!in.get(page.regions, described.regions) || !in.at_end()) return spm::AcceptResult::kMalformed;
  const std::uint64_t bytes = spm::page_bytes(page.regions);
  if (bytes > directory_bytes_left()) return spm::AcceptResult::kPoolFull;
  Arrival arrival;
  const spm::AcceptResult result = objects_.add_page(header_->object, page, arrival);
  if (result != spm::AcceptResult::kAccepted) return result;
  pending_ = arrival;
  directory_bytes_[header_->object] += bytes;
  return result;
}

spm::AcceptResult Intake::add_region(spm::RegionId& region) {
  MessageReader in{message_};
  IntakeRegion sizes;
  spm::RegionData data;
  if (!in.get(sizes) || !in.get(data.list, sizes.list) || !in.get(data.sent, sizes.sent) ||
      !in.get(data.residuals, sizes.residuals) || !in.get(data.parts, sizes.parts) || !in.at_end())
    return spm::AcceptResult::kMalformed;
  region = data.region = sizes.region;
  Arrival arrival;
  const spm::AcceptResult result = objects_.add_region(header_->object, data, sizes.expected, arrival);
  if (result == spm::AcceptResult::kAccepted) pending_ = arrival;
  return result;
}

void Intake::process_message() {
  ++processed_;
  spm::RegionId region{spm::kNone};
  spm::AcceptResult result = spm::AcceptResult::kAccepted;
  IntakeAnswer::Kind kind = IntakeAnswer::Kind::kOther;
  switch (header_->kind) {
    case IntakeKind::kObject:
      kind = IntakeAnswer::Kind::kObject;
      result = add_object(kind);
      break;
    case IntakeKind::kRegion:
      kind = IntakeAnswer::Kind::kRegion;
      result = add_region(region);
      break;
    case IntakeKind::kPage:
      kind = IntakeAnswer::Kind::kPage;
      result = add_page(region);
      break;
    case IntakeKind::kDropPage: {
      spm::PageId page{};
      if (MessageReader in{message_}; in.get(page) && in.at_end()) pending_ = objects_.drop_page(header_->object, page);
      break;
    }
    case IntakeKind::kRetire:
      if (MessageReader in{message_}; in.get(region) && in.at_end())
        pending_ = objects_.retire(header_->object, region);
      break;
    case IntakeKind::kWithdraw: {
      waits_for_gateway_[header_->object] = false;
      const TouchObject* const object = objects_.find(header_->object);
      if (object != nullptr && object->body) --movable_;
      pending_ = objects_.withdraw(header_->object);
      if (!objects_.is_index_used(header_->object)) kind = IntakeAnswer::Kind::kObjectGone;
      break;
    }
  }
  answer(kind, header_->object, region, result);
}

void Intake::tick() {
  attach_if_requested();
  process_departures();
  // The limits are for a gateway that writes faster than the intake reads.
  const std::int64_t end_ns = realtime::monotonic_ns() + kMaxTickNs;
  for (int left = kMaxMessages;
       left > 0 && !is_broken_ && push_arrivals() && answer_loaded_regions() && answers_.space() > 0 && assemble();
       --left) {
    process_message();
    if (realtime::monotonic_ns() > end_ns) left = 1;
    header_.reset();
  }
  constexpr std::size_t kMaxKept = 1u << 20;  // bytes; only base meshes need more
  if (message_.capacity() > kMaxKept && !header_) std::vector<std::byte>{}.swap(message_);
}

}  // namespace tactus::hrtc_service
