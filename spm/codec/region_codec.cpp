#include "spm/codec/region_codec.hpp"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "spm/codec/interval_codec.hpp"
#include "spm/codec/record_reader.hpp"

namespace tactus::spm::codec {
namespace {

constexpr unsigned kIdBits = 32;

/// Converts a subset of `list` to intervals of positions in `list`. Returns nothing if it is not a subset.
std::optional<std::vector<Interval>> positions_in(std::span<const Interval> list, std::span<const Interval> subset) {
  std::vector<Interval> positions;
  std::uint32_t before = 0;  // positions in the earlier intervals of the list
  auto in = list.begin();
  for (const Interval& interval : subset) {
    for (; in != list.end() && in->first + in->count <= interval.first; ++in) before += in->count;
    if (in == list.end() || interval.first < in->first || interval.count > in->first + in->count - interval.first)
      return std::nullopt;
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
  RegionDecoder(std::span<const std::uint8_t> bytes, const ModelSummary& summary, const RecordTables& tables)
      : in_{bytes}, summary_{summary}, tables_{tables}, records_{summary, tables} {}

  Result<RegionData> decode() {
    if (!get_lists(kNone)) return DecodeError{error_};
    data_.residuals.reserve(sent_);
    data_.parts.reserve(sent_);
    if (!get_records([this](const RecordCode&) { data_.residuals.push_back(residuals_); })) return DecodeError{error_};
    return std::move(data_);
  }

  Result<RegionCodes> check(std::uint32_t max_records) {
    RegionCodes result;
    const bool has_lists = get_lists(max_records);
    result.region = data_.region;
    result.is_too_long = is_too_long_;
    if (is_too_long_) return result;
    if (!has_lists) return DecodeError{error_};
    result.codes.reserve(sent_);
    const bool good = get_records([&](const RecordCode& code) {
      result.codes.push_back(code);
      data_.parts.clear();
    });
    if (!good) return DecodeError{error_};
    result.list = std::move(data_.list);
    result.sent = std::move(data_.sent);
    return result;
  }

 private:
  [[nodiscard]] std::string where() const { return "region " + text(index(data_.region)) + ": "; }
  bool refuse(const std::string& what) {
    error_ = where() + what;
    return false;
  }
  bool refuse(const char* what, std::uint64_t found, const char* relation, std::uint64_t expected) {
    return refuse(what + (": found " + text(found)) + ", expected " + relation + " " + text(expected));
  }

  /// Reads region, list and sent records. If the list has more than `max_records`, sets `is_too_long_` and returns
  /// false.
  bool get_lists(std::uint32_t max_records) {
    const auto region = static_cast<std::uint32_t>(in_.get(kIdBits));
    if (in_.ok() && region >= summary_.regions) return refuse("region id", region, "below", summary_.regions);
    data_.region = RegionId{region};
    BitReader ahead = in_;
    is_too_long_ = in_.ok() && get_length_prefixed(ahead) > max_records && ahead.ok();
    if (is_too_long_) return false;
    std::uint32_t listed = 0;
    std::vector<Interval> positions;
    if (!get_intervals_below(summary_.records, data_.list, listed)) return false;
    is_too_long_ = listed > max_records;
    if (is_too_long_ || !get_intervals_below(listed, positions, sent_)) return false;
    data_.sent = records_at(data_.list, positions);
    return in_.remaining() / RecordReader::kMinBits >= sent_ ||
           refuse("number of sent records", sent_, "at most", in_.remaining() / RecordReader::kMinBits);
  }

  bool get_intervals_below(std::uint32_t limit, std::vector<Interval>& intervals, std::uint32_t& total) {
    const std::string error = get_intervals(in_, tables_, limit, intervals, total);
    return error.empty() || refuse(error);
  }

  /// Reads the sent records. Appends the parts of each to `data_`, sets `residuals_`, and calls `visit` with its code.
  template <class Visit>
  bool get_records(Visit visit) {
    std::uint64_t parts = 0;
    FaceId anchor{};  // of the previous record
    for (const Interval& interval : data_.sent) {
      for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) {
        anchor = r == interval.first ? records_.get_first_anchor(in_, anchor) : records_.get_anchor(in_, anchor);
        const std::uint64_t first = in_.position();
        const std::size_t before = data_.parts.size();
        if (!records_.get(in_, RecordId{r}, anchor, data_.parts, residuals_)) return refuse(records_.error());
        parts += data_.parts.size() - before;
        if (parts > summary_.parts) return refuse("number of parts", parts, "at most", summary_.parts);
        visit(RecordCode{anchor, first, in_.position() - first});
      }
    }
    if (!in_.ok()) return refuse("the message is truncated");
    return in_.remaining() < 8 || refuse("number of bytes after the last record", in_.remaining() / 8, "exactly", 0);
  }

  BitReader in_;
  const ModelSummary& summary_;
  const RecordTables& tables_;
  RecordReader records_;
  RegionData data_;
  std::uint32_t sent_ = 0;  // number of sent records
  bool is_too_long_ = false;
  PositionPredictor::Residuals residuals_{};  // of the current record
  std::string error_;                         // the first error
};

}  // namespace

Result<Bytes> encode_region(const CompressedModel& model, RegionId region, std::span<const Interval> missing) {
  if (std::string damage = model.damage(region, {}); !damage.empty()) return DecodeError{std::move(damage)};
  const std::vector<Interval> list = model.intervals_of(region);
  const std::optional<std::vector<Interval>> positions = positions_in(list, missing);
  if (!positions) return DecodeError{"region " + text(index(region)) + ": its list lacks a record to send"};
  if (std::string damage = model.damage(region, missing); !damage.empty()) return DecodeError{std::move(damage)};
  BitWriter out;
  out.put(index(region), kIdBits);
  put_intervals(out, model.tables(), list);
  put_intervals(out, model.tables(), *positions);
  model.put_records(out, missing);
  return out.take();
}

Result<RegionData> decode_region(std::span<const std::uint8_t> bytes, const ModelSummary& summary,
                                 const RecordTables& tables) {
  return RegionDecoder{bytes, summary, tables}.decode();
}

Result<RegionCodes> check_region(std::span<const std::uint8_t> bytes, const ModelSummary& summary,
                                 const RecordTables& tables, std::uint32_t max_records) {
  return RegionDecoder{bytes, summary, tables}.check(max_records);
}

}  // namespace tactus::spm::codec
