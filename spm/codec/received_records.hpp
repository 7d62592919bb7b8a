/// Counts the received records that were received before, in memory of a fixed size.
///
/// Stores a subset of the received records: those whose hash begins with `halvings_` zeros. When the subset has
/// kMaxStored records, it is halved. A record of the subset counts for 2^halvings_ records. So the count is exact for
/// fewer than kMaxStored received records; for more it is an estimate, with a standard error of 2^halvings_ times the
/// square root of the counted records of the subset.
///
/// One thread. Allocates.
/// Source: Gibbons, Distinct Sampling for Highly-Accurate Answers to Distinct Values Queries, VLDB 2001.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/ids.hpp"

namespace tactus::spm::codec {

class ReceivedRecords {
 public:
  static constexpr std::uint32_t kMaxStored = 4096;
  static constexpr std::uint64_t kMaxBytes = kMaxStored * sizeof(RecordId);

  /// Adds a received record. Returns the number of records for which it counts if it was received before, else 0.
  std::uint32_t add(RecordId record);
  [[nodiscard]] std::uint32_t stored() const noexcept { return static_cast<std::uint32_t>(stored_.size()); }

 private:
  [[nodiscard]] bool is_in_subset(RecordId record) const noexcept;

  std::vector<RecordId> stored_;  // ascending
  std::uint32_t halvings_ = 0;
};

}  // namespace tactus::spm::codec
