#include "latency/load.hpp"

#include <algorithm>
#include <utility>

#include "latency/statistics.hpp"
#include "realtime/realtime.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"

namespace tactus::latency {
namespace {

constexpr char kSinkName[] = "sink";
constexpr char kObjectName[] = "load";
constexpr std::uint32_t kFaces = 200'000;
// Regions that the sink holds. It evicts the others, because a host sends a region again only after its eviction.
constexpr std::size_t kMinHeld = 60, kMaxHeld = 200;
constexpr std::size_t kMaxWanted = 200;        // regions requested at once
constexpr std::int64_t kPauseNs = 20'000'000;  // between bursts
constexpr std::chrono::microseconds kInboxTimeout{1000};

/// Returns the test with DDS over UDP instead of raw UDP, because the load always uses DDS.
TestCase load_test(TestCase test) {
  if (test.transport == Transport::kRawUdp) test.transport = Transport::kUdp;
  return test;
}

wire::SessionAddress named(wire::SessionAddress address, const char* participant) {
  address.participant = participant;
  return address;
}

const spm::codec::CompressedModel& model() {
  static const spm::offline::BuiltModel built =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kOrgan, kFaces));
  static const spm::codec::EncodedModel encoded{built.model()};
  return encoded.compressed();
}

}  // namespace

MeshSource::MeshSource(const TestCase& test, wire::SessionAddress address, wire::Participants* shared)
    : mbit_{test.load_mbit},
      is_flood_{test.profile != Profile::kTactus},
      is_tuned_{test.profile == Profile::kTuned},
      own_participants_{shared == nullptr ? join_session(load_test(test), std::move(address)) : nullptr},
      participants_{shared == nullptr ? *own_participants_ : *shared},
      catalogue_{participants_, wire::topics::kCatalogue},
      base_{participants_, wire::topics::kBase, {wire::hrtc_partition(kSinkName)}},
      records_{participants_, wire::topics::kRecords, {wire::hrtc_partition(kSinkName)}},
      reader_{participants_, wire::topics::kDemand,
              [this](session::Demand&& demand) { demands_.put(std::move(demand)); }} {
  if (!is_flood_) (void)model();
}

MeshSource::~MeshSource() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void MeshSource::start() {
  thread_ = std::thread{[this] { is_flood_ ? flood() : serve(); }};
}

/// Serves the model as host_service does. The rate of the test limits the traffic in addition to the pacer.
void MeshSource::serve() {
  session::DeliveryServer server{participants_.origin(), participants_.chunk_bytes()};
  const std::uint64_t object = session::id_of(kObjectName);
  server.add(object, model());
  session::CatalogueEntry entry;
  entry.origin = participants_.origin();
  entry.host = participants_.address().participant;
  entry.object = kObjectName;
  entry.object_id = object;
  entry.summary = model().summary();
  entry.base_bytes = server.base_bytes(object);
  (void)catalogue_.send(entry);
  const double bytes_per_ns = mbit_ * 1e6 / 8 * 1e-9;
  std::int64_t next_ns = realtime::monotonic_ns();
  std::chrono::microseconds timeout{0};
  while (!stop_) {
    for (const auto& arrived : demands_.take(timeout)) (void)server.on_demand(arrived.sample, arrived.at_ns);
    timeout = std::chrono::microseconds{0};
    constexpr int kChunksPerRound = 64;
    for (int i = 0; i < kChunksPerRound; ++i) {
      const std::int64_t now_ns = realtime::monotonic_ns();
      const bool may_send = mbit_ == kUnpaced || now_ns >= next_ns;
      const auto out = server.next(now_ns, [&](std::uint64_t) { return may_send; });
      if (!out) {
        const std::int64_t due = (may_send ? server.due_ns() : next_ns) - now_ns;
        timeout = std::clamp(std::chrono::microseconds{due / 1000}, std::chrono::microseconds{0}, 5 * kInboxTimeout);
        break;
      }
      (void)(out->chunk.kind() == session::BulkKind::kBase ? base_ : records_).send(out->chunk);
      sent_bytes_ += out->chunk.payload_bytes();
      if (mbit_ != kUnpaced)
        next_ns = std::max(next_ns, now_ns - 1'000'000) +
                  static_cast<std::int64_t>(static_cast<double>(out->chunk.payload_bytes()) / bytes_per_ns);
    }
  }
}

void MeshSource::flood() {
  constexpr std::int64_t kPeriodNs = 1'000'000;
  session::BulkChunk chunk;
  chunk.pieces.resize(1);
  const std::size_t max = is_tuned_ ? kTunedChunkBytes : participants_.chunk_bytes();
  const std::size_t size = max - session::header_bytes(chunk.pieces[0].region, 1);
  chunk.pieces[0].payload.assign(size, 0x5a);
  const double chunks_per_period = mbit_ * 1e6 / 8 * kPeriodNs * 1e-9 / static_cast<double>(size);
  double due = 0;  // chunks
  for (std::int64_t next = realtime::monotonic_ns(); !stop_; next += kPeriodNs) {
    if (mbit_ != kUnpaced) realtime::sleep_until(next);
    // After the history was full, does not send the missed chunks later: the rate is an upper limit.
    due = mbit_ == kUnpaced ? 1 : std::min(due + chunks_per_period, chunks_per_period + 1);
    for (; due >= 1 && !stop_; due -= 1) {
      ++chunk.sequence;
      if (records_.send(chunk) != wire::SendStatus::kSent) break;
      sent_bytes_ += size;
    }
  }
}

MeshSink::MeshSink(const TestCase& test, wire::SessionAddress address, std::size_t burst_bytes,
                   wire::Participants* shared)
    : seconds_{test.seconds},
      min_burst_{burst_bytes},
      is_flood_{test.profile != Profile::kTactus},
      own_participants_{shared == nullptr ? join_session(load_test(test), named(std::move(address), kSinkName))
                                          : nullptr},
      participants_{shared == nullptr ? *own_participants_ : *shared},
      client_{participants_.origin(), {}},
      demand_{participants_, wire::topics::kDemand},
      catalogue_{participants_, wire::topics::kCatalogue, into_inbox<session::CatalogueEntry>()},
      base_{participants_, wire::topics::kBase, into_inbox<session::BulkChunk>(), {wire::hrtc_partition(kSinkName)}},
      records_{
          participants_, wire::topics::kRecords, into_inbox<session::BulkChunk>(), {wire::hrtc_partition(kSinkName)}},
      thread_{[this] { run(); }} {}

MeshSink::~MeshSink() {
  stop_ = true;
  thread_.join();
}

void MeshSink::run() {
  while (!stop_) {
    for (const auto& arrived : inbox_.take(kInboxTimeout))
      std::visit([&](const auto& sample) { on_sample(sample, arrived.at_ns); }, arrived.sample);
    if (host_ == 0) continue;
    const std::int64_t now_ns = realtime::monotonic_ns();
    client_.on_host_heartbeat(host_, host_incarnation_, now_ns);
    request_next_regions(now_ns);
    while (auto demand = client_.demand(now_ns)) {
      demand->origin = participants_.origin();
      (void)demand_.send(*demand);
    }
  }
}

void MeshSink::on_sample(const session::CatalogueEntry& entry, std::int64_t at_ns) {
  if (is_flood_ || host_ != 0) return;
  host_ = entry.origin.participant;
  host_incarnation_ = entry.origin.incarnation;
  regions_ = entry.summary.regions;
  client_.on_host_heartbeat(host_, host_incarnation_, at_ns);
  client_.on_catalogue(entry);
  client_.open(entry.object_id, entry.summary.digest);
}

void MeshSink::on_sample(const session::BulkChunk& chunk, std::int64_t at_ns) {
  if (is_flood_) return count_message(chunk.payload_bytes(), at_ns);
  for (const session::DeliveryClient::Message& message : client_.on_chunk(chunk, at_ns)) on_sample(message, at_ns);
}

void MeshSink::on_sample(const session::DeliveryClient::Message& message, std::int64_t at_ns) {
  if (message.kind == session::BulkKind::kBase) {
    client_.answer_base_stored(message.object_id);
    for (std::uint32_t region = 0; region < regions_; ++region) absent_.push_back(region);
    return;
  }
  count_message(message.bytes.size(), at_ns);
  client_.answer_stored(message.object_id, message.region);
  held_.push_back(message.region);
  wanted_.erase(std::remove(wanted_.begin(), wanted_.end(), message.region), wanted_.end());
  burst_bytes_ += message.bytes.size();
  if (min_burst_ == 0 || !wanted_.empty()) return;
  {
    const std::lock_guard lock{mutex_};
    bursts_.push_back({static_cast<double>(at_ns - burst_ns_) * 1e-6, at_ns, burst_bytes_});
  }
  client_.set_wanted(message.object_id, {});  // otherwise the host would send regions again that are evicted
  if (burst_bytes_ < min_burst_) ++burst_regions_;
  pause_until_ns_ = at_ns + kPauseNs;
}

void MeshSink::count_message(std::size_t bytes, std::int64_t at_ns) {
  if (first_ns_ == 0)
    first_ns_ = at_ns;
  else
    bytes_ += bytes;
  last_ns_ = at_ns;
}

/// Requests regions in turn. Holds the newest regions and evicts the oldest, which it requests again later.
void MeshSink::request_next_regions(std::int64_t now_ns) {
  const std::uint64_t object = session::id_of(kObjectName);
  is_retiring_ = held_.size() > (is_retiring_ ? kMinHeld : kMaxHeld);
  while (is_retiring_ && held_.size() > kMinHeld && client_.retire(object, held_.front())) held_.erase(held_.begin());
  for (const std::uint32_t region : client_.take_released(object)) absent_.push_back(region);
  const std::size_t max = min_burst_ == 0 ? kMaxWanted : burst_regions_;
  const bool may_request = min_burst_ == 0 || (wanted_.empty() && now_ns >= pause_until_ns_);
  if (!may_request || wanted_.size() >= max || absent_.size() < (min_burst_ == 0 ? 1 : max)) return;
  const std::size_t count = std::min(max - wanted_.size(), absent_.size());
  wanted_.insert(wanted_.end(), absent_.begin(), absent_.begin() + static_cast<std::ptrdiff_t>(count));
  absent_.erase(absent_.begin(), absent_.begin() + static_cast<std::ptrdiff_t>(count));
  burst_ns_ = now_ns;
  burst_bytes_ = 0;
  std::vector<session::Wanted> all;
  for (const std::uint32_t region : wanted_) all.push_back({region, static_cast<std::uint32_t>(all.size())});
  client_.set_wanted(object, std::move(all));
}

double MeshSink::bytes_per_s() { return latency::bytes_per_s(bytes_, first_ns_, last_ns_, seconds_); }

std::vector<MeshSink::Burst> MeshSink::take_bursts() {
  const std::lock_guard lock{mutex_};
  return std::exchange(bursts_, {});
}

}  // namespace tactus::latency
