#include "spm/codec/received_records.hpp"

#include <algorithm>

namespace tactus::spm::codec {

bool ReceivedRecords::is_in_subset(RecordId record) const noexcept {
  constexpr std::uint64_t kGoldenRatio = 0x9e3779b97f4a7c15ull;  // its multiples are evenly distributed
  return halvings_ == 0 || index(record) * kGoldenRatio >> (64 - halvings_) == 0;
}

std::uint32_t ReceivedRecords::add(RecordId record) {
  if (!is_in_subset(record)) return 0;
  const auto at = std::lower_bound(stored_.begin(), stored_.end(), record);
  if (at != stored_.end() && *at == record) return 1u << halvings_;
  stored_.insert(at, record);
  while (stored_.size() == kMaxStored) {
    ++halvings_;
    std::erase_if(stored_, [this](RecordId each) { return !is_in_subset(each); });
  }
  return 0;
}

}  // namespace tactus::spm::codec
