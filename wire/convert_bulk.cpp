#include "wire/convert.hpp"

namespace tactus::wire {
namespace {

void runs_to_idl(const std::vector<spm::Run>& from, std::vector<idl::RunValue>& to) {
  to.resize(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    to[i].first(from[i].first);
    to[i].length(from[i].count);
  }
}

void runs_from_idl(const std::vector<idl::RunValue>& from, std::vector<spm::Run>& to) {
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
  runs_to_idl(from.have, to.have());
  to.wanted().resize(from.wanted.size());
  for (std::size_t i = 0; i < from.wanted.size(); ++i) {
    to.wanted()[i].region(from.wanted[i].region);
    to.wanted()[i].contact_in_us(from.wanted[i].contact_in_us);
  }
  to.stream(from.stream);
  to.received(from.received);
  to.newest(from.newest);
  runs_to_idl(from.gaps, to.gaps());
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
  runs_from_idl(from.have(), to.have);
  to.wanted.resize(from.wanted().size());
  for (std::size_t i = 0; i < to.wanted.size(); ++i) {
    to.wanted[i] = {from.wanted()[i].region(), from.wanted()[i].contact_in_us()};
  }
  to.stream = from.stream();
  to.received = from.received();
  to.newest = from.newest();
  runs_from_idl(from.gaps(), to.gaps);
  to.credit = from.credit();
  to.arrivals = from.arrivals();
  to.one_way_us = from.one_way_us();
}

void to_idl(const session::BulkChunk& from, idl::BulkChunk& to) {
  to.stream(from.stream);
  to.sequence_number(from.sequence);
  to.epoch(from.epoch);
  to.region(from.region);
  to.part(from.part);
  to.part_count(from.parts);
  to.sent_us(from.sent_us);
  to.checksum(from.checksum);
  to.payload(from.payload);
}

void from_idl(const idl::BulkChunk& from, session::BulkChunk& to) {
  to.stream = from.stream();
  to.sequence = from.sequence_number();
  to.epoch = from.epoch();
  to.region = from.region();
  to.part = from.part();
  to.parts = from.part_count();
  to.sent_us = from.sent_us();
  to.checksum = from.checksum();
  to.payload = from.payload();
}

}  // namespace tactus::wire
