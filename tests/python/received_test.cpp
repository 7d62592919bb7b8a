#include "python/received.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tactus::python {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

StateRow row(std::int64_t session_time_ns) {
  StateRow made{};
  made.session_time_ns = session_time_ns;
  return made;
}

session::Origin origin_of(const std::string& name, std::uint64_t incarnation = 1) {
  return {session::id_of("test"), session::id_of(name), incarnation, 0};
}

session::CatalogueEntry entry_of(const std::string& host, const std::string& object, std::uint64_t incarnation = 1) {
  session::CatalogueEntry entry;
  entry.origin = origin_of(host, incarnation);
  entry.host = host;
  entry.object = object;
  return entry;
}

TEST(ReceivedStates, ReturnsEachRowOnceAndKeepsTheNewest) {
  ReceivedStates states;
  for (std::int64_t i = 0; i < 3; ++i) states.add(7, row(i), i);
  EXPECT_EQ(states.take(7).size(), 3u);
  EXPECT_THAT(states.take(7), testing::IsEmpty());
  EXPECT_EQ(states.newest(7)->session_time_ns, 2);
  EXPECT_FALSE(states.newest(8));
}

TEST(ReceivedStates, AUserLosesTheOldestRowsAboveTheLimit) {
  ReceivedStates states;
  for (std::int64_t i = 0; i < std::int64_t{ReceivedStates::kMaxRows} + 5; ++i) states.add(7, row(i), i);
  const std::vector<StateRow> rows = states.take(7);
  ASSERT_EQ(rows.size(), ReceivedStates::kMaxRows);
  EXPECT_EQ(rows.front().session_time_ns, 5);
}

TEST(ReceivedStates, TheUserWithTheMostRowsLosesSomeAboveTheLimitOfAllUsers) {
  ReceivedStates states;
  for (std::int64_t i = 0; i < 10; ++i) states.add(1, row(i), i);
  for (std::int64_t i = 0; i < std::int64_t{ReceivedStates::kMaxAllRows}; ++i) {
    states.add(2 + static_cast<std::uint64_t>(i) % 20, row(i), i);
    ASSERT_LE(states.rows(), ReceivedStates::kMaxAllRows);
  }
  EXPECT_EQ(states.take(1).size(), 10u);
}

TEST(ReceivedStates, ASilentUserMakesRoomForANewOne) {
  ReceivedStates states;
  for (std::uint64_t user = 0; user < ReceivedStates::kMaxUsers; ++user) states.add(user, row(1), 0);
  states.add(5000, row(2), kSecond / 2);
  EXPECT_FALSE(states.newest(5000)) << "all users have new states";
  states.add(0, row(3), kSecond / 2);
  states.add(5000, row(4), 2 * kSecond - kSecond / 2);
  ASSERT_TRUE(states.newest(5000));
  EXPECT_EQ(states.newest(0)->session_time_ns, 3) << "another user is silent for longer";
  EXPECT_EQ(states.rows(), ReceivedStates::kMaxUsers + 1);
}

class OfferedObjectsTest : public testing::Test {
 protected:
  void add(const session::CatalogueEntry& entry, std::int64_t now_ns = 0) { objects_.add(entry, roster_, now_ns); }
  [[nodiscard]] std::string host_of(const std::string& object) const {
    const auto entries = objects_.newest();
    const auto found = entries.find(object);
    return found == entries.end() ? "" : found->second.host;
  }

  session::Roster roster_{origin_of("script"), {}};
  OfferedObjects objects_;
};

TEST_F(OfferedObjectsTest, AnObjectExistsUntilItsLastHostHasWithdrawnIt) {
  add(entry_of("museum", "organ"));
  add(entry_of("annex", "organ"));
  EXPECT_EQ(host_of("organ"), "annex");
  session::CatalogueEntry withdrawn = entry_of("annex", "organ");
  withdrawn.withdrawn = true;
  add(withdrawn);
  EXPECT_EQ(host_of("organ"), "museum");
  objects_.remove(origin_of("cellar"));
  EXPECT_EQ(host_of("organ"), "museum") << "another program has left";
  objects_.remove(origin_of("museum"));
  EXPECT_EQ(host_of("organ"), "");
}

TEST_F(OfferedObjectsTest, AnObjectOfAnEarlierProcessEndsWhenItsHostHasStartedAgain) {
  add(entry_of("museum", "organ"));
  objects_.remove_earlier(origin_of("museum", 1));
  EXPECT_EQ(host_of("organ"), "museum");
  objects_.remove_earlier(origin_of("museum", 2));
  EXPECT_EQ(host_of("organ"), "");
  add(entry_of("museum", "organ"));
  add(entry_of("museum", "organ", 2));
  objects_.remove(origin_of("museum", 2));
  EXPECT_EQ(host_of("organ"), "") << "the offer of the earlier process too";
}

TEST_F(OfferedObjectsTest, OffersOfAbsentProgramsMakeRoomForNewOnes) {
  session::RosterEntry present;
  present.origin = origin_of("museum");
  present.name = "museum";
  present.role = session::Role::kHost;
  present.heartbeat = 1;
  ASSERT_EQ(roster_.on_entry(present, 0).size(), 1u);
  add(entry_of("museum", "organ"));
  for (std::size_t i = 1; i < OfferedObjects::kMaxOffers; ++i) add(entry_of("forger", "object " + std::to_string(i)));
  EXPECT_EQ(objects_.newest().size(), OfferedObjects::kMaxOffers);
  add(entry_of("museum", "vase"), kSecond);
  EXPECT_EQ(objects_.newest().size(), 2u);
  EXPECT_EQ(host_of("organ"), "museum");
  EXPECT_EQ(host_of("vase"), "museum");
}

TEST_F(OfferedObjectsTest, TheNumberOfOffersIsLimited) {
  for (std::size_t i = 0; i < OfferedObjects::kMaxOffers + 10; ++i)
    add(entry_of("forger", "object " + std::to_string(i)));
  EXPECT_LE(objects_.newest().size(), OfferedObjects::kMaxOffers);
}

}  // namespace
}  // namespace tactus::python
