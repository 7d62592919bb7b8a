// Base meshes: the loader checks them, reserves memory for them, and sends objects to the intake.
#include <algorithm>
#include <utility>

#include "hrtc_service/loader.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr double kMinDamping = 3e-3;  // s; min damping / stiffness of a body; docs/explanation/shared-objects.md

}  // namespace

/// Decodes a base mesh and admits it to the pool. If regions occupy slots that the base mesh needs, `coarsen` frees
/// these slots first. So an object is refused only if its base mesh does not fit besides the other base meshes.
void Loader::on_base_mesh(Object& object, const std::vector<std::uint8_t>& bytes) {
  auto decoded = spm::codec::decode_base(std::span<const std::uint8_t>{bytes});
  if (!decoded || decoded->mesh.summary != object.summary) {
    ++figures_.decode_errors;
    report_warning("object " + object.info.name + ": base mesh refused: " +
                   (decoded ? "it is not the one that the catalogue describes" : decoded.error().text));
    delivery_.answer_base_refused(object.info.id);
    return;
  }
  delivery_.answer_base_stored(object.info.id);  // also if it does not fit: another request would change nothing
  if (object.ready || object.base_slots > 0 || !reserve_base(object, decoded->mesh)) return;
  const bool is_kept = kept_index(object) != spm::kNone;
  if ((!is_kept && !pending_bases_.empty()) || !can_admit(object)) {
    if (object.base_slots > intake_.free_space().slots && intake_.is_attached())
      report_info("object " + object.info.name + ": waits until regions are coarsened, its base mesh takes " +
                  std::to_string(object.base_slots) + " slots, the pool has " +
                  std::to_string(intake_.free_space().slots) + " free");
    pending_bases_.push_back({&object, std::move(*decoded)});
    return;
  }
  admit_base(object, std::move(*decoded));
}

/// Reserves slots and tree nodes for a base mesh. Returns false and marks the object as refused if they do not fit
/// besides the other base meshes.
bool Loader::reserve_base(Object& object, const spm::BaseMesh& base) {
  const std::uint32_t slots = spm::Cache::slots_for_base(base.summary);
  const std::uint32_t nodes = spm::tree_nodes_above(base.faces, object.summary.faces);
  const std::uint32_t slots_left = pool_.slots - base_slots_;
  const std::uint32_t nodes_left = pool_.tree_nodes - base_nodes_;
  if (slots > slots_left || nodes + spm::AbTree::kMaxHeight > nodes_left) {
    if (!object.refused) {
      ++figures_.objects_refused;
      release_directory(object);
      report_warning("object " + object.info.name + ": refused, its base mesh takes " + std::to_string(slots) +
                     " slots and " + std::to_string(nodes) + " tree nodes, the pool has " + std::to_string(slots_left) +
                     " and " + std::to_string(nodes_left) + " besides other base meshes; raise --memory or --pool");
    }
    object.refused = true;
    return false;
  }
  object.base_slots = slots;
  object.base_nodes = nodes;
  base_slots_ += slots;
  base_nodes_ += nodes;
  return true;
}

/// Returns the slots that the waiting base meshes need.
std::uint32_t Loader::pending_base_slots() const noexcept {
  std::uint32_t slots = 0;
  for (const PendingBase& pending : pending_bases_) slots += pending.object->base_slots;
  return slots;
}

/// Returns the bytes that hosts may have in flight for missing base meshes, which the store does not hold. Without this
/// credit, no base mesh could arrive while the store is full. A silent host gets none, because regions would use it.
std::uint64_t Loader::base_credit() const {
  std::uint64_t bytes = 0;
  for (const auto& [id, object] : objects_)
    if (!object->ready && !object->refused && object->base_slots == 0 && delivery_.serving_host(id) != 0)
      bytes += object->entry.base_bytes + session::kMaxPayload;
  return std::min<std::uint64_t>(bytes, settings_.delivery.credit);
}

/// Admits the base meshes whose slots have become free, in the order of their arrival. The objects that the servo has
/// need no slots, so they do not wait for others.
void Loader::admit_pending_bases() {
  const auto admit = [&](std::deque<PendingBase>::iterator at) {
    PendingBase pending = std::move(*at);
    pending_bases_.erase(at);
    admit_base(*pending.object, std::move(pending.base));
  };
  const auto is_kept = [&](const PendingBase& pending) { return kept_index(*pending.object) != spm::kNone; };
  for (auto at = pending_bases_.begin();
       (at = std::find_if(pending_bases_.begin(), pending_bases_.end(), is_kept)) != pending_bases_.end();)
    admit(at);
  while (!pending_bases_.empty() && can_admit(*pending_bases_.front().object)) admit(pending_bases_.begin());
}

/// Frees the reservation of an object whose base mesh waits for slots. Does nothing for other objects.
void Loader::drop_pending_base(Object& object) {
  const auto pending = std::find_if(pending_bases_.begin(), pending_bases_.end(),
                                    [&](const PendingBase& each) { return each.object == &object; });
  if (pending == pending_bases_.end()) return;
  base_slots_ -= object.base_slots;
  base_nodes_ -= object.base_nodes;
  pending_bases_.erase(pending);
}

/// Takes the list of the objects that the servo has from an earlier gateway.
void Loader::process_attach(std::int64_t now_ns) {
  AttachAnswer answer;
  if (!intake_.take_attach_answer(answer)) return;
  kept_objects_ = answer.objects;
  attached_ns_ = now_ns;
}

/// Withdraws the objects of an earlier gateway that no host has offered in time.
void Loader::withdraw_kept_objects(std::int64_t now_ns) {
  if (now_ns - attached_ns_ < settings_.kept_patience_ns) return;
  for (std::uint32_t i = 0; i < kMaxObjects; ++i)
    if (kept_objects_[i].exists && !delivery_.is_offered(kept_objects_[i].id, kept_objects_[i].digest))
      withdraw_kept(i);
}

void Loader::withdraw_kept(std::uint32_t index) {
  if (!std::exchange(kept_objects_[index].is_withdrawn, true)) intake_.withdraw(index);
}

/// Returns the index at which the servo has this object from an earlier gateway, or kNone.
std::uint32_t Loader::kept_index(const Object& object) const noexcept {
  for (std::uint32_t i = 0; i < kMaxObjects; ++i) {
    const KeptObject& kept = kept_objects_[i];
    if (kept.exists && !kept.is_withdrawn && kept.id == object.info.id && kept.digest == object.info.digest) return i;
  }
  return spm::kNone;
}

/// Returns whether the servo can take the object now. If it has another model of that name from an earlier gateway,
/// withdraws that first.
bool Loader::can_admit(const Object& object) {
  if (!intake_.is_attached()) return false;
  if (kept_index(object) != spm::kNone) return true;
  bool has_other = false;
  for (std::uint32_t i = 0; i < kMaxObjects; ++i) {
    if (!kept_objects_[i].exists || kept_objects_[i].id != object.info.id) continue;
    has_other = true;
    withdraw_kept(i);
  }
  return !has_other && object.base_slots <= intake_.free_space().slots && free_index() != spm::kNone;
}

/// Returns the next index that no object has, or kNone. The index of a removed object is used again as late as
/// possible.
std::uint32_t Loader::free_index() const noexcept {
  for (std::uint32_t i = 0; i < kMaxObjects; ++i) {
    const std::uint32_t index = (next_index_ + i) % kMaxObjects;
    if (by_index_[index] == nullptr && !kept_objects_[index].exists) return index;
  }
  return spm::kNone;
}

/// Returns the index for an object that can be admitted.
std::uint32_t Loader::take_index(const Object& object) noexcept {
  if (const std::uint32_t index = kept_index(object); index != spm::kNone) {
    kept_objects_[index] = {};
    return index;
  }
  const std::uint32_t index = free_index();
  next_index_ = (index + 1) % kMaxObjects;
  return index;
}

/// Sends a base mesh, for which the pool has free slots, to the intake.
void Loader::admit_base(Object& object, spm::codec::DecodedBase decoded) {
  const spm::BaseMesh& base = decoded.mesh;
  object.summary = base.summary;
  object.tables = std::move(decoded.tables);
  object.info.index = take_index(object);
  store_.admit(spm::ObjectIndex{object.info.index}, object.summary, object.tables);
  ObjectDescription& described = object.described;
  described.index = object.info.index;
  described.id = object.info.id;
  described.digest = object.info.digest;
  described.name = object.info.name;
  described.placement = Placement{object.entry.pose, object.entry.scale};
  described.material = object.entry.material;
  const auto bodies = std::count_if(active_.begin(), active_.end(),
                                    [](const Object* each) { return each->described.body.has_value(); });
  const bool can_move = sharing::can_move(object.entry);
  if (can_move && bodies == kMaxBodies) {
    report_warning("object " + object.info.name + " stays fixed: an HRTC simulates at most " +
                   std::to_string(kMaxBodies) + " movable objects");
  } else if (can_move) {
    described.body = sharing::body_of(object.entry);
    described.material.damping = std::max(described.material.damping, kMinDamping * described.material.stiffness);
  }
  object.placement = described.placement;
  object.bounds = spm::bounds_of(object.summary);
  const double scale = object.entry.scale;
  const spm::PredictionSettings prediction{0, settings_.margin / scale, settings_.min_speed / scale,
                                           settings_.strategy};
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) object.predictors.emplace_back(object.grid, shape_, scale, prediction);
  update_broad_phase(object);
  by_index_[described.index] = &object;
  active_.push_back(&object);
  object.ready = true;
  last_prediction_ns_ = next_prediction_ns_ = 0;
  IntakeObject message;
  message.id = described.id;
  std::copy(described.name.begin(), described.name.end(), message.name.begin());
  message.pose = object.entry.pose;
  message.scale = scale;
  message.material = described.material;
  if (described.body) message.body = object.entry.body;
  message.max_pages = max_pages_of(object.summary);
  intake_.add_object(described.index, message, base);
  for (const spm::Page& page : object.pages_to_send) intake_.add_page(described.index, page);
  std::vector<spm::Page>{}.swap(object.pages_to_send);
  if (on_object) on_object(described);
}

}  // namespace tactus::hrtc_service
