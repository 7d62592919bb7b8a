#include "hrtc_service/intake_sender.hpp"

#include <algorithm>
#include <array>

namespace tactus::hrtc_service {
namespace {

template <class T>
std::span<const std::byte> bytes_of(const T& value) {
  static_assert(std::is_trivially_copyable_v<T>);
  return std::as_bytes(std::span{&value, 1});
}
template <class T>
std::span<const std::byte> bytes_of(const std::vector<T>& values) {
  static_assert(std::is_trivially_copyable_v<T>);
  return std::as_bytes(std::span{values});
}

std::uint32_t size_of(const auto& values) noexcept { return static_cast<std::uint32_t>(values.size()); }

}  // namespace

IntakeSender::IntakeSender(IntakeLink& link, const spm::PoolSettings& pool)
    : is_attached_{link.messages.pushed.load() == 0 && link.attach_requests.load() == 0},
      attach_answers_{link.attach_answers},
      messages_{link.messages},
      answers_{link.answers} {
  if (is_attached_)
    free_ = reported_ = {pool.slots, pool.list_blocks};
  else
    request_ = link.attach_requests.fetch_add(1, std::memory_order_release) + 1;
}

bool IntakeSender::take_attach_answer(AttachAnswer& answer) {
  if (is_attached_ || !attach_answers_.take(answer) || answer.request != request_) return false;
  is_attached_ = true;
  answers_.skip_to(answer.answers_begin);
  free_ = reported_ = answer.free;
  return true;
}

template <class... Parts>
void IntakeSender::append(IntakeKind kind, std::uint32_t index, const spm::Cache::Space& cost, const Parts&... parts) {
  const IntakeHeader header{kind, index, (std::uint64_t{0} + ... + bytes_of(parts).size())};
  const auto copy = [this](std::span<const std::byte> bytes) {
    waiting_.insert(waiting_.end(), bytes.begin(), bytes.end());
  };
  copy(bytes_of(header));
  (copy(bytes_of(parts)), ...);
  unanswered_.push_back({++message_count_, cost});
  free_.slots -= std::min(free_.slots, cost.slots);
  free_.blocks -= std::min(free_.blocks, cost.blocks);
}

void IntakeSender::add_object(std::uint32_t index, IntakeObject object, const spm::BaseMesh& base) {
  object.summary = base.summary;
  append(IntakeKind::kObject, index, {spm::Cache::slots_for_base(base.summary), 0}, object, base.positions, base.radii,
         base.faces);
}

void IntakeSender::add_page(std::uint32_t index, const spm::Page& page) {
  append(IntakeKind::kPage, index, {}, IntakePage{page.id, page.first, size_of(page.regions)}, page.regions);
}

void IntakeSender::drop_page(std::uint32_t index, spm::PageId page) { append(IntakeKind::kDropPage, index, {}, page); }

void IntakeSender::add_region(std::uint32_t index, const spm::RegionData& region, const spm::ListSummary& expected) {
  const IntakeRegion message{
      region.region,        expected, size_of(region.list), size_of(region.sent), size_of(region.residuals),
      size_of(region.parts)};
  append(IntakeKind::kRegion, index, {size_of(region.parts), spm::ListBlock::blocks_for(expected.records)}, message,
         region.list, region.sent, region.residuals, region.parts);
}

void IntakeSender::retire(std::uint32_t index, spm::RegionId region) { append(IntakeKind::kRetire, index, {}, region); }

void IntakeSender::withdraw(std::uint32_t index) { append(IntakeKind::kWithdraw, index, {}); }

bool IntakeSender::flush() {
  if (!is_attached_) return waiting_.empty();
  sent_ += messages_.push(std::span{waiting_}.subspan(sent_));
  if (sent_ < waiting_.size()) return false;
  constexpr std::size_t kMaxKept = 1u << 20;  // bytes; only base meshes need more
  waiting_.clear();
  if (waiting_.capacity() > kMaxKept) waiting_.shrink_to_fit();
  sent_ = 0;
  return true;
}

bool IntakeSender::take(IntakeAnswer& answer) {
  if (!is_attached_ || !answers_.pop(answer)) return false;
  reported_ = answer.free;
  while (!unanswered_.empty() && unanswered_.front().message <= answer.processed) unanswered_.pop_front();
  free_ = reported_;
  for (const Cost& cost : unanswered_) {
    free_.slots -= std::min(free_.slots, cost.memory.slots);
    free_.blocks -= std::min(free_.blocks, cost.memory.blocks);
  }
  return true;
}

}  // namespace tactus::hrtc_service
