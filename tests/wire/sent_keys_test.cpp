/// Members that join a secured session again and again, as a gateway does that crashes.
#include <gtest/gtest.h>
#include <malloc.h>

#include "support.hpp"
#include "tests/wire/secured_session.hpp"

namespace tactus::wire::test {
namespace {

class SentKeysTest : public SecuredSession {
 protected:
  /// A member joins, and is gone when this returns.
  [[nodiscard]] bool joins_and_leaves() {
    {
      Participants guest{guest_};
      const Reader<ses::RosterEntry> reader{guest, topics::kRoster, [](ses::RosterEntry&&) {}};
      const Writer<ses::RosterEntry> writer{guest, topics::kRoster};
      if (!eventually([&] { return reader.matched() == 1 && writer.matched() == 1; })) return false;
    }
    return eventually([&] { return reader_.matched() == 0 && writer_.matched() == 0; });
  }

  const SessionAddress guest_ = member("guest");
  const Reader<ses::RosterEntry> reader_{desk_, topics::kRoster, [](ses::RosterEntry&&) {}};
  const Writer<ses::RosterEntry> writer_{desk_, topics::kRoster};
};

TEST_F(SentKeysTest, AProgramDoesNotGrowWithEachParticipantThatJoins) {
  constexpr int kJoins = 4;
  constexpr double kMaxBytes = 100e3;  // of each join in both programs; stored keys of one join take 200 KB
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(joins_and_leaves());  // the pools of the library grow at first
  const std::size_t before = ::mallinfo2().uordblks;
  for (int i = 0; i < kJoins; ++i) ASSERT_TRUE(joins_and_leaves());
  double growth = 0;
  // The library frees more of a participant when its lease ends.
  EXPECT_TRUE(eventually([&] {
    growth = static_cast<double>(::mallinfo2().uordblks) - static_cast<double>(before);
    return growth / kJoins <= kMaxBytes;
  })) << growth / kJoins;
}

}  // namespace
}  // namespace tactus::wire::test
