/// Changes one bit of an encoded chunk between a host and an HRTC. UDP detects such an error too, but not in the memory
/// of a switch or of a program.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "session/delivery_client.hpp"
#include "session/delivery_server.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/random_model.hpp"
#include "tests/wire/encoding.hpp"
#include "wire/tap.hpp"
#include "wire/topics.hpp"

namespace tactus::wire {
namespace {

using session::BulkChunk;
using session::DeliveryClient;
using session::DeliveryServer;
using Bytes = std::vector<std::uint8_t>;

constexpr std::int64_t kMs = 1'000'000, kMaxTimeNs = 3'000 * kMs;
constexpr std::size_t kChunkBytes = 200;  // so that some messages have several chunks
constexpr session::Origin kServerOrigin{kSession, kHost, 5, 0}, kClientOrigin{kSession, kHrtc, 7, 0};

const spm::OwnedModel& subject() {
  static const spm::OwnedModel model = test_support::random_model(5, 100, 2);
  return model;
}
const spm::codec::CompressedModel& compressed_subject() {
  static const spm::codec::EncodedModel encoded{subject().model()};
  return encoded.compressed();
}

/// Whether these bytes are a host's message of the region. Remembers the messages that are.
bool is_message_of(std::uint32_t region, const Bytes& bytes) {
  static std::set<std::pair<std::uint32_t, Bytes>> known;
  if (known.contains({region, bytes})) return true;
  const auto data = spm::codec::decode_region(bytes, subject().summary, compressed_subject().tables());
  if (!data || spm::index(data->region) != region ||
      bytes != *spm::codec::encode_region(compressed_subject(), data->region, data->sent))
    return false;
  known.emplace(region, bytes);
  return true;
}

/// Results of all flips.
struct Outcomes {
  std::uint64_t undecodable = 0;   ///< chunks that the decoder or the check of fields dropped
  std::uint64_t implausible = 0;   ///< chunks of no known stream, or with a wrong number or time
  std::uint64_t corrupt = 0;       ///< messages with a wrong checksum
  std::uint64_t repeated = 0;      ///< exchanges in which the host sent pieces or regions again
  std::uint64_t without_loss = 0;  ///< exchanges that the flip changed in times or epochs only
};

/// An HRTC gets the base mesh and some regions from a host. One bit of one chunk is changed on the way.
class Exchange {
 public:
  Exchange(std::mt19937_64& random, bool damages) : random_{random}, damages_{damages} {
    server_.add(kObject, compressed_subject());
    session::CatalogueEntry entry;
    entry.origin = kServerOrigin;
    entry.object_id = kObject;
    entry.summary = subject().summary;
    client_.on_catalogue(entry);
    client_.open(kObject, subject().summary.digest);
    for (int i = 0; i < 3; ++i) wanted_.insert(static_cast<std::uint32_t>(random() % subject().summary.regions));
    std::vector<session::Wanted> wanted;
    for (const std::uint32_t region : wanted_) wanted.push_back({region, 10'000});
    client_.set_wanted(kObject, wanted);
    damaged_chunk_ = random() % 4;
  }

  /// Runs until the HRTC has the base mesh and all wanted regions. Returns what went wrong, or an empty string.
  std::string run(Outcomes& outcomes) {
    for (; now_ns_ < kMaxTimeNs && (!has_base_ || have_ != wanted_); now_ns_ += kMs) {
      client_.on_host_heartbeat(kHost, kServerOrigin.incarnation, now_ns_);
      while (const auto demand = client_.demand(now_ns_))
        if (server_.on_demand(*demand, now_ns_) == DeliveryServer::DemandResult::kMalformed)
          return "a demand is malformed";
      for (int i = 0; i < 12; ++i) {
        const std::optional<session::Outgoing> out = server_.next(now_ns_);
        if (!out) break;
        send(out->chunk, outcomes);
        if (!error_.empty()) return error_;
      }
    }
    if (!has_base_ || have_ != wanted_) return "not all regions have arrived";
    const DeliveryClient::Counters& client = client_.counters();
    const session::DeliveryCounters server = server_.counters_by_hrtc().at(kHrtc);
    outcomes.implausible += client.foreign + client.implausible;
    outcomes.corrupt += client.corrupt;
    const bool again = server.repeated > 0 || server.bases > 1 || server.regions > wanted_.size();
    ++(again ? outcomes.repeated : outcomes.without_loss);
    return {};
  }

 private:
  void send(const BulkChunk& chunk, Outcomes& outcomes) {
    const bool is_base = chunk.kind() == session::BulkKind::kBase;
    const char* const topic = is_base ? topics::kBase.name : topics::kRecords.name;
    Bytes bytes = test::encoded(chunk);
    if (chunks_++ == damaged_chunk_ && damages_) {
      const std::size_t bit = random_() % (bytes.size() * 8);
      bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
    }
    const std::optional<AnySample> sample = decode(topic, bytes);
    if (!sample) {
      ++outcomes.undecodable;
      return;
    }
    for (const DeliveryClient::Message& message : client_.on_chunk(std::get<BulkChunk>(*sample), now_ns_))
      take(message);
  }
  void take(const DeliveryClient::Message& message) {
    if (message.region == spm::kNone) {
      const std::span<const std::uint8_t> base = compressed_subject().spans().base;
      if (!std::equal(base.begin(), base.end(), message.bytes.begin(), message.bytes.end()))
        error_ = "the base mesh differs";
      has_base_ = true;
      return client_.answer_base_stored(kObject);
    }
    if (!is_message_of(message.region, message.bytes)) error_ = "region " + std::to_string(message.region) + " differs";
    have_.insert(message.region);
    client_.answer_stored(kObject, message.region);
  }

  std::mt19937_64& random_;
  bool damages_;
  DeliveryServer server_{kServerOrigin, kChunkBytes};
  DeliveryClient client_{kClientOrigin, {}};
  std::set<std::uint32_t> wanted_, have_;
  bool has_base_ = false;
  std::uint64_t damaged_chunk_ = 0, chunks_ = 0;  // of all chunks from the host
  std::int64_t now_ns_ = 1'000 * kMs;
  std::string error_;
};

/// Runs `count` exchanges. Returns the seed of the first that fails, and what went wrong, or an empty string.
std::string run_exchanges(std::uint64_t count, bool damages, Outcomes& outcomes) {
  for (std::uint64_t seed = 1; seed <= count; ++seed) {
    std::mt19937_64 random{seed};
    if (const std::string error = Exchange{random, damages}.run(outcomes); !error.empty())
      return "seed " + std::to_string(seed) + ": " + error;
  }
  return {};
}

void expect_no_effect(std::uint64_t flips) {
  Outcomes outcomes;
  ASSERT_EQ(run_exchanges(flips, true, outcomes), "");
  for (const std::uint64_t way : {outcomes.undecodable, outcomes.implausible, outcomes.corrupt})
    EXPECT_GT(way, flips / 100) << "a way of detection is not reached";
  EXPECT_LT(outcomes.without_loss, flips / 10) << "most flips damage numbers or data";
}

TEST(BitFlips, WithoutThemAHostSendsNothingTwice) {
  Outcomes outcomes;
  ASSERT_EQ(run_exchanges(1'000, false, outcomes), "");
  EXPECT_EQ(outcomes.repeated + outcomes.undecodable + outcomes.implausible + outcomes.corrupt, 0u);
}

TEST(BitFlips, NeverChangeAMesh) { expect_no_effect(10'000); }

TEST(LongBitFlips, AMillionNeverChangeAMesh) { expect_no_effect(1'000'000); }

}  // namespace
}  // namespace tactus::wire
