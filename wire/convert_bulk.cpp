#include "wire/convert.hpp"

namespace tactus::wire {

void to_idl(const session::Demand& from, idl::Demand& to) {
  origin_to_idl(from.origin, to);
  to.object_id(from.object_id);
  to.digest(from.digest);
  to.serving_host(from.serving_host);
  to.epoch(from.epoch);
  to.need_base(from.need_base);
  to.have().resize(from.have.size());
  for (std::size_t i = 0; i < from.have.size(); ++i) {
    to.have()[i].first(from.have[i].first);
    to.have()[i].length(from.have[i].count);
  }
  to.wanted().resize(from.wanted.size());
  for (std::size_t i = 0; i < from.wanted.size(); ++i) {
    to.wanted()[i].region(from.wanted[i].region);
    to.wanted()[i].contact_in_us(from.wanted[i].contact_in_us);
  }
  to.stream_incarnation(from.stream_incarnation);
  to.received(from.received);
  to.credit(from.credit);
}

void from_idl(const idl::Demand& from, session::Demand& to) {
  to.origin = origin_from_idl(from);
  to.object_id = from.object_id();
  to.digest = from.digest();
  to.serving_host = from.serving_host();
  to.epoch = from.epoch();
  to.need_base = from.need_base();
  to.have.resize(from.have().size());
  for (std::size_t i = 0; i < to.have.size(); ++i) to.have[i] = {from.have()[i].first(), from.have()[i].length()};
  to.wanted.resize(from.wanted().size());
  for (std::size_t i = 0; i < to.wanted.size(); ++i) {
    to.wanted[i] = {from.wanted()[i].region(), from.wanted()[i].contact_in_us()};
  }
  to.stream_incarnation = from.stream_incarnation();
  to.received = from.received();
  to.credit = from.credit();
}

void to_idl(const session::BulkChunk& from, idl::BulkChunk& to) {
  origin_to_idl(from.origin, to);
  to.hrtc(from.hrtc);
  to.object_id(from.object_id);
  to.digest(from.digest);
  to.sequence_number(from.sequence);
  to.epoch(from.epoch);
  to.content(static_cast<idl::BulkContent>(from.kind));
  to.region(from.region);
  to.part(from.part);
  to.part_count(from.parts);
  to.checksum(from.checksum);
  to.payload(from.payload);
}

void from_idl(const idl::BulkChunk& from, session::BulkChunk& to) {
  to.origin = origin_from_idl(from);
  to.hrtc = from.hrtc();
  to.object_id = from.object_id();
  to.digest = from.digest();
  to.sequence = from.sequence_number();
  to.epoch = from.epoch();
  to.kind = enum_from_idl<session::BulkKind>(from.content());
  to.region = from.region();
  to.part = from.part();
  to.parts = from.part_count();
  to.checksum = from.checksum();
  to.payload = from.payload();
}

}  // namespace tactus::wire
