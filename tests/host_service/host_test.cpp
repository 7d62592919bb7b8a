/// A Host in this process, and a test HRTC that exchanges samples with it over DDS.
#include "host_service/host.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <mutex>
#include <thread>
#include <variant>

#include "session/clock.hpp"
#include "session/delivery_client.hpp"
#include "session/figures.hpp"
#include "spm/codec/base_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/model_file.hpp"
#include "spm/offline/write_mesh.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/test_domain.hpp"
#include "wire/endpoints.hpp"

namespace tactus::host_service {
namespace {

namespace offline = spm::offline;
using namespace std::chrono_literals;
using session::BulkKind;
using Clock = std::chrono::steady_clock;

constexpr auto kWatchdog = 20s;

std::int64_t now_ns() { return std::chrono::nanoseconds(Clock::now().time_since_epoch()).count(); }

wire::SessionAddress address(const std::string& participant) {
  wire::SessionAddress address;
  address.session = "test.host." + std::to_string(getpid());
  address.participant = participant;
  address.domain = test_support::test_domain();
  return address;
}

/// An HRTC that requests all regions of one object.
class TestHrtc {
 public:
  explicit TestHrtc(const std::string& name)
      : participants_{address(name)},
        client_{participants_.origin(), {}},
        roster_{participants_, wire::topics::kRoster},
        demands_{participants_, wire::topics::kDemand},
        clock_{participants_, wire::topics::kClock},
        end_{participants_, wire::topics::kEnd} {
    const wire::EndpointOptions own_partition{wire::hrtc_partition(name)};
    listen(wire::topics::kRoster);
    listen(wire::topics::kCatalogue);
    listen(wire::topics::kClock);
    listen(wire::topics::kMetrics);
    listen(wire::topics::kBase, own_partition);
    listen(wire::topics::kRecords, own_partition);
  }

  /// Runs until `condition` holds. Returns false when the watchdog expires.
  template <class Condition>
  [[nodiscard]] bool run_until(Condition&& condition) {
    const auto end = Clock::now() + kWatchdog;
    for (auto next_heartbeat = Clock::now(); !condition();) {
      if (Clock::now() > end) return false;
      if (Clock::now() >= next_heartbeat) {
        send_heartbeat();
        next_heartbeat += 50ms;
      }
      std::unique_lock<std::mutex> lock{mutex_};
      arrived_.wait_for(lock, 2ms, [this] { return !samples_.empty(); });
      std::deque<Sample> arrived = std::exchange(samples_, {});
      lock.unlock();
      for (const Sample& sample : arrived)
        std::visit([this](const auto& alternative) { receive(alternative); }, sample);
      while (const auto demand = client_.demand(now_ns())) EXPECT_EQ(demands_.send(*demand), wire::SendStatus::kSent);
    }
    return true;
  }

  void end_session() { EXPECT_EQ(end_.send({participants_.origin(), "enough"}), wire::SendStatus::kSent); }

  [[nodiscard]] bool holds_all() const { return base_ && held_.size() == base_->mesh.summary.regions; }

  std::optional<session::CatalogueEntry> catalogue_;
  std::optional<spm::codec::DecodedBase> base_;
  std::map<std::uint32_t, spm::RegionData> held_;
  std::map<std::string, double> figures_;
  std::uint64_t records_ = 0;
  bool host_left_ = false, withdrawn_ = false, clock_answered_ = false;

 private:
  using Sample = std::variant<session::RosterEntry, session::CatalogueEntry, session::ClockSample, session::Metrics,
                              session::BulkChunk>;

  template <class T>
  void listen(const wire::TopicSpec<T>& topic, const wire::EndpointOptions& options = {}) {
    readers_.push_back(std::make_shared<wire::Reader<T>>(
        participants_, topic,
        [this](T&& sample) {
          const std::lock_guard<std::mutex> lock{mutex_};
          samples_.emplace_back(std::move(sample));
          arrived_.notify_all();
        },
        options));
  }

  void send_heartbeat() {
    session::RosterEntry entry;
    entry.origin = participants_.origin();
    entry.role = session::Role::kHrtc;
    entry.name = participants_.address().participant;
    entry.session = participants_.address().session;
    entry.heartbeat = ++heartbeat_;
    (void)roster_.send(entry);
    session::ClockSample request;
    request.origin = participants_.origin();
    request.peer = session::id_of("host");
    request.sequence = static_cast<std::uint32_t>(heartbeat_);
    request.t0_ns = now_ns();
    (void)clock_.send(request);
  }

  void receive(const session::RosterEntry& entry) {
    if (entry.role != session::Role::kHost) return;
    host_left_ = host_left_ || entry.leaving;
    client_.on_host_heartbeat(entry.origin.participant, entry.origin.incarnation, now_ns());
  }
  void receive(const session::CatalogueEntry& entry) {
    client_.on_catalogue(entry);
    withdrawn_ = withdrawn_ || entry.withdrawn;
    if (entry.withdrawn || catalogue_) return;
    catalogue_ = entry;
    client_.open(entry.object_id, entry.summary.digest);
  }
  void receive(const session::ClockSample& sample) {
    clock_answered_ = clock_answered_ || (sample.answer && sample.t2_ns >= sample.t1_ns);
  }
  void receive(const session::Metrics& metrics) {
    for (const session::Figure& figure : metrics.figures) figures_[figure.name] = figure.value;
  }
  void receive(const session::BulkChunk& chunk) {
    for (const auto& message : client_.on_chunk(chunk, now_ns())) receive(message);
  }
  void receive(const session::DeliveryClient::Message& message) {
    if (message.kind == BulkKind::kBase) {
      auto base = spm::codec::decode_base(message.bytes);
      ASSERT_TRUE(base) << base.error().text;
      base_ = std::move(*base);
      client_.answer_base_stored(message.object_id);
      std::vector<session::Wanted> wanted;
      for (std::uint32_t region = 0; region < base_->mesh.summary.regions; ++region) wanted.push_back({region, region});
      client_.set_wanted(message.object_id, wanted);
      return;
    }
    auto region = spm::codec::decode_region(message.bytes, base_->mesh.summary, base_->tables);
    ASSERT_TRUE(region) << region.error().text;
    records_ += region->residuals.size();
    held_[message.region] = std::move(*region);
    client_.answer_stored(message.object_id, message.region);
  }

  wire::Participants participants_;
  session::DeliveryClient client_;
  wire::Writer<session::RosterEntry> roster_;
  wire::Writer<session::Demand> demands_;
  wire::Writer<session::ClockSample> clock_;
  wire::Writer<session::SessionEnd> end_;
  std::uint64_t heartbeat_ = 0;
  std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<Sample> samples_;
  std::vector<std::shared_ptr<void>> readers_;
};

/// A Host that runs in its own thread.
class RunningHost {
 public:
  RunningHost(HostOptions options) : host_{std::move(options), [](session::Severity, const std::string&) {}, stop_} {
    thread_ = std::thread{[this] { exit_code_ = host_.run(); }};
  }
  ~RunningHost() { stop(); }
  int stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    return exit_code_;
  }
  int wait() {
    thread_.join();
    return exit_code_;
  }

 private:
  std::atomic<bool> stop_{false};
  Host host_;
  int exit_code_ = -1;
  std::thread thread_;
};

class HostTest : public testing::Test {
 protected:
  HostTest() {
    offline::write_mesh(folder_.path() / "organ.ply", offline::generate(offline::Shape::kOrgan, 6000, 3));
    options_.address = address("host");
    options_.cache = folder_.path();
    options_.objects = {object_from_model(folder_.path() / "organ.ply")};
    options_.objects[0].size = 0.3;
  }

  test_support::TemporaryFolder folder_;
  HostOptions options_;
};

TEST_F(HostTest, AnHrtcReceivesEachRecordOnceAndToTheBit) {
  RunningHost host{options_};
  TestHrtc hrtc{"hrtc"};

  ASSERT_TRUE(hrtc.run_until([&] { return hrtc.holds_all(); }));

  const session::CatalogueEntry& entry = *hrtc.catalogue_;
  EXPECT_EQ(entry.object, "organ");
  EXPECT_EQ(hrtc.base_->mesh.summary.digest, entry.summary.digest);
  EXPECT_EQ(hrtc.records_, entry.summary.records);
  EXPECT_NEAR(entry.scale * std::max({entry.summary.bounds_max[0] - entry.summary.bounds_min[0],
                                      entry.summary.bounds_max[1] - entry.summary.bounds_min[1],
                                      entry.summary.bounds_max[2] - entry.summary.bounds_min[2]}),
              0.3, 1e-6);
  ASSERT_EQ(entry.surface.points.size(), session::kMaxSurfacePoints);
  EXPECT_GT(entry.surface.spacing, 0);
  for (const spm::SurfacePoint& point : entry.surface.points)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_GE(point.position[axis], entry.summary.bounds_min[axis]);
      EXPECT_LE(point.position[axis], entry.summary.bounds_max[axis]);
    }
  std::filesystem::path built;
  for (const auto& file : std::filesystem::directory_iterator{folder_.path()}) {
    if (file.path().extension() == ".spm") built = file.path();
  }
  const offline::MappedModel original{built};
  const spm::codec::CompressedModel& model = original.compressed();
  for (const auto& [region, data] : hrtc.held_) {
    EXPECT_EQ(data.list.size(), model.intervals_of(spm::RegionId{region}).size());
    const auto expected = spm::codec::decode_region(*spm::codec::encode_region(model, spm::RegionId{region}, data.sent),
                                                    model.summary(), model.tables());
    ASSERT_TRUE(expected) << expected.error().text;
    EXPECT_EQ(data.residuals, expected->residuals);
    ASSERT_EQ(data.parts.size(), expected->parts.size());
    EXPECT_EQ(std::memcmp(data.parts.data(), expected->parts.data(), data.parts.size() * sizeof data.parts[0]), 0);
  }
}

TEST_F(HostTest, CountsSentRecordsAndAnswersClockRequests) {
  RunningHost host{options_};
  TestHrtc hrtc{"hrtc"};
  ASSERT_TRUE(hrtc.run_until([&] { return hrtc.holds_all(); }));
  namespace names = session::figures;

  const double records = hrtc.catalogue_->summary.records;

  // The host may have published earlier figures before it had sent all records.
  ASSERT_TRUE(hrtc.run_until([&] { return hrtc.figures_[names::kHostRecords] >= records; }));

  EXPECT_EQ(hrtc.figures_[names::kHostRecords], records);
  EXPECT_EQ(hrtc.figures_[std::string{names::kHostRecords} + ".hrtc"], records);
  EXPECT_EQ(hrtc.figures_[names::kHostHrtcs], 1);
  EXPECT_TRUE(hrtc.run_until([&] { return hrtc.clock_answered_; }));
}

TEST_F(HostTest, LeavesAndWithdrawsItsObjectsAtTheEndOfTheSession) {
  RunningHost host{options_};
  TestHrtc hrtc{"hrtc"};
  ASSERT_TRUE(hrtc.run_until([&] { return hrtc.catalogue_.has_value(); }));

  hrtc.end_session();

  EXPECT_EQ(host.wait(), 0);
  EXPECT_TRUE(hrtc.run_until([&] { return hrtc.host_left_ && hrtc.withdrawn_; }));
}

TEST_F(HostTest, ARestartedHostServesAWaitingHrtc) {
  auto first = std::make_unique<RunningHost>(options_);
  TestHrtc hrtc{"hrtc"};
  ASSERT_TRUE(hrtc.run_until([&] { return !hrtc.held_.empty(); }));
  first.reset();

  RunningHost second{options_};

  EXPECT_TRUE(hrtc.run_until([&] { return hrtc.holds_all(); }));
}

TEST_F(HostTest, TheLaterOfTwoHostsWithOneNameEnds) {
  RunningHost first{options_};
  RunningHost second{options_};

  EXPECT_EQ(second.wait(), 2);

  EXPECT_EQ(first.stop(), 0);
}

TEST_F(HostTest, RefusesTwoObjectsWithOneName) {
  const std::atomic<bool> never{false};
  options_.objects.push_back(options_.objects[0]);
  EXPECT_THROW((Host{options_, [](session::Severity, const std::string&) {}, never}), HostError);
}

}  // namespace
}  // namespace tactus::host_service
