#include "latency/load.hpp"

#include <algorithm>

#include "latency/carrier.hpp"
#include "wire/realtime.hpp"

namespace tactus::latency {
namespace {

constexpr char kSinkName[] = "latency-sink";

/// The load goes over DDS also beside raw UDP.
Cell of_load(Cell cell) {
  if (cell.transport == Transport::kRawUdp) cell.transport = Transport::kUdp;
  return cell;
}

}  // namespace

Load::Load(const Cell& cell, wire::SessionAddress address)
    : mbit_{cell.load_mbit},
      links_{join(of_load(cell), std::move(address))},
      writer_{std::make_unique<wire::Writer<session::BulkChunk>>(*links_, wire::topics::kRecords,
                                                                 wire::EndOptions{wire::hrtc_partition(kSinkName)})} {}

Load::~Load() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void Load::start() {
  thread_ = std::thread{[this] { run(); }};
}

void Load::run() {
  constexpr std::int64_t kPeriodNs = 1'000'000;
  session::BulkChunk chunk;
  chunk.hrtc = session::id_of(kSinkName);
  chunk.kind = session::BulkKind::kRegion;
  chunk.payload.assign(session::kMaxPayload, 0x5a);
  const double chunks_per_period = mbit_ * 1e6 / 8 * kPeriodNs * 1e-9 / session::kMaxPayload;
  double due = 0;  // chunks
  for (std::int64_t next = wire::monotonic_ns(); !stop_; next += kPeriodNs) {
    if (mbit_ != kUnpaced) wire::sleep_until(next);
    // What a full history holds up is not made up for: the rate is a ceiling.
    due = mbit_ == kUnpaced ? 1 : std::min(due + chunks_per_period, chunks_per_period + 1);
    for (; due >= 1 && !stop_; due -= 1) {
      chunk.origin = links_->origin();
      ++chunk.sequence;
      if (writer_->send(chunk) != wire::SendStatus::kSent) break;
    }
  }
}

Sink::Sink(const Cell& cell, wire::SessionAddress address) : links_{join(of_load(cell), std::move(address))} {
  reader_ = std::make_unique<wire::Reader<session::BulkChunk>>(
      *links_, wire::topics::kRecords,
      [this](session::BulkChunk&& chunk) {
        const std::int64_t now = wire::monotonic_ns();
        if (first_ns_ == 0)
          first_ns_ = now;
        else
          bytes_ += chunk.payload.size();
        last_ns_ = now;
      },
      wire::EndOptions{wire::hrtc_partition(kSinkName)});
}

double Sink::bytes_per_s() const noexcept {
  const std::int64_t passed = last_ns_ - first_ns_;
  return passed > 0 ? static_cast<double>(bytes_) * 1e9 / static_cast<double>(passed) : 0;
}

}  // namespace tactus::latency
