// A loader without other parts: it frees the memory of objects that are withdrawn or refused.

#include "hrtc_service/loader.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/constants.hpp"

namespace tactus::hrtc_service {
namespace {

class LoaderTest : public testing::Test {
 protected:
  LoaderTest() {
    settings_.directory_bytes = 4u << 20;
    loader_.emplace(pool_settings_, session::Origin{kSession, kHrtc, 1, 0}, settings_, link_);
    loader_->on_object_gone = [this](const Loader::ObjectInfo&) { ++removals_; };
    loader_->on_event = [this](session::Severity, const std::string& text) { events_.push_back(text); };
  }
  void offer(int number, bool withdrawn, std::uint32_t base_bytes = 1000) {
    session::CatalogueEntry entry;
    entry.origin = {kSession, kHost, 1, 0};
    entry.object = "object " + std::to_string(number);
    entry.object_id = session::id_of(entry.object);
    entry.summary = model_.model().summary;
    entry.base_bytes = base_bytes;
    entry.withdrawn = withdrawn;
    loader_->on_catalogue(entry);
  }
  [[nodiscard]] bool has(int number) const {
    return loader_->has_object(session::id_of("object " + std::to_string(number)));
  }
  void run(std::int64_t ms) {
    for (const std::int64_t end = now_ + ms * kMs; now_ < end; now_ += 100 * kMs) {
      loader_->on_host_heartbeat(kHost, 1, now_);
      std::array<NearObjects, kMaxProbes> near;
      loader_->tick(now_, {}, near);
      while (const std::optional<session::Demand> demand = loader_->demand(now_)) credit_ = demand->credit;
    }
  }

  spm::offline::BuiltModel model_ =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 2000));
  spm::PoolSettings pool_settings_ = spm::PoolSettings::for_slots(1000);
  IntakeLink link_;
  LoaderSettings settings_;
  std::optional<Loader> loader_;
  int removals_ = 0;
  std::vector<std::string> events_;
  std::uint32_t credit_ = 0;  // of the newest demand
  std::int64_t now_ = 10'000 * kMs;
};

TEST_F(LoaderTest, AnObjectThatIsWithdrawnBeforeItsBaseMeshArrivesIsFreed) {
  for (int number = 0; number < 500; ++number) {  // together they exceed the memory for directories
    offer(number, false);
    run(200);
    ASSERT_TRUE(has(number)) << number;
    offer(number, true);
    run(1100);
  }
  EXPECT_EQ(loader_->directory_bytes_used(), 0u);
  EXPECT_EQ(removals_, 500);
}

TEST_F(LoaderTest, TheObjectAboveTheMaxIsIgnoredWithAMessageUntilAnotherIsWithdrawn) {
  constexpr int kMax = 64;
  for (int number = 0; number < kMax; ++number) offer(number, false);
  EXPECT_THAT(events_, testing::Not(testing::Contains(testing::HasSubstr("ignored"))));

  offer(kMax, false);
  EXPECT_THAT(events_,
              testing::Contains("object object 64: ignored while there are 64 others, the maximum of an HRTC"));
  run(1000);
  for (int number = 0; number < kMax; ++number) EXPECT_TRUE(has(number)) << number;
  EXPECT_FALSE(has(kMax));

  EXPECT_EQ(loader_->figures().objects_refused, 0u);

  offer(3, true);
  run(1100);
  EXPECT_FALSE(has(3));
  EXPECT_TRUE(has(kMax));
}

TEST_F(LoaderTest, TheCreditDoesNotExceedStoreAndBaseMeshWhileTheBaseMeshIsMissing) {
  constexpr std::uint32_t kBaseBytes = 2000, kMaxBytesPerBlock = 16;
  offer(0, false, kBaseBytes);
  run(200);
  EXPECT_GE(credit_, kBaseBytes);
  EXPECT_LE(credit_, kMaxBytesPerBlock * pool_settings_.compressed_blocks);
}

TEST_F(LoaderTest, ARefusedObjectIsRemovedWhenItsOfferIsWithdrawn) {
  constexpr std::uint32_t kTooLarge = 100u << 20;
  for (int number = 0; number < 200; ++number) {
    offer(number, false, kTooLarge);
    run(200);
    ASSERT_EQ(loader_->directory_bytes_used(), 0u);
    offer(number, true);
    run(1100);
  }
  EXPECT_EQ(loader_->figures().objects_refused, 200u);
  EXPECT_EQ(removals_, 200);
}

}  // namespace
}  // namespace tactus::hrtc_service
