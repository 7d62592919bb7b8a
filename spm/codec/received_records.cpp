#include "spm/codec/received_records.hpp"

#include <algorithm>

namespace tactus::spm::codec {

bool ReceivedRecords::is_in_sample(RecordId record) const noexcept {
  constexpr std::uint64_t kGoldenRatio = 0x9e3779b97f4a7c15ull;  // its multiples are evenly distributed
  return level_ == 0 || index(record) * kGoldenRatio >> (64 - level_) == 0;
}

std::uint32_t ReceivedRecords::add(RecordId record) {
  if (!is_in_sample(record)) return 0;
  const auto at = std::lower_bound(sample_.begin(), sample_.end(), record);
  if (at != sample_.end() && *at == record) return 1u << level_;
  sample_.insert(at, record);
  while (sample_.size() == kMaxSample) {
    ++level_;
    std::erase_if(sample_, [this](RecordId each) { return !is_in_sample(each); });
  }
  return 0;
}

}  // namespace tactus::spm::codec
