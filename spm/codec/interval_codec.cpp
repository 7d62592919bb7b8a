#include "spm/codec/interval_codec.hpp"

namespace tactus::spm::codec {
namespace {

constexpr std::uint64_t kMinIntervalBits = 2;  // one for the distance, one for the length

std::string text(std::uint64_t value) { return std::to_string(value); }

}  // namespace

void put_intervals(BitWriter& out, const RecordTables& tables, std::span<const Interval> intervals) {
  put_length_prefixed(out, intervals.size());
  std::uint32_t end = 0;
  for (const Interval& interval : intervals) {
    put_number(out, tables[Field::kIntervalDistance], interval.first - end);
    put_number(out, tables[Field::kIntervalLength], interval.count - 1);
    end = interval.first + interval.count;
  }
}

std::string get_intervals(BitReader& in, const RecordTables& tables, std::uint32_t limit,
                          std::vector<Interval>& intervals, std::uint32_t& total) {
  const std::uint64_t count = get_length_prefixed(in);
  if (!in.ok() || in.remaining() / kMinIntervalBits < count) {
    return text(count) + " intervals do not fit into the remaining " + text(in.remaining()) + " bits";
  }
  intervals.resize(count);
  total = 0;
  bool ok = true;
  std::uint64_t end = 0;
  for (Interval& interval : intervals) {
    const std::uint64_t distance = get_number(in, tables[Field::kIntervalDistance], ok);
    const std::uint64_t length = get_number(in, tables[Field::kIntervalLength], ok) + 1;
    const std::uint64_t first = end + distance;
    if (!ok || !in.ok() || (distance == 0 && end != 0) || first + length > limit) {
      return "interval of " + text(length) + " records from " + text(first) + " after an interval that ends at " +
             text(end) + ", expected a distance of at least 1 and an end of at most " + text(limit);
    }
    interval = {static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(length)};
    end = first + length;
    total += interval.count;
  }
  return {};
}

}  // namespace tactus::spm::codec
