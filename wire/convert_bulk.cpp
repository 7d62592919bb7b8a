#include <limits>
#include <optional>
#include <utility>

#include "wire/convert.hpp"

namespace tactus::wire {
namespace {

void intervals_to_idl(const std::vector<spm::Interval>& from, std::vector<idl::IntervalValue>& to) {
  to.resize(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    to[i].first(from[i].first);
    to[i].length(from[i].count);
  }
}

// A varint has 7 bits in each byte, low bits first. The top bit of a byte is set if another byte follows.
void put_varint(std::vector<std::uint8_t>& to, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) to.push_back(static_cast<std::uint8_t>(value | 0x80));
  to.push_back(static_cast<std::uint8_t>(value));
}

class PieceReader {
 public:
  explicit PieceReader(const std::vector<std::uint8_t>& bytes) : at_{bytes.data()}, end_{at_ + bytes.size()} {}
  [[nodiscard]] bool done() const noexcept { return at_ == end_; }

  /// None if bytes are missing or a number is out of range.
  [[nodiscard]] std::optional<session::BulkPiece> next() {
    session::BulkPiece piece;
    constexpr std::uint64_t kMax32 = std::numeric_limits<std::uint32_t>::max();
    const auto region = varint(std::uint64_t{spm::kNone} + 1), part = varint(kMax32), parts = varint(kMax32),
               size = varint(session::kMaxPayload);
    if (!region || *region == 0 || !part || !parts || !size) return std::nullopt;
    if (static_cast<std::size_t>(end_ - at_) < sizeof piece.checksum + *size) return std::nullopt;
    piece.region = static_cast<std::uint32_t>(*region - 1);
    piece.index = static_cast<std::uint32_t>(*part);
    piece.count = static_cast<std::uint32_t>(*parts);
    for (unsigned shift = 0; shift < 32; shift += 8) piece.checksum |= std::uint32_t{*at_++} << shift;
    piece.payload.assign(at_, at_ + *size);
    at_ += *size;
    return piece;
  }

 private:
  [[nodiscard]] std::optional<std::uint64_t> varint(std::uint64_t max) noexcept {
    std::uint64_t value = 0;
    for (unsigned shift = 0; at_ != end_ && shift < 35; shift += 7) {
      const std::uint8_t byte = *at_++;
      value |= std::uint64_t{byte & 0x7fu} << shift;
      if (byte < 0x80) return value <= max ? std::optional{value} : std::nullopt;
    }
    return std::nullopt;
  }

  const std::uint8_t* at_;
  const std::uint8_t* end_;
};

void intervals_from_idl(const std::vector<idl::IntervalValue>& from, std::vector<spm::Interval>& to) {
  to.resize(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) to[i] = {from[i].first(), from[i].length()};
}

}  // namespace

void to_idl(const session::Demand& from, idl::Demand& to) {
  origin_to_idl(from.origin, to);
  to.object_id(from.object_id);
  to.digest(from.digest);
  to.serving_host(from.serving_host);
  to.epoch(from.epoch);
  to.need_base(from.need_base);
  intervals_to_idl(from.have, to.have());
  to.wanted().resize(from.wanted.size());
  for (std::size_t i = 0; i < from.wanted.size(); ++i) {
    to.wanted()[i].region(from.wanted[i].region);
    to.wanted()[i].contact_in_us(from.wanted[i].contact_in_us);
  }
  to.stream(from.stream);
  to.received(from.received);
  to.newest(from.newest);
  intervals_to_idl(from.gaps, to.gaps());
  to.credit(from.credit);
  to.arrivals(from.arrivals);
  to.one_way_us(from.one_way_us);
}

void from_idl(const idl::Demand& from, session::Demand& to) {
  to.origin = origin_from_idl(from);
  to.object_id = from.object_id();
  to.digest = from.digest();
  to.serving_host = from.serving_host();
  to.epoch = from.epoch();
  to.need_base = from.need_base();
  intervals_from_idl(from.have(), to.have);
  to.wanted.resize(from.wanted().size());
  for (std::size_t i = 0; i < to.wanted.size(); ++i) {
    to.wanted[i] = {from.wanted()[i].region(), from.wanted()[i].contact_in_us()};
  }
  to.stream = from.stream();
  to.received = from.received();
  to.newest = from.newest();
  intervals_from_idl(from.gaps(), to.gaps);
  to.credit = from.credit();
  to.arrivals = from.arrivals();
  to.one_way_us = from.one_way_us();
}

void to_idl(const session::BulkChunk& from, idl::BulkChunk& to) {
  to.stream(from.stream);
  to.sequence_number(from.sequence);
  to.epoch(from.epoch);
  to.sent_us(from.sent_us);
  std::vector<std::uint8_t>& bytes = to.payload();
  bytes.clear();
  for (const session::BulkPiece& piece : from.pieces) {
    put_varint(bytes, std::uint64_t{piece.region} + 1);
    put_varint(bytes, piece.index);
    put_varint(bytes, piece.count);
    put_varint(bytes, piece.payload.size());
    for (unsigned shift = 0; shift < 32; shift += 8)
      bytes.push_back(static_cast<std::uint8_t>(piece.checksum >> shift));
    bytes.insert(bytes.end(), piece.payload.begin(), piece.payload.end());
  }
}

void from_idl(const idl::BulkChunk& from, session::BulkChunk& to) {
  to.stream = from.stream();
  to.sequence = from.sequence_number();
  to.epoch = from.epoch();
  to.sent_us = from.sent_us();
  to.pieces.clear();
  for (PieceReader reader{from.payload()}; !reader.done();) {
    auto piece = reader.next();
    to.pieces.push_back(piece ? std::move(*piece) : session::BulkPiece{});  // refused by invalid_field
    if (!piece) return;
  }
}

}  // namespace tactus::wire
