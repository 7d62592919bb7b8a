/// Counts the received records that were received before, in memory of a fixed size.
///
/// Stores a sample of the received records: those whose hash begins with `level_` zeros. When the sample has kMaxSample
/// records, it is halved. A record of the sample counts for 2^level_ records. So the count is exact for a model with up
/// to kMaxSample received records; for others it is an estimate, with a standard error of 2^level_ times the square root
/// of the counted records of the sample.
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
  static constexpr std::uint32_t kMaxSample = 4096;
  static constexpr std::uint64_t kMaxBytes = kMaxSample * sizeof(RecordId);

  /// Adds a received record. Returns the number of records for which it counts if it was received before, else 0.
  std::uint32_t add(RecordId record);
  [[nodiscard]] std::uint32_t sample_size() const noexcept { return static_cast<std::uint32_t>(sample_.size()); }

 private:
  [[nodiscard]] bool is_in_sample(RecordId record) const noexcept;

  std::vector<RecordId> sample_;  // ascending
  std::uint32_t level_ = 0;
};

}  // namespace tactus::spm::codec
