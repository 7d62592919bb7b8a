#include "spm/codec/region_codec.hpp"

#include <algorithm>
#include <utility>

#include "spm/codec/interval_codec.hpp"
#include "spm/codec/record_reader.hpp"

namespace tactus::spm::codec {
namespace {

constexpr unsigned kIdBits = 32;

/// Converts a subset of `list` to intervals of positions in `list`.
std::vector<Interval> positions_in(std::span<const Interval> list, std::span<const Interval> subset) {
  std::vector<Interval> positions;
  std::uint32_t before = 0;  // positions in the earlier intervals of the list
  auto in = list.begin();
  for (const Interval& interval : subset) {
    for (; in->first + in->count <= interval.first; ++in) before += in->count;
    const std::uint32_t first = before + (interval.first - in->first);
    if (!positions.empty() && positions.back().first + positions.back().count == first) {
      positions.back().count += interval.count;
    } else {
      positions.push_back({first, interval.count});
    }
  }
  return positions;
}

/// Converts intervals of positions in `list` to intervals of record numbers. The positions must be below the length of
/// `list`.
std::vector<Interval> records_at(std::span<const Interval> list, std::span<const Interval> positions) {
  std::vector<Interval> records;
  std::uint32_t before = 0;
  auto in = list.begin();
  for (const Interval& interval : positions) {
    std::uint32_t at = interval.first;
    for (std::uint32_t left = interval.count; left > 0;) {
      for (; before + in->count <= at; ++in) before += in->count;
      const std::uint32_t from = at - before;
      const std::uint32_t count = std::min(left, in->count - from);
      records.push_back({in->first + from, count});
      at += count;
      left -= count;
    }
  }
  return records;
}

std::string text(std::uint64_t value) { return std::to_string(value); }

/// Decodes one message.
class RegionDecoder {
 public:
  RegionDecoder(std::span<const std::uint8_t> bytes, const ModelSummary& summary, const RecordTables& tables,
                std::vector<RecordCode>* codes)
      : in_{bytes}, summary_{summary}, tables_{tables}, records_{summary, tables}, codes_{codes} {}

  Result<RegionData> decode() {
    const auto region = static_cast<std::uint32_t>(in_.get(kIdBits));
    if (in_.ok() && region >= summary_.regions) return refuse("region id", region, "below", summary_.regions);
    data_.region = RegionId{region};
    std::uint32_t listed = 0;
    std::uint32_t sent = 0;
    std::vector<Interval> positions;
    if (!get_intervals_below(summary_.records, data_.list, listed) || !get_intervals_below(listed, positions, sent))
      return DecodeError{error_};
    data_.sent = records_at(data_.list, positions);
    if (in_.remaining() / RecordReader::kMinBits < sent)
      return refuse("number of sent records", sent, "at most", in_.remaining() / RecordReader::kMinBits);
    data_.residuals.resize(sent);
    data_.parts.reserve(sent);
    if (codes_ != nullptr) codes_->reserve(sent);
    std::uint32_t at = 0;
    for (const Interval& interval : data_.sent) {
      for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) {
        if (!get_record(RecordId{r}, r == interval.first, data_.residuals[at++])) return DecodeError{error_};
      }
    }
    if (!in_.ok()) return DecodeError{where() + "the message is truncated"};
    if (in_.remaining() >= 8) return refuse("number of bytes after the last record", in_.remaining() / 8, "exactly", 0);
    return std::move(data_);
  }

 private:
  [[nodiscard]] std::string where() const { return "region " + text(index(data_.region)) + ": "; }
  DecodeError refuse(const char* what, std::uint64_t found, const char* relation, std::uint64_t expected) const {
    return {where() + what + ": found " + text(found) + ", expected " + relation + " " + text(expected)};
  }

  bool get_intervals_below(std::uint32_t limit, std::vector<Interval>& intervals, std::uint32_t& total) {
    const std::string error = get_intervals(in_, tables_, limit, intervals, total);
    if (!error.empty()) error_ = where() + error;
    return error.empty();
  }

  bool get_record(RecordId record, bool begins_interval, PositionPredictor::Residuals& residuals) {
    anchor_ = begins_interval ? records_.get_first_anchor(in_, anchor_) : records_.get_anchor(in_, anchor_);
    const std::uint64_t first = in_.position();
    const bool good = records_.get(in_, record, anchor_, data_.parts, residuals);
    if (good && codes_ != nullptr) codes_->push_back({anchor_, first, in_.position() - first});
    if (good) return true;
    error_ = where() + records_.error();
    return false;
  }

  BitReader in_;
  const ModelSummary& summary_;
  const RecordTables& tables_;
  RecordReader records_;
  FaceId anchor_{};  // of the previous record
  std::vector<RecordCode>* codes_;
  RegionData data_;
  std::string error_;  // the first error
};

}  // namespace

Result<Bytes> encode_region(const CompressedModel& model, RegionId region, std::span<const Interval> missing) {
  if (std::string damage = model.damage(region, missing); !damage.empty()) return DecodeError{std::move(damage)};
  BitWriter out;
  const std::vector<Interval> list = model.intervals_of(region);
  out.put(index(region), kIdBits);
  put_intervals(out, model.tables(), list);
  put_intervals(out, model.tables(), positions_in(list, missing));
  model.put_records(out, missing);
  return out.take();
}

Result<RegionData> decode_region(std::span<const std::uint8_t> bytes, const ModelSummary& summary,
                                 const RecordTables& tables, std::vector<RecordCode>* codes) {
  if (codes != nullptr) codes->clear();
  return RegionDecoder{bytes, summary, tables, codes}.decode();
}

}  // namespace tactus::spm::codec
